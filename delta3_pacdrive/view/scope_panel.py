"""The oscilloscope panel of the page: input fields of the setting, and charts with every sample of a record.

It does not communicate with the drives.
"""

import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from delta3_pacdrive.errors import ParameterError, shown
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.acquisition import (
    ON_FAULT,
    ON_PROGRAM,
    RATE_MAX_HZ,
    RATE_MIN_HZ,
    Edge,
    Mode,
    Record,
    Setting,
    setting,
)
from delta3_pacdrive.recording.tables.quantities import ONE
from delta3_pacdrive.robot.drive.channels import CHANNELS
from delta3_pacdrive.view import readout
from delta3_pacdrive.view.plots import HEIGHT, chart
from delta3_pacdrive.view.values import UiCommand

VALUES_MAX = 200_000  # limit for a browser: 1.5 s of eight channels at 16 kHz
USUAL = 'axis1.current_reference, axis1.current'
DURATION_S, DURATION_MAX_S, LEVEL_MAX = 0.5, 1e5, 1e12
NO_TRIGGER, ON_CHANNEL = 'none', 'channel'
TRIGGERS = (NO_TRIGGER, ON_PROGRAM, ON_FAULT, ON_CHANNEL)
USUAL_EDGE = 'usual'  # rising, or change for an IDN
FIELDS = ('channels', 'mode', 'trigger', 'source', 'level', 'edge', 'pre_trigger_s', 'duration_s', 'rate_hz')
WIDTH, TALLEST = 560, 3  # of the panel [pixels], and charts visible without scrolling
BEGIN, END = 'scope', 'end_scope'  # actions


def _number(given: Any, name: str, low: float, high: float, unit: str) -> float:
    """Validate a number of a command; raises ParameterError."""
    is_number = isinstance(given, int | float) and not isinstance(given, bool)
    if not is_number or not low <= given <= high:
        value = f'{given:g}' if is_number else shown(str(given)[:40])
        raise ParameterError(f'{name} is {value}, but must be between {low:g} and {high:g} {unit}'.rstrip())
    return float(given)


def setting_of(text: str, parameters: Parameters) -> Setting:
    """Return the oscilloscope setting of a command.

    Raises
    ------
    ParameterError
        It is invalid, or exceeds what a page can draw.

    """
    try:
        document = json.loads(text)
        given = {name: document[name] for name in FIELDS}
    except (ValueError, RecursionError, KeyError, TypeError):
        raise ParameterError(f'{shown(text[:80])} is not a valid oscilloscope setting') from None
    channels = [part.strip() for part in str(given['channels']).split(',') if part.strip()]
    if not channels:
        raise ParameterError('an oscilloscope needs a channel, such as axis1.current')
    rate_hz = _number(given['rate_hz'], 'the rate', RATE_MIN_HZ, RATE_MAX_HZ, 'Hz')
    trigger = str(given['trigger'])
    edge = str(given['edge'])
    is_triggered = trigger != NO_TRIGGER
    if trigger == ON_CHANNEL:
        trigger = str(given['source']).strip()
        if not trigger:
            raise ParameterError('a trigger on a channel needs that channel, such as axis1.current')
    if edge != USUAL_EDGE and edge not in list(Edge):
        raise ParameterError(f'{shown(edge)} is not a valid edge: {", ".join(Edge)}')
    if given['mode'] not in list(Mode):
        raise ParameterError(f'{shown(str(given["mode"]))} is not a valid mode: {", ".join(Mode)}')
    found = setting(
        parameters,
        channels,
        rate_hz=rate_hz,
        duration_s=_number(given['duration_s'], 'the duration', 0.0, DURATION_MAX_S, 's'),
        trigger=trigger if is_triggered else None,
        level=_number(given['level'], 'the level', -LEVEL_MAX, LEVEL_MAX, ''),
        edge=None if edge == USUAL_EDGE else edge,
        pre_trigger_s=_number(given['pre_trigger_s'], 'the pre-trigger', 0.0, DURATION_MAX_S, 's')
        if is_triggered
        else 0.0,
        mode=given['mode'],
    )
    values = found.samples * len(channels)
    if values > VALUES_MAX:
        raise ParameterError(
            f'a page draws at most {VALUES_MAX} values, {found.samples} samples of {len(channels)} channels are '
            f'{values}: choose a shorter time, a lower rate or fewer channels; delta3 scope records up to a minute'
        )
    return found


def caption(record: Record) -> str:
    """Return a caption of a record."""
    rate_hz = 1.0 / record.setting.sample_time_s
    channels = 'a channel' if len(record.names) == 1 else f'{len(record.names)} channels'
    size = f'{len(record.values)} samples of {channels} at {rate_hz:g} Hz'
    if record.trigger is None:
        return f'{size}, from bus time {record.time_s[0]:.6f} s on'
    sentence = record.setting.trigger.sentence if record.setting.trigger else ''
    return f'{size}; 0 is bus time {record.time_s[record.trigger]:.6f} s: {sentence}'


