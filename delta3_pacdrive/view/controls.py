"""The controls of the page for a running robot.

Every click becomes a ``UiCommand``; it is executed elsewhere.
"""

import json
import math
from collections.abc import Callable, Sequence
from threading import Lock
from typing import Any

from delta3_pacdrive.configuration.packaged import program_names
from delta3_pacdrive.robot.drive.operation_data import BACKUP, PROCEDURES, TABLE
from delta3_pacdrive.robot.faults.fault import KINDS, NODES
from delta3_pacdrive.robot.sercos.service_channel import format_idn
from delta3_pacdrive.view import readout
from delta3_pacdrive.view.jog import DIRECTIONS, HEARTBEAT_HZ, JOG_SPEED_MAX_M_S
from delta3_pacdrive.view.values import Facts, InputFacts, UiCommand

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


PROGRAM_BYTES_MAX = 1024 * 1024
STEPS_MM = ('0.1', '1', '5', '10', '50')
JOG_MM_S, JOG_MAX_MM_S = 50, round(1e3 * JOG_SPEED_MAX_M_S)
OVERRIDE_MIN, OVERRIDE_MAX = 1, 150
ANSWERS = 3  # replies shown
FAULT_S = 0.5  # default duration of an injected fault
# procedure commands offered by the page: name by IDN
PROCEDURE_NAMES = {format_idn(idn): TABLE[idn].name for idn in (*PROCEDURES, BACKUP)}
PROCEDURE, END_PROCEDURE = 'procedure', 'end_procedure'  # actions


