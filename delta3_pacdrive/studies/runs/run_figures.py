"""Figures 11.1 to 11.8 of the thesis for one run: TCP path, arm angles, speeds, accelerations, currents and errors.

Robots with a rotary axis have one more figure, the rotation of the tool, and so have those whose DC link has a model,
its voltage and powers. Each figure is a function from a trace to a
``matplotlib.figure.Figure``; pyplot and its global state are not used. Arm values are motor values divided by the gear
ratio (4.17).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.axes import ARMS, numbered
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.signals import CURRENT_SIGNALS, SUPPLY_SIGNALS, columns_of
from delta3_pacdrive.recording.tables import quantities
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.framework.figure_style import (
    AXIS_COLOURS,
    DASHED,
    NORM_COLOUR,
    WHOLE,
    column_of_panels,
    figure_of_program,
    finish_over_time,
    frame_path,
    keep_span,
    legend_above,
    panel_title,
    path_axes,
)
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.runs.derived_signals import added
from delta3_pacdrive.studies.runs.run_signals import (
    ZOOM_S,
    busiest,
    derivatives,
    positive,
    program_part,
    slope,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ACTUAL: dict[str, Any] = {'linewidth': 1.8, 'solid_capstyle': 'round'}
# samples of the AT, drawn on top
SAMPLE: dict[str, Any] = {
    'linestyle': 'none',
    'marker': '.',
    'markersize': 1.5,
    'color': '#111111',
    'zorder': 3.0,
}
HEIGHT_IN, PANEL_IN = 1.4, 1.0  # height of a figure without panels; of a panel in figures without three
TRUE: dict[str, Any] = {'linewidth': 1.0}
COMMAND: dict[str, Any] = {'linewidth': 0.9, 'linestyle': DASHED, 'color': '#111111'}


def draw(trace: Trace, folder: ReportFolder, signals: Sequence[str] | None = None) -> list[Path]:
    """Write the figures of a run as PNG files.

    Parameters
    ----------
    trace
        A simulation or a recording; ``meta`` contains ``gear_ratio`` and ``cycle_time_s``, optionally ``program``,
        ``start_cycle``, ``end_cycle`` and, from ``windowed``, ``window_s``.
    folder
        Destination; files of the same names are overwritten.
    signals
        Names of the signals to draw; None: the figures of the thesis, the rotation of each rotary axis, and the DC
        link.

    Returns
    -------
    list of Path
        The files in the order of the figures, then those of other signals.

    Raises
    ------
    TraceError
        A signal or the gear ratio is missing, or no cycle of the program is recorded.
    FigureError
        A file cannot be written.

    """
    trace = added(trace)
    drawings = {
        f'{make.__name__}.png': partial(make, trace)
        for make, subject in FIGURES.items()
        if (subject in signals if signals is not None else make not in OPTIONAL or subject in trace.signals)
    }
    for signal in signals or ():
        if signal not in FIGURES.values():
            drawings[f'{signal}.png'] = partial(signal_panels, trace, signal)
    return folder.figures(drawings)


def tcp_path_3d(trace: Trace) -> Figure:
    """TCP path in space [mm], commanded and actual, all three axes to the same scale (Fig. 11.1)."""
    run = program_part(trace)
    command, actual = 1e3 * run['tcp_command'], 1e3 * run['tcp_actual']
    known = actual[np.isfinite(actual).all(axis=1)]
    figure = figure_of_program('TCP path', run.meta.get('program'), 5.6)
    axes = path_axes(figure, 0.09, 0.86)
    axes.plot(*actual.T, color=AXIS_COLOURS[0], label='actual', **ACTUAL | WHOLE | {'linewidth': 3.0})
    axes.plot(*command.T, label='command', **COMMAND, **WHOLE)
    ends = WHOLE | {'linestyle': 'none', 'markeredgewidth': 1.6, 'markerfacecolor': 'none'}
    axes.plot(*known[:1].T, 'o', color=AXIS_COLOURS[2], markersize=11, label='start', **ends)
    axes.plot(*known[-1:].T, 'x', color=AXIS_COLOURS[1], markersize=7, label='end', **ends)
    points = np.concatenate([known, command[np.isfinite(command).all(axis=1)]])
    frame_path(axes, points)
    figure.legend(loc='lower center', ncols=4, frameon=False, fontsize=9)
    return figure


def arm_angles(trace: Trace) -> Figure:
    """Arm angles [deg], commanded and actual (Fig. 11.2)."""
    run = program_part(trace)
    actual, command = _arm_deg(run, 'motor_position'), _arm_deg(run, 'motor_command')
    return _three_panels(run, 'Arm angles', _axis_labels(r'$\theta_{}$ [deg]'), actual, command, least=1.0)


def arm_velocities(trace: Trace) -> Figure:
    """Arm speeds [deg/s], commanded and actual, with the 0.15 s around the fastest change (Fig. 11.3, 11.4)."""
    run = program_part(trace)
    actual = _arm_deg(run, 'motor_speed')
    command = derivatives(_arm_deg(run, 'motor_command'), positive(run, 'cycle_time_s'))[0]
    figure = figure_of_program('Arm speeds', run.meta.get('program'), 6.0)
    grid = figure.subplots(3, 2, sharex='col', width_ratios=(2, 1), squeeze=False)
    overview, zoom = grid.T
    finish_over_time(overview, _axis_labels(r'$\dot\theta_{}$ [deg/s]'), _time_label(run))
    finish_over_time(zoom, what=_time_label(run))
    begin = busiest(run.time_s, command)
    shown = (run.time_s >= begin) & (run.time_s <= begin + ZOOM_S)
    _plot(overview, run.time_s, actual, command)
    _plot(zoom, run.time_s[shown], actual[shown], command[shown])
    for axes in overview:
        axes.axvspan(begin, begin + ZOOM_S, color='#EEEEEE', zorder=0)
    for axes in zoom:
        axes.set_facecolor('#F6F6F6')
        axes.locator_params(axis='x', nbins=4)
    keep_span([*overview, *zoom], 1.0)
    _pair_legend(figure)
    return figure


def arm_accelerations(trace: Trace) -> Figure:
    """Arm accelerations [deg/s^2]: slope of the actual speed, second difference of the command (Fig. 11.5)."""
    run = program_part(trace)
    period = positive(run, 'cycle_time_s')
    actual = slope(_arm_deg(run, 'motor_speed'), period)
    command = derivatives(_arm_deg(run, 'motor_command'), period)[1]
    labels = _axis_labels(r'$\ddot\theta_{}$ [deg/s$^2$]')
    return _three_panels(
        run=run,
        what='Arm accelerations',
        labels=labels,
        actual=actual,
        command=command,
        least=10.0,
        same_scale=True,
    )


def currents(trace: Trace) -> Figure:
    """Motor currents I_eff [A rms]: all samples of the current loops, and the samples in the AT (Fig. 11.6)."""
    run = program_part(trace)
    labels = _axis_labels(r'$I_{{\mathrm{{eff}},{}}}$ [A]')
    if not {'current', *CURRENT_SIGNALS} <= run.signals.keys():
        return _three_panels(run, 'Motor currents', labels, run['current'], least=0.1, same_scale=True)
    figure, panels = _panels(run, 'Motor currents', labels, sharey=True)
    middle = run.time_s + 0.5 * positive(run, 'cycle_time_s')
    for i, (axes, colour) in enumerate(zip(panels, AXIS_COLOURS, strict=True)):
        axes.plot(run.time_s, run['current'][:, i], label='sample in the AT', **SAMPLE)
        low, high = run['current_min'][:, i], run['current_max'][:, i]
        axes.fill_between(middle, low, high, color=colour, alpha=0.35, linewidth=0.0, label='all samples')
        axes.plot(middle, run['current_mean'][:, i], label='their mean', color=colour, linewidth=1.0)
    keep_span(panels, 0.1)
    legend_above(panels[0])
    return figure


def tcp_components(trace: Trace) -> Figure:
    """TCP coordinates x, y, z [mm], commanded and actual (Fig. 11.7)."""
    run = program_part(trace)
    actual, command = 1e3 * run['tcp_actual'], 1e3 * run['tcp_command']
    return _three_panels(run, 'TCP position', [f'{name} [mm]' for name in 'xyz'], actual, command, least=1.0)


def tcp_error_norm(trace: Trace) -> Figure:
    """Norm of the TCP error [mm], with the set-point delay removed and unchanged (Fig. 11.8)."""
    run = program_part(trace)
    aligned = 1e3 * np.linalg.norm(run['tcp_error'], axis=1)
    raw = 1e3 * np.linalg.norm(run['tcp_command'] - run['tcp_actual'], axis=1)
    figure, panels = _panels(run, 'Norm of the TCP error', ['error [mm]'] * 2, 5.0)
    titles = ('set-point delay removed', 'raw difference of command and actual position')
    for axes, values, title in zip(panels, (aligned, raw), titles, strict=True):
        axes.plot(run.time_s, values, color=NORM_COLOUR, **(ACTUAL | {'linewidth': 1.3}))
        panel_title(axes, title, color='#444444')
        axes.set_ylim(0.0, max(1.08 * float(np.nanmax(values, initial=0.0)), 1e-3))
    return figure


def following_error(trace: Trace) -> Figure:
    """Following error of the arms [deg], dead time removed (7.3)."""
    run = program_part(trace)
    labels, errors = _axis_labels('$e_{}$ [deg]'), np.degrees(run['following_error'])
    return _three_panels(run, 'Following error of the arms', labels, errors, least=1e-3, same_scale=True)


def master(trace: Trace) -> Figure:
    """Virtual master of the command: distance, speed and acceleration along the path (Fig. 6.2, 6.3)."""
    run = program_part(trace)
    labels = ['distance [mm]', 'speed [m/s]', 'acceleration [m/s$^2$]']
    figure, panels = _panels(run, 'Virtual master', labels)
    values = run['master'] * [1e3, 1.0, 1.0]
    for axes, column in zip(panels, values.T, strict=True):
        axes.plot(run.time_s, column, color=NORM_COLOUR, **ACTUAL)
    keep_span(panels, 1e-2)
    return figure


def tcp_speed(trace: Trace) -> Figure:
    """Speed and acceleration of the TCP in space, commanded and actual: norms."""
    run = program_part(trace)
    command = derivatives(run['tcp_command'], positive(run, 'cycle_time_s'))
    labels = ['speed [m/s]', 'acceleration [m/s$^2$]']
    figure, panels = _panels(run, 'TCP speed and acceleration', labels, 5.2)
    for axes, actual, wanted in zip(
        panels, (run['tcp_velocity'], run['tcp_acceleration']), command, strict=True
    ):
        axes.plot(run.time_s, np.linalg.norm(actual, axis=1), label='actual', color=AXIS_COLOURS[0], **ACTUAL)
        axes.plot(run.time_s, np.linalg.norm(wanted, axis=1), label='command', **COMMAND)
    keep_span(panels, 1e-2)
    legend_above(panels[0])
    return figure


def turn(trace: Trace) -> Figure:
    """Rotation of the tool: commanded, measured and true angle, its error, and the current of its motor."""
    return _turn_of(trace, 0)


def turn_2(trace: Trace) -> Figure:
    """Rotation of the tool by the second rotary axis."""
    return _turn_of(trace, 1)


def _turn_of(trace: Trace, number: int) -> Figure:
    """Draw the rotation of rotary axis ``number``, from 0."""
    run = program_part(trace)
    title = 'Turn of the tool' + (f' by axis {ARMS + 1 + number}' if number else '')
    figure, panels = _panels(run, title, ['angle [deg]', 'error [deg]', 'current [A]'])
    curves = (
        (0, 'turn_position', 'actual', ACTUAL | {'color': AXIS_COLOURS[0]}),
        (0, 'turn_true', 'true', TRUE | {'color': AXIS_COLOURS[1]}),
        (0, 'turn_command', 'command', COMMAND),
        (1, 'turn_error', 'by the encoder, set-point delay removed', ACTUAL | {'color': NORM_COLOUR}),
        (2, 'turn_current', 'sample of the AT', ACTUAL | {'color': NORM_COLOUR}),
    )
    for panel, name, label, style in curves:
        signal = numbered(name, number)
        if signal in run.signals or name == 'turn_position':  # required: raises if it is missing
            values = run[signal][:, 0]
            panels[panel].plot(run.time_s, values if panel == 2 else np.degrees(values), label=label, **style)
    keep_span(panels, 1e-2)
    legend_above(panels[0])
    return figure


def supply(trace: Trace) -> Figure:
    """DC link: its voltage, the power from the mains, and the power in the brake resistor."""
    run = program_part(trace)
    labels = [
        f'{name} [{unit}]' for name, unit in (('voltage', 'V'), ('mains', 'W'), ('brake resistor', 'W'))
    ]
    figure, panels = _panels(run, 'DC link', labels)
    for axes, name in zip(panels, SUPPLY_SIGNALS, strict=True):
        axes.plot(run.time_s, run[name][:, 0], color=NORM_COLOUR, **ACTUAL)
    keep_span(panels, 1.0)
    return figure


def signal_panels(trace: Trace, signal: str) -> Figure:
    """One signal in SI units, with a panel for each of its columns."""
    run, meaning = program_part(trace), quantities.meaning_of(signal)
    named = columns_of(signal, quantities.unit_of(signal) or quantities.ONE)
    labels = [f'{name or signal} [{unit}]'.replace(f' [{quantities.ONE}]', '') for name, unit in named]
    if len(labels) == len(AXIS_COLOURS):
        return _three_panels(run, meaning, labels, run[signal])
    figure, panels = _panels(run, meaning, labels, HEIGHT_IN + PANEL_IN * len(labels))
    for axes, column in zip(panels, run[signal].T, strict=True):
        axes.plot(run.time_s, column, color=NORM_COLOUR, **ACTUAL)
    return figure


# all figures, each with the signal whose name selects it
FIGURES: dict[Callable[[Trace], Figure], str] = {
    tcp_path_3d: 'tcp_actual',
    arm_angles: 'motor_position',
    arm_velocities: 'motor_speed',
    arm_accelerations: 'motor_speed',
    currents: 'current',
    tcp_components: 'tcp_actual',
    tcp_error_norm: 'tcp_error',
    following_error: 'following_error',
    master: 'master',
    tcp_speed: 'tcp_velocity',
    turn: 'turn_position',
    turn_2: 'turn_position_2',
    supply: 'dc_link_voltage',
}
TURNS = turn, turn_2
OPTIONAL = (*TURNS, supply)  # drawn for runs with their signals


def _arm_deg(trace: Trace, signal: str) -> Floats:
    return np.degrees(trace[signal] / positive(trace, 'gear_ratio'))


def _axis_labels(label: str) -> list[str]:
    return [label.format(i) for i in (1, 2, 3)]


def _three_panels(
    run: Trace,
    what: str,
    labels: Sequence[str],
    actual: Floats,
    command: Floats | None = None,
    least: float = 0.0,
    same_scale: bool = False,
) -> Figure:
    """Draw three columns below one another; the range of each axis is at least ``least``."""
    figure, panels = _panels(run, what, labels, sharey=same_scale)
    _plot(panels, run.time_s, actual, command)
    keep_span(panels, least)
    if command is not None:
        _pair_legend(figure)
    return figure


def _panels(
    run: Trace, what: str, labels: Sequence[str], height_in: float = 6.0, **options: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure of a run with a column of panels over time."""
    figure = figure_of_program(what, run.meta.get('program'), height_in)
    return figure, column_of_panels(figure, labels, _time_label(run), **options)


def _time_label(run: Trace) -> str:
    return 'bus time [s]' if run.meta.get('start_cycle') is None else 'time from program start [s]'


def _plot(panels: Sequence[Axes], time_s: Floats, actual: Floats, command: Floats | None) -> None:
    for i, (axes, colour) in enumerate(zip(panels, AXIS_COLOURS, strict=True)):
        axes.plot(time_s, actual[:, i], label='actual', color=colour, **ACTUAL)
        if command is not None:
            axes.plot(time_s, command[:, i], label='command', **COMMAND)


def _pair_legend(figure: Figure) -> None:
    """Add a common legend below all panels, where it covers no data."""
    from matplotlib.legend_handler import HandlerTuple
    from matplotlib.lines import Line2D

    actual = tuple(Line2D([], [], color=colour, **ACTUAL) for colour in AXIS_COLOURS)
    handles: list[Any] = [actual, Line2D([], [], **COMMAND)]
    figure.legend(
        handles,
        ['actual', 'command'],
        handler_map={tuple: HandlerTuple(ndivide=None, pad=0.3)},
        handlelength=4.0,
        loc='outside lower center',
        ncols=2,
        frameon=False,
        fontsize=9,
    )
