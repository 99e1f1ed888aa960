"""The thesis' figures of one run (11.1 to 11.8): TCP path, arm angles, speeds, accelerations, currents and errors.

Every figure is a function from a trace to a ``matplotlib.figure.Figure``; pyplot and its global state stay out.
Times count from the start of the program, the first one of a recording with several; without one they are bus time.
Arm values are motor values over the gear ratio (4.17).
"""

from __future__ import annotations

import math
import textwrap
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.analysis.figure_style import AXIS_COLOURS, NORM_COLOUR, dress, empty_figure
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording.signals import SIGNALS, TRUE_SIGNALS
from delta3_pacdrive.recording.trace import Trace

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D
    from numpy.typing import NDArray

    from delta3_pacdrive.analysis.report_folder import ReportFolder
    from delta3_pacdrive.numerics.types import Floats

BEFORE_S = 0.05  # shown of the idle cycles before the program
AFTER_S = 0.10  # and of the rest after its end
REST_S = 10.0  # between two programs of a recording that are not shown together
ZOOM_S = 0.15  # length of Fig. 11.4
SLOPE_S = 2.0e-3  # half window of the straight line whose slope is the actual acceleration
FLAT = 0.4  # least extent of an axis of the TCP path, of the longest: a path in a plane keeps a visible depth
VIEW_DEG = (24.0, -62.0)  # from where it is seen: elevation, azimuth

TITLE_LENGTH = 80
ACTUAL: dict[str, Any] = {'linewidth': 1.8, 'solid_capstyle': 'round'}
COMMAND: dict[str, Any] = {'linewidth': 0.9, 'linestyle': (0, (4, 2)), 'color': '#111111'}


def draw(trace: Trace, folder: ReportFolder, signals: Sequence[str] | None = None) -> list[Path]:
    """Write the figures of a run as PNG files.

    Parameters
    ----------
    trace
        A simulation or a recording; ``meta`` holds ``gear_ratio`` and ``cycle_time_s`` and may hold ``program``,
        ``start_cycle``, ``end_cycle`` and, from ``windowed``, ``window_s``.
    folder
        Where to write. Files of the same names are overwritten.
    signals
        What is drawn, by the names in ``SIGNALS``; None: the thesis' figures.

    Returns
    -------
    list of Path
        The files, in the order of the thesis' figures; then signals that are in none of these.

    Raises
    ------
    TraceError
        A signal or the gear ratio is missing, or no cycle of the program is recorded.
    FigureError
        A file cannot be written.

    """
    drawings = {name: partial(make, trace) for name, make in FIGURES.items() if shows(name, signals)}
    for signal in signals or ():
        if signal not in SUBJECTS.values():
            drawings[f'{signal}.png'] = partial(signal_panels, trace, signal)
    return folder.figures(drawings)


def shows(figure: str, signals: Sequence[str] | None) -> bool:
    """Whether a figure is drawn where these signals are asked for."""
    return signals is None or SUBJECTS[figure] in signals


def windowed(trace: Trace, from_s: float | None, to_s: float | None) -> Trace:
    """Return the trace with another part of it to be shown: times [s] from the start of the program, None as usual."""
    return Trace(trace.time_s, trace.signals, trace.meta | {'window_s': [from_s, to_s]})


def shown_cycles(trace: Trace) -> tuple[int, int]:
    """First and last bus cycle of the part that is shown.

    That is what ``windowed`` asks for, else the program: from shortly before its start until shortly after its end,
    or after the last motion of a recording that does not know the end. Without a start it is everything.

    Raises
    ------
    TraceError
        The trace does not tell its cycle time, or holds no cycle of that part.

    """
    period = _positive(trace, 'cycle_time_s')
    cycles = np.rint(trace.time_s / period).astype(np.int64)
    if not len(cycles):
        raise TraceError('the recording holds no cycle')
    start, end = trace.meta.get('start_cycle'), trace.meta.get('end_cycle')
    first, last = int(cycles[0]), int(cycles[-1])
    if start is not None:
        first = start - round(BEFORE_S / period)
        end = _end_of_motion(trace, cycles, start) if end is None else end
    if end is not None:
        last = end + round(AFTER_S / period)
    from_s, to_s = trace.meta.get('window_s', (None, None))
    if from_s is not None:
        first = (start or 0) + math.ceil(from_s / period - 1e-6)
        # a window behind the program shows what is there
        last = last if last > first else int(cycles[-1])
    if to_s is not None:
        last = (start or 0) + math.floor(to_s / period + 1e-6)
    if not ((cycles >= first) & (cycles <= last)).any():
        low, high = ((edge - (start or 0)) * period for edge in cycles[[0, -1]])
        wanted = 'of the program' if from_s is None and to_s is None else 'of that window'
        raise TraceError(f'the recording holds no cycle {wanted}: it goes from {low:g} to {high:g} s')
    return first, last


