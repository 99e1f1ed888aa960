"""The inputs of a cell on the page: a tab with their states and buttons that force them."""

import json
from collections.abc import Callable, Sequence
from typing import Any

from delta3_pacdrive.view import readout
from delta3_pacdrive.view.values import InputFacts

VALUES = {'on': True, 'off': False, 'auto': 'auto'}


class InputRows:
    """A tab with a row for each input, hidden without inputs.

    ``ask`` sends a request to the service ``input``.
    """

    def __init__(self, gui: Any, tabs: Any, ask: Callable[[str], None]) -> None:
        self._gui, self._tabs, self._ask = gui, tabs, ask
        self._tab: Any = None
        self._shown: dict[str, tuple[InputFacts, Any]] = {}

    def show(self, inputs: Sequence[InputFacts]) -> None:
        """Update the states of the inputs; rebuild the rows if the inputs have changed."""
        if [one.name for one in inputs] != list(self._shown):
            self._rebuild(inputs)
        for one in inputs:
            before, value = self._shown[one.name]
            if one != before:
                value.content = readout.input_row(one)
                self._shown[one.name] = one, value

    def _rebuild(self, inputs: Sequence[InputFacts]) -> None:
        if self._tab is not None:
            self._tab.remove()
            self._tab = None
        self._shown = {}
        if not inputs:
            return
        self._tab = self._tabs.add_tab('Inputs')
        with self._tab:
            for one in inputs:
                value = self._gui.add_html(readout.input_row(one))
                buttons = self._gui.add_button_group('set to', tuple(VALUES))
                buttons.on_click(self._asks(one.name))
                self._shown[one.name] = one, value

    def _asks(self, name: str) -> Callable[[Any], None]:
        def ask(event: Any) -> None:
            word = event.target.value
            if word in VALUES:  # a browser may send any value
                self._ask(json.dumps({'name': name, 'value': VALUES[word]}))

        return ask