class ScopePanel:
    """The input fields in the main panel, and a panel of charts that is created with the first record."""

    def __init__(self, gui: Any, send: Callable[[UiCommand], None], drives: Sequence[str]) -> None:
        self._gui = gui
        self._shown: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())  # names and units of the charts
        self._charts: list[tuple[list[int], Any]] = []  # columns and handle of each chart
        self._panel: Any = None
        self._tab: Any = None
        self._about: Any = None
        with gui.add_folder('Oscilloscope', expand_by_default=False):
            self._channels = gui.add_text(
                'channels',
                USUAL,
                hint='up to eight, as delta3 scope list names them; an IDN such as axis1.S-0-0189',
            )
            self._drive = gui.add_dropdown('drive', tuple(drives))
            self._name = gui.add_dropdown('channel', tuple(CHANNELS))
            self._what = gui.add_html('')
            gui.add_button('Add this channel', icon='plus').on_click(lambda _: self._add())
            self._mode = gui.add_dropdown(
                'mode', tuple(Mode), hint='one record; one after each trigger; the newest samples'
            )
            self._trigger = gui.add_dropdown('trigger', TRIGGERS, hint='program: the start of one')
            self._source = gui.add_text('of channel', 'axis1.current', visible=False)
            self._level = gui.add_number('level', 0.0, step=0.001, visible=False)
            self._edge = gui.add_dropdown('edge', (USUAL_EDGE, *Edge), visible=False)
            self._before = gui.add_number('pre-trigger s', 0.0, min=0.0, step=0.001, visible=False)
            self._duration = gui.add_number('duration s', DURATION_S, min=0.0, step=0.001)
            self._rate = gui.add_number('rate Hz', RATE_MAX_HZ, min=RATE_MIN_HZ, max=RATE_MAX_HZ, step=1.0)
            gui.add_button('Record', icon='activity').on_click(
                lambda _: send(UiCommand(BEGIN, self._setting_text()))
            )
            gui.add_button('End recording', icon='player-stop').on_click(lambda _: send(UiCommand(END)))
            self._reply = gui.add_html('')
        self._name.on_update(lambda _: self._explain())
        for handle in (self._trigger, self._mode):
            handle.on_update(lambda _: self._show_fields())
        self._explain()

    def use(self, drives: Sequence[str]) -> None:
        """Set the drives of the robot."""
        if tuple(drives) != tuple(self._drive.options):
            self._drive.options = tuple(drives)

    def _explain(self) -> None:
        if (channel := CHANNELS.get(self._name.value)) is not None:  # a browser may send any value
            unit = '' if channel.unit == ONE else f' [{channel.unit}]'
            self._what.content = readout.answers([(f'{channel.what}{unit}', False)])

    def _add(self) -> None:
        names = [part.strip() for part in self._channels.value.split(',') if part.strip()]
        self._channels.value = ', '.join([*names, f'{self._drive.value}.{self._name.value}'])

    def _show_fields(self) -> None:
        """Show the fields of the selected trigger; rolling mode has none."""
        rolling = self._mode.value == Mode.ROLLING
        self._trigger.visible = not rolling
        for handle in (self._source, self._level, self._edge):
            handle.visible = not rolling and self._trigger.value == ON_CHANNEL
        self._before.visible = not rolling and self._trigger.value != NO_TRIGGER

    def _setting_text(self) -> str:
        rolling = self._mode.value == Mode.ROLLING
        values = (
            self._channels.value,
            self._mode.value,
            NO_TRIGGER if rolling else self._trigger.value,
            self._source.value,
            self._level.value,
            self._edge.value,
            self._before.value,
            self._duration.value,
            self._rate.value,
        )
        return json.dumps(dict(zip(FIELDS, values, strict=True)))

    # replies and records ----------------------------------------------------------------------------------------------

    def report(self, sentence: str, refused: bool = False) -> None:
        """Show the state, or the reason of a rejection."""
        self._reply.content = readout.answers([(sentence, refused)])

    def show(self, record: Record) -> None:
        """Draw every sample of a record, one chart per unit; time is relative to the trigger, if there is one."""
        if (record.names, record.units) != self._shown:
            self._rebuild(record.names, record.units)
        origin = record.first + (record.trigger or 0)
        numbers = np.arange(record.first, record.first + len(record.values)) - origin
        time_ms = 1e3 * record.setting.sample_time_s * numbers
        for columns, handle in self._charts:
            handle.data = (time_ms, *(np.ascontiguousarray(record.values[:, n]) for n in columns))
        self._about.content = readout.answers([(caption(record), False)])

    def _rebuild(self, names: Sequence[str], units: Sequence[str]) -> None:
        """Create the charts of these channels."""
        if self._panel is None:
            self._panel = self._gui.add_panel()
            self._tab = self._panel.add_tab('Oscilloscope')
            with self._tab:
                self._about = self._gui.add_html('')
        for _, handle in self._charts:
            handle.remove()
        self._charts = []
        with self._tab:
            for unit in dict.fromkeys(units):
                columns = [n for n, of in enumerate(units) if of == unit]
                title = '' if unit == ONE else unit
                handle = chart(self._gui, [names[n] for n in columns], title, 't [ms]')
                self._charts.append((columns, handle))
        self._shown = (tuple(names), tuple(units))
        rows = min(len(self._charts), TALLEST)
        self._panel.float(x=10, y=10, width=WIDTH, height=70 + rows * (HEIGHT + 40))