def _end_of_motion(trace: Trace, cycles: NDArray[np.int64], start: int) -> int:
    """Return the last cycle in which the command moves, at least the start; without commands the last one.

    A program that starts after a rest of more than ``REST_S`` is another run, which would make spikes of this one.
    """
    if 'motor_command' not in trace.signals:
        return int(cycles[-1])
    moving = (np.diff(trace['motor_command'], axis=0) != 0.0).any(axis=1) & (np.diff(cycles) == 1)
    ends = cycles[1:][moving]
    for later in trace.meta.get('starts', ()):
        before = ends[ends < later]
        if later > start and len(before) and later - before[-1] > REST_S / _positive(trace, 'cycle_time_s'):
            ends = before
            break
    return max(start, int(ends[-1])) if len(ends) else int(cycles[-1])


def program_part(trace: Trace) -> Trace:
    """Cut out the cycles that are shown, with times [s] from the start of the program.

    Cycles that the recording lacks are filled with nan: lines have gaps there, and differences are over one cycle.

    Raises
    ------
    TraceError
        The trace does not tell its cycle time, or holds no cycle of that part.

    """
    period = _positive(trace, 'cycle_time_s')
    cycles = np.rint(trace.time_s / period).astype(np.int64)
    start = trace.meta.get('start_cycle')
    first, last = shown_cycles(trace)
    keep = (cycles >= first) & (cycles <= last)
    cycles = cycles[keep]
    rows = cycles - cycles[0]
    numbers = np.arange(rows[-1] + 1)
    signals = {}
    for name, values in trace.signals.items():
        signals[name] = np.full((len(numbers), 3), np.nan)
        signals[name][rows] = values[keep]
    return Trace((numbers + (cycles[0] - (start or 0))) * period, signals, trace.meta)


def tcp_path_3d(trace: Trace) -> Figure:
    """TCP path in space [mm], commanded and actual, all three axes to the same scale (Fig. 11.1)."""
    run = program_part(trace)
    command, actual = 1e3 * run['tcp_command'], 1e3 * run['tcp_actual']
    known = actual[np.isfinite(actual).all(axis=1)]
    figure = _figure(trace, 'TCP path', 5.6)
    figure.set_layout_engine('none')  # it reckons with a cube
    axes: Axes3D = figure.add_axes((-0.02, 0.09, 1.0, 0.86), projection='3d', computed_zorder=False)
    whole: dict[str, Any] = {'clip_on': False}  # a wide box is larger than the square of its axes
    axes.plot(*actual.T, color=AXIS_COLOURS[0], label='actual', **ACTUAL | whole | {'linewidth': 3.0})
    axes.plot(*command.T, label='command', **COMMAND, **whole)
    ends = whole | {'linestyle': 'none', 'markeredgewidth': 1.6, 'markerfacecolor': 'none'}
    axes.plot(*known[:1].T, 'o', color=AXIS_COLOURS[2], markersize=11, label='start', **ends)
    axes.plot(*known[-1:].T, 'x', color=AXIS_COLOURS[1], markersize=7, label='end', **ends)

    points = np.concatenate([known, command[np.isfinite(command).all(axis=1)]])
    frame_path(axes, points)
    figure.legend(loc='lower center', ncols=4, frameon=False, fontsize=9)
    return figure


def arm_angles(trace: Trace) -> Figure:
    """Arm angles [deg], commanded and actual (Fig. 11.2)."""
    run = program_part(trace)
    actual, command = _arm_deg(run, run['motor_position']), _arm_deg(run, run['motor_command'])
    figure, panels = _panels(trace, 'Arm angles', [rf'$\theta_{i}$ (deg)' for i in (1, 2, 3)])
    _plot_pairs(panels, run.time_s, actual, command)
    _least_span(panels, 1.0)
    _pair_legend(figure)
    return figure