class Controls:
    """Tabs with buttons in the main panel of the page; ``send`` is called with each command."""

    def __init__(self, gui: Any, send: Callable[[UiCommand], None], drives: Sequence[str]) -> None:
        self._gui, self._send, self._drives = gui, send, tuple(drives)
        self._points: dict[str, tuple[float, float, float]] = {}
        self._replies: list[tuple[str, bool]] = []
        self._outcomes: dict[str, tuple[str, bool]] = {}  # newest report of the procedures of each axis
        self._lock = Lock()  # a thread of the page reports invalid files
        self._override_shown = 1.0
        stop = gui.add_button('EMERGENCY STOP', color='red', icon='hand-stop')
        stop.on_click(lambda _: self._ask('emergency_stop'))
        self._row('motion', 'Start', 'Hold', 'Resume', 'Abort')
        self._row('drives', 'Enable', 'Disable', 'Reset')
        tabs = gui.add_tab_group()
        with tabs.add_tab('Program'):
            self._add_program()
        with tabs.add_tab('Jog'):
            self._add_jog()
        with tabs.add_tab('Teach'):
            self._add_teach()
        with tabs.add_tab('Commissioning'):
            self._add_commissioning()
        with tabs.add_tab('Faults'):
            self._add_faults()
        self._inputs = InputRows(gui, tabs, lambda text: self._ask('input', text))
        self._answers = gui.add_html('')

    def _ask(self, action: str, text: str = '') -> None:
        self._send(UiCommand(action, text, self._by_force.value))

    def _row(self, name: str, *words: str) -> None:
        row = self._gui.add_button_group(name, words)
        row.on_click(lambda event: self._ask(event.target.value.lower()))

    def _add_program(self) -> None:
        gui = self._gui
        chosen = gui.add_dropdown('program', program_names(), hint='packaged programs')
        load = gui.add_button('Load into the queue', icon='playlist-add')
        load.on_click(lambda _: self._ask('packaged', chosen.value))
        file = gui.add_upload_button('Load a file ...', icon='upload', mime_type='.yaml,.yml')
        file.on_upload(lambda _: self._load(file.value))
        gui.add_button('Clear the queue', icon='trash').on_click(lambda _: self._ask('clear'))
        self._override = gui.add_slider(
            'override %', OVERRIDE_MIN, OVERRIDE_MAX, 1, 100, hint='share of the planned speed'
        )
        self._override.on_update(self._set_override)
        self._by_force = gui.add_checkbox(
            'take control over', False, hint='take control of the robot even if another operator has it'
        )

    def _load(self, file: Any) -> None:
        if len(file.content) > PROGRAM_BYTES_MAX:
            self.report(f'{file.name} has {len(file.content)} bytes, the limit is {PROGRAM_BYTES_MAX}', True)
            return
        try:
            text = file.content.decode('utf-8')
        except UnicodeDecodeError:
            self.report(f'{file.name} is not a valid UTF-8 text', True)
            return
        self._ask('program', text)

    def _set_override(self, event: Any) -> None:
        # updates by the robot have no client and are not commands
        if event.client is not None:
            self._ask('override', repr(float(self._override.value)))

    def _add_jog(self) -> None:
        gui = self._gui
        self._speed = gui.add_slider('speed mm/s', 1, JOG_MAX_MM_S, 1, JOG_MM_S)
        self._step = gui.add_dropdown('step mm', STEPS_MM, initial_value='10')
        row = gui.add_button_group('one step', tuple(DIRECTIONS))
        row.on_click(
            lambda event: self._ask('step', f'{event.target.value} {self._step.value} {self._speed.value}')
        )
        for direction in DIRECTIONS:
            button = gui.add_button(
                f'hold {direction}', hint='moves while held, to the edge of the workspace'
            )
            button.on_hold(self._beat(direction), callback_hz=HEARTBEAT_HZ)

    def _beat(self, direction: str) -> Callable[[Any], Any]:
        async def beat(_: Any) -> None:
            self._ask('press', f'{direction} {self._speed.value}')

        return beat

    def _add_teach(self) -> None:
        gui = self._gui
        self._name = gui.add_text('name', 'p1')
        gui.add_button('Teach this point', icon='map-pin').on_click(
            lambda _: self._ask('teach', self._name.value)
        )
        gui.add_button('Delete all points', icon='trash').on_click(lambda _: self._ask('forget'))
        self._taught = gui.add_html('')

    def clear_points(self) -> None:
        """Delete all points."""
        self._points.clear()
        self._taught.content = ''

    def teach(self, name: str, place_m: tuple[float, float, float]) -> None:
        """Store a point, and show all points in the format of a program file."""
        self._points[name] = place_m
        lines = [
            f'  {json.dumps(key)}: [{x:.6f}, {y:.6f}, {z:.6f}]' for key, (x, y, z) in self._points.items()
        ]
        self._taught.content = readout.copied('points:\n' + '\n'.join(lines) + '\n', 'Copy as YAML')
        stem = name.rstrip('0123456789')
        self._name.value = f'{stem}{len(self._points) + 1}'

    def _add_commissioning(self) -> None:
        gui = self._gui
        self._axis = gui.add_dropdown('axis', self._drives)
        chosen = gui.add_dropdown(
            'procedure', tuple(f'{idn} {name}' for idn, name in PROCEDURE_NAMES.items())
        )
        run = gui.add_button('Run the procedure', icon='player-play')
        run.on_click(lambda _: self._ask(PROCEDURE, f'{self._axis.value} {chosen.value.partition(" ")[0]}'))
        stop = gui.add_button('Stop the procedure', icon='player-stop')
        stop.on_click(lambda _: self._ask(END_PROCEDURE))
        self._procedures = gui.add_html('')

    def report_procedure(self, axis: str, sentence: str, failed: bool) -> None:
        """Show step or result of a procedure of an axis."""
        self._outcomes[axis] = sentence, failed
        newest_last = [self._outcomes[known] for known in sorted(self._outcomes, reverse=True)]
        self._procedures.content = readout.answers(newest_last)

    def _add_faults(self) -> None:
        gui = self._gui
        self._kind = gui.add_dropdown('fault', tuple(KINDS))
        self._target = gui.add_dropdown('at', self._drives)
        self._value = gui.add_number('value', 0.0, step=0.001)
        self._lasts = gui.add_number(
            'lasts s', FAULT_S, min=0.0, max=1e5, step=0.1, hint='0: until it is cleared'
        )
        self._cycles = gui.add_number('cycles', 2, min=1, max=1000, step=1)
        self._kind.on_update(lambda _: self._show_kind())
        gui.add_button('Inject the fault', icon='bolt', color='orange').on_click(lambda _: self._inject())
        gui.add_button('End injected faults').on_click(
            lambda _: self._ask('inject', json.dumps({'fault': 'clear'}))
        )
        self._show_kind()

    def use(self, drives: Sequence[str]) -> None:
        """Set the drives of the robot."""
        self._drives = tuple(drives)
        self._axis.options = self._drives
        self._show_kind()

    def _show_kind(self) -> None:
        """Show the fields of the selected fault."""
        kind = KINDS[self._kind.value]
        nodes = tuple(dict.fromkeys((*NODES, *self._drives)))
        choices = {'axis': self._drives, 'node': nodes}.get(str(kind.target), ())
        self._target.visible = bool(choices)
        if choices and tuple(self._target.options) != choices:
            self._target.options = choices
        self._value.visible = bool(kind.value)
        self._value.label = kind.value or 'value'
        self._value.hint = f'{kind.low:g} to {kind.high:g}'
        self._cycles.visible = bool(kind.telegram)
        self._lasts.visible = not kind.telegram and not kind.once

    def _inject(self) -> None:
        kind = KINDS[self._kind.value]
        fault: dict[str, Any] = {'fault': self._kind.value}
        if str(kind.target):
            fault[str(kind.target)] = self._target.value
        if kind.value:
            whole = float(self._value.value).is_integer()
            fault[kind.value] = int(self._value.value) if whole else self._value.value
        if kind.telegram:
            fault['cycles'] = int(self._cycles.value)
        elif not kind.once and self._lasts.value:
            fault['for_s'] = self._lasts.value
        self._ask('inject', json.dumps(fault))

    # replies ----------------------------------------------------------------------------------------------------------

    def report(self, sentence: str, refused: bool) -> None:
        """Show the reply to a command."""
        with self._lock:
            self._replies = [*self._replies[1 - ANSWERS :], (sentence, refused)]
            self._answers.content = readout.answers(self._replies)

    def show_override(self) -> None:
        """Set the slider to the robot's override with the next facts."""
        self._override_shown = math.nan

    def show(self, facts: Facts) -> None:
        """Update the slider and the inputs of an available robot."""
        if facts.state:
            self._inputs.show(facts.inputs)
        if facts.state and facts.override != self._override_shown:
            self._override_shown = facts.override
            self._override.value = min(max(round(100.0 * facts.override), OVERRIDE_MIN), OVERRIDE_MAX)