def arm_velocities(trace: Trace) -> Figure:
    """Arm speeds [deg/s], commanded and actual, with the 0.15 s around the fastest change (Fig. 11.3, 11.4)."""
    run = program_part(trace)
    actual = _arm_deg(run, run['motor_speed'])
    command = central_difference(_arm_deg(run, run['motor_command']), _positive(run, 'cycle_time_s'))
    figure = _figure(trace, 'Arm speeds', 6.0)
    grid = figure.subplots(3, 2, sharex='col', width_ratios=(2, 1), squeeze=False)
    labels = [rf'$\dot\theta_{i}$ (deg/s)' for i in (1, 2, 3)]
    overview, zoom = list(grid[:, 0]), list(grid[:, 1])
    _dress(trace, overview, labels)
    _dress(trace, zoom, ['', '', ''])
    figure.align_ylabels()
    begin = busiest(run.time_s, command)
    shown = (run.time_s >= begin) & (run.time_s <= begin + ZOOM_S)
    _plot_pairs(overview, run.time_s, actual, command)
    _plot_pairs(zoom, run.time_s[shown], actual[shown], command[shown])
    for axes in overview:
        axes.axvspan(begin, begin + ZOOM_S, color='#EEEEEE', zorder=0)
    for axes in zoom:
        axes.set_facecolor('#F6F6F6')
        axes.locator_params(axis='x', nbins=4)
    _least_span(overview, 1.0)
    _least_span(zoom, 1.0)
    _pair_legend(figure)
    return figure


def arm_accelerations(trace: Trace) -> Figure:
    """Arm accelerations [deg/s^2]: slope of the actual speed, second difference of the command (Fig. 11.5)."""
    run = program_part(trace)
    period = _positive(run, 'cycle_time_s')
    actual = slope(_arm_deg(run, run['motor_speed']), period)
    command = second_difference(_arm_deg(run, run['motor_command']), period)
    figure, panels = _panels(
        trace, 'Arm accelerations', [rf'$\ddot\theta_{i}$ (deg/s$^2$)' for i in (1, 2, 3)], True
    )
    _plot_pairs(panels, run.time_s, actual, command)
    _least_span(panels, 10.0)
    _pair_legend(figure)
    return figure


def currents(trace: Trace) -> Figure:
    """Motor currents I_eff [A rms] (Fig. 11.6)."""
    run = program_part(trace)
    labels = [rf'$I_{{\mathrm{{eff}},{i}}}$ (A)' for i in (1, 2, 3)]
    figure, panels = _panels(trace, 'Motor currents', labels, True)
    _plot_single(panels, run.time_s, run['current'])
    _least_span(panels, 0.1)
    return figure


def tcp_components(trace: Trace) -> Figure:
    """TCP coordinates x, y, z [mm], commanded and actual (Fig. 11.7)."""
    run = program_part(trace)
    figure, panels = _panels(trace, 'TCP position', [f'{name} (mm)' for name in 'xyz'])
    _plot_pairs(panels, run.time_s, 1e3 * run['tcp_actual'], 1e3 * run['tcp_command'])
    _least_span(panels, 1.0)
    _pair_legend(figure)
    return figure


def tcp_error_norm(trace: Trace) -> Figure:
    """Norm of the TCP error [mm], with the set-point delay removed and as it is (Fig. 11.8)."""
    run = program_part(trace)
    aligned = 1e3 * np.linalg.norm(run['tcp_error'], axis=1)
    raw = 1e3 * np.linalg.norm(run['tcp_command'] - run['tcp_actual'], axis=1)
    figure, panels = _panels(trace, 'Norm of the TCP error', ['error (mm)', 'error (mm)'], height_in=5.0)
    titles = ('set-point delay removed', 'raw difference of command and actual position')
    for axes, values, title in zip(panels, (aligned, raw), titles, strict=True):
        axes.plot(run.time_s, values, color=NORM_COLOUR, **(ACTUAL | {'linewidth': 1.3}))
        axes.set_title(title, loc='left', fontsize=9, color='#444444')
        axes.set_ylim(0.0, max(1.08 * float(np.nanmax(values, initial=0.0)), 1e-3))
    return figure


def following_error(trace: Trace) -> Figure:
    """Following error of the arms [deg], dead time removed (7.3)."""
    run = program_part(trace)
    figure, panels = _panels(
        trace, 'Following error of the arms', [rf'$e_{i}$ (deg)' for i in (1, 2, 3)], True
    )
    _plot_single(panels, run.time_s, np.degrees(run['following_error']))
    _least_span(panels, 1e-3)
    return figure


def signal_panels(trace: Trace, signal: str) -> Figure:
    """One signal as it is, in SI units: a panel for each of its columns."""
    run = program_part(trace)
    unit, meaning = (SIGNALS | TRUE_SIGNALS)[signal]
    names = 'xyz' if signal.startswith('tcp_') else '123'
    figure, panels = _panels(trace, meaning, [f'{name} ({unit})' for name in names])
    _plot_single(panels, run.time_s, run[signal])
    return figure


FIGURES = {
    'tcp_path_3d.png': tcp_path_3d,
    'arm_angles.png': arm_angles,
    'arm_velocities.png': arm_velocities,
    'arm_accelerations.png': arm_accelerations,
    'currents.png': currents,
    'tcp_components.png': tcp_components,
    'tcp_error_norm.png': tcp_error_norm,
    'following_error.png': following_error,
}
# the signal that asks for a figure
SUBJECTS = {
    'tcp_path_3d.png': 'tcp_actual',
    'arm_angles.png': 'motor_position',
    'arm_velocities.png': 'motor_speed',
    'arm_accelerations.png': 'motor_speed',
    'currents.png': 'current',
    'tcp_components.png': 'tcp_actual',
    'tcp_error_norm.png': 'tcp_error',
    'following_error.png': 'following_error',
}


def _positive(trace: Trace, key: str) -> float:
    value = trace.meta.get(key)
    if not isinstance(value, int | float) or not 0.0 < value < math.inf:
        raise TraceError(f'the recording does not tell its {key}')
    return float(value)


def _arm_deg(trace: Trace, motor_values: Floats) -> Floats:
    return np.degrees(motor_values / _positive(trace, 'gear_ratio'))


def central_difference(values: Floats, period_s: float) -> Floats:
    """Change over two cycles; nan at both ends."""
    out = np.full_like(values, np.nan)
    out[1:-1] = (values[2:] - values[:-2]) / (2.0 * period_s)
    return out


def second_difference(values: Floats, period_s: float) -> Floats:
    """Second difference of three cycles; nan at both ends."""
    out = np.full_like(values, np.nan)
    out[1:-1] = (values[2:] - 2.0 * values[1:-1] + values[:-2]) / period_s**2
    return out


def slope(values: Floats, period_s: float) -> Floats:
    """Slope of the least-squares line through the cycles within ``SLOPE_S``; nan where the window is not full."""
    half = max(1, round(SLOPE_S / period_s))
    offsets = np.arange(-half, half + 1)
    weights = offsets / (offsets @ offsets) / period_s
    out = np.full_like(values, np.nan)
    if len(values) >= len(weights):
        for i in range(values.shape[1]):
            out[half:-half, i] = np.correlate(values[:, i], weights, 'valid')
    return out


def busiest(time_s: Floats, speeds: Floats) -> float:
    """Return where the window of ``ZOOM_S`` begins in whose middle the speeds change fastest."""
    change = np.abs(np.gradient(speeds, axis=0)).max(axis=1) if len(speeds) > 1 else np.zeros(len(speeds))
    middle = time_s[np.argmax(np.nan_to_num(change))]
    begin = min(middle - ZOOM_S / 2.0, time_s[-1] - ZOOM_S)
    return round(float(max(begin, time_s[0])), 2)


def frame_path(axes: Axes3D, points: Floats) -> None:
    """Give space around the points [mm] of a path, shape (n, 3): all three axes to the same scale, with labels."""
    from matplotlib.ticker import MaxNLocator

    low, high = points.min(axis=0), points.max(axis=0)
    longest = max(float((high - low).max()), 1.0)
    spans = np.maximum(1.1 * (high - low), FLAT * longest)
    _fit_box(axes, spans)
    for name, axis, middle, span in zip('xyz', _three_axes(axes), (low + high) / 2.0, spans, strict=True):
        getattr(axes, f'set_{name}lim')(middle - span / 2.0, middle + span / 2.0)
        axis.set_major_locator(MaxNLocator(max(3, round(6 * span / longest))))
        axis.set_label_text(f'{name} (mm)')
    axes.ticklabel_format(useOffset=False)


def _fit_box(axes: Axes3D, spans: Floats) -> None:
    """Draw a box of these extents as large as the figure permits, labels at the same distance in every shape."""
    elevation, azimuth = np.radians(VIEW_DEG)
    across = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    up = np.array([*(-np.sin(elevation) * np.array([np.cos(azimuth), np.sin(azimuth)])), np.cos(elevation)])
    sides = spans / np.linalg.norm(spans)
    sides *= min(1.2 / (np.abs(across) @ sides), 0.78 / (np.abs(up) @ sides))
    axes.set_proj_type('ortho')
    axes.view_init(*VIEW_DEG)
    axes.set_box_aspect(spans.tolist(), zoom=float(np.linalg.norm(sides)))
    # matplotlib counts the distances of labels, beyond 8 and 21, in parts of the sides that they are moved along
    moved = ((0, -1, -1), (1, 0, -1), (1, 1, 0))
    distances = ((7.0, 21.0), (9.0, 27.0), (14.0, 32.0))
    for axis, along, (tick, label) in zip(_three_axes(axes), moved, distances, strict=True):
        part = float(np.hypot(across @ (along * sides), up @ (along * sides)))
        axis.set_tick_params(labelsize=8, pad=tick / part - 8.0)
        axis.labelpad = label / part - 21.0


def _three_axes(axes: Axes3D) -> tuple[Any, Any, Any]:
    """Return the axes of x, y and z."""
    return axes.xaxis, axes.yaxis, axes.zaxis


def _figure(trace: Trace, what: str, height_in: float) -> Figure:
    figure = empty_figure(height_in)
    program = trace.meta.get('program')
    title = f'{what}: {program}' if program else what
    figure.suptitle(textwrap.shorten(title, TITLE_LENGTH, placeholder=' ...'), fontsize=12, parse_math=False)
    return figure


def _panels(
    trace: Trace, what: str, labels: Sequence[str], same_scale: bool = False, height_in: float = 6.0
) -> tuple[Figure, list[Axes]]:
    figure = _figure(trace, what, height_in)
    panels = list(figure.subplots(len(labels), 1, sharex=True, sharey=same_scale, squeeze=False)[:, 0])
    _dress(trace, panels, labels)
    figure.align_ylabels()
    return figure, panels


def _dress(trace: Trace, panels: Sequence[Axes], labels: Sequence[str]) -> None:
    """Give panels that stand above one another their labels, grid and common time axis."""
    for axes, label in zip(panels, labels, strict=True):
        axes.set_ylabel(label)
        dress(axes)
        axes.margins(x=0.0)
        axes.ticklabel_format(axis='both', useOffset=False)
    known = trace.meta.get('start_cycle') is not None
    panels[-1].set_xlabel('time from program start (s)' if known else 'bus time (s)')


def _plot_pairs(panels: Sequence[Axes], time_s: Floats, actual: Floats, command: Floats) -> None:
    _plot_single(panels, time_s, actual)
    for axes, values in zip(panels, command.T, strict=True):
        axes.plot(time_s, values, label='command', **COMMAND)


def _plot_single(panels: Sequence[Axes], time_s: Floats, actual: Floats) -> None:
    for axes, values, colour in zip(panels, actual.T, AXIS_COLOURS, strict=True):
        axes.plot(time_s, values, label='actual', color=colour, **ACTUAL)


def _least_span(panels: Sequence[Axes], span: float) -> None:
    """Keep an axis from magnifying rounding errors of a value that does not move."""
    for axes in panels:
        low, high = axes.get_ylim()
        if high - low < span:
            middle = (low + high) / 2.0
            axes.set_ylim(middle - span / 2.0, middle + span / 2.0)


def _pair_legend(figure: Figure) -> None:
    """One legend below all panels: it covers no data."""
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
