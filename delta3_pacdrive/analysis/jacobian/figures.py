"""Figures 11.25 to 11.45: a trajectory, its joint motion through the Jacobian, and the deviations."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.analysis.figure_style import (
    AXIS_COLOURS,
    COLOURS,
    DASHED,
    MUTED,
    dress,
    panel_title,
    report_figure,
)
from delta3_pacdrive.analysis.jacobian.deviation import THRESHOLD, Deviation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from delta3_pacdrive.analysis.jacobian.study import Trial
    from delta3_pacdrive.analysis.provenance import Provenance
    from delta3_pacdrive.analysis.report_folder import Drawings
    from delta3_pacdrive.numerics.types import Floats

EXACT: dict[str, Any] = {'color': COLOURS[0], 'linewidth': 2.6, 'solid_capstyle': 'round'}
INEXACT: dict[str, Any] = {'color': COLOURS[1], 'linewidth': 1.3}
RECORDED: dict[str, Any] = {'color': '#111111', 'linewidth': 0.9, 'linestyle': DASHED}
LIMIT: dict[str, Any] = {'color': MUTED, 'linewidth': 0.8, 'linestyle': DASHED}
TITLE_IN = 0.29  # height of a title
JOINTS = (1, 2, 3)
ROOM = 1.12  # of a panel beyond what is drawn
FAR = 30.0  # percent; what goes farther is drawn on a logarithmic axis
TICKS = (-10000, -1000, -100, -30, -10, 0, 10, 30, 100, 1000, 10000)  # of that
SPAN_MIN = 1e-3  # percent


def by_name(trial: Trial, errors: str, provenance: Provenance) -> Drawings:
    """Return the functions that make the seven figures of a trajectory, by file name.

    ``errors`` names the inexact lengths. The files of the thesis' experiments bear its numbers.
    """
    found: dict[str, Any] = {
        'arm_angles': partial(arm_angles, trial, provenance),
        'tcp_position': partial(tcp_position, trial, provenance),
        'joint_velocities': partial(joint_velocities, trial, errors, provenance),
        'velocity_deviation': partial(velocity_deviation, trial, errors, provenance),
        **{
            f'acceleration_of_joint_{joint}': partial(joint_acceleration, trial, joint, errors, provenance)
            for joint in JOINTS
        },
    }
    thesis = trial.motion.thesis
    if thesis is None:
        return {f'{trial.motion.name}_{name}.png': make for name, make in found.items()}
    return {
        f'figure_11_{thesis.first_figure + n}_{name}.png': make
        for n, (name, make) in enumerate(found.items())
    }


def legend_under_title(figure: Figure, handles: list[Any], labels: list[str], columns: int) -> None:
    """Put a legend between the title and the panels, with room that the title reserves."""
    rows = -(-len(labels) // columns)
    height = figure.get_size_inches()[1]
    figure.suptitle(figure.get_suptitle() + '\n' * rows, fontsize=12)
    figure.legend(handles, labels, ncols=columns, frameon=False, fontsize=9, loc='upper center',
                  bbox_to_anchor=(0.5, 1.0 - TITLE_IN / height), borderpad=0.0, borderaxespad=0.0,
                  labelspacing=0.3)  # fmt: skip


def arm_angles(trial: Trial, provenance: Provenance) -> Figure:
    """Arm angles [deg] of the trajectory (Fig. 11.25, 11.32, 11.39)."""
    labels = [rf'$\theta_{joint}$ (deg)' for joint in JOINTS]
    return _three_panels(trial, 'arm angles', labels, np.degrees(trial.motion.theta), provenance)


def tcp_position(trial: Trial, provenance: Provenance) -> Figure:
    """TCP coordinates [mm] of the trajectory (Fig. 11.26, 11.33, 11.40)."""
    labels = [f'{axis} (mm)' for axis in 'xyz']
    return _three_panels(trial, 'TCP position', labels, 1e3 * trial.motion.tcp, provenance)


def joint_velocities(trial: Trial, errors: str, provenance: Provenance) -> Figure:
    """Joint velocities [deg/s], recorded and through the Jacobian (Fig. 11.27, 11.34, 11.41)."""
    figure = report_figure(_title(trial, 'joint velocities'), 7.0, provenance)
    panels = figure.subplots(3, 1, sharex=True)
    motion = trial.motion
    series = (trial.exact.velocity, trial.inexact.velocity, motion.thetadot)
    for i, axes in enumerate(panels):
        _curves(axes, motion.time_s, *(np.degrees(values[:, i]) for values in series))
        axes.set_ylabel(rf'$\dot\theta_{i + 1}$ (deg/s)')
    _finish(figure, panels, motion.time_s, errors)
    return figure


def velocity_deviation(trial: Trial, errors: str, provenance: Provenance) -> Figure:
    """Deviation of the joint velocities [%]: of the peak, and of the momentary value (Fig. 11.28, 11.35, 11.42)."""
    figure = report_figure(_title(trial, 'deviation of the joint velocities'), 7.0, provenance)
    grid = figure.subplots(3, 2, sharex=True, sharey='col')
    motion = trial.motion
    exact = Deviation.of(trial.exact.velocity, motion.thetadot)
    wrong = Deviation.of(trial.inexact.velocity, motion.thetadot)
    pairs = ((exact.of_peak, wrong.of_peak), (exact.momentary, wrong.momentary))
    for column, (near, far) in enumerate(pairs):
        panels = grid[:, column]
        for i, axes in enumerate(panels):
            axes.plot(motion.time_s, near[:, i], **EXACT, label='exact lengths')
            axes.plot(motion.time_s, far[:, i], **INEXACT, label=errors)
            axes.set_ylabel(f'joint {i + 1} (%)')
            if motion.thesis is not None:
                for sign in (-1.0, 1.0):
                    axes.axhline(
                        sign * motion.thesis.deviation_percent, **LIMIT, label='largest in the thesis'
                    )
        least = motion.thesis.deviation_percent if motion.thesis else SPAN_MIN
        _scale(panels[0], float(np.nanmax(np.abs([near, far]), initial=least)))
    panel_title(grid[0, 0], 'share of the peak')
    panel_title(grid[0, 1], f'share of the momentary value, above {100 * THRESHOLD:g} % of peak')
    for axes in grid.flat:
        dress(axes)
        axes.set_xlim(motion.time_s[0], motion.time_s[-1])
    for axes in grid[-1]:
        axes.set_xlabel('time (s)')
    figure.align_ylabels()
    handles, labels = grid[0, 0].get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    legend_under_title(figure, list(unique.values()), list(unique), 3)
    return figure


def joint_acceleration(trial: Trial, joint: int, errors: str, provenance: Provenance) -> Figure:
    """Acceleration of a joint [deg/s^2], recorded and through the Jacobian, and its deviation (Fig. 11.29 to 11.31)."""
    figure = report_figure(_title(trial, f'acceleration of joint {joint}'), 5.6, provenance)
    panels = figure.subplots(2, 1, sharex=True, height_ratios=(1.8, 1))
    motion, i = trial.motion, joint - 1
    series = (trial.exact.acceleration, trial.inexact.acceleration, motion.thetaddot)
    _curves(panels[0], motion.time_s, *(np.degrees(values[:, i]) for values in series))
    panels[0].set_ylabel(rf'$\ddot\theta_{joint}$ (deg/s$^2$)')
    for values, style in zip(series[:2], (EXACT, INEXACT), strict=True):
        panels[1].plot(motion.time_s, Deviation.of(values, motion.thetaddot).of_peak[:, i], **style)
    panels[1].set_ylabel('deviation\n(% of the peak)')
    _finish(figure, panels, motion.time_s, errors)
    return figure


def _scale(axes: Axes, span: float) -> None:
    """Let an axis show percentages up to ``span`` on both sides, large ones by their logarithm."""
    if span > FAR:
        axes.set_yscale('asinh', linear_width=FAR / 3.0)
        ticks = [tick for tick in TICKS if abs(tick) < 2.0 * span]
        axes.set_yticks(ticks, [str(tick) for tick in ticks])
        span *= 2.0 / ROOM
    axes.set_ylim(-ROOM * span, ROOM * span)


def _three_panels(
    trial: Trial, what: str, labels: list[str], values: Floats, provenance: Provenance
) -> Figure:
    figure = report_figure(_title(trial, what), 6.0, provenance)
    panels = figure.subplots(3, 1, sharex=True)
    for axes, label, column, colour in zip(panels, labels, values.T, AXIS_COLOURS, strict=True):
        axes.plot(trial.motion.time_s, column, color=colour, linewidth=1.6)
        axes.set_ylabel(label)
        low, high = axes.get_ylim()
        if high - low < 1.0:  # rounding errors of a value that does not move
            axes.set_ylim((low + high) / 2.0 - 0.5, (low + high) / 2.0 + 0.5)
        axes.ticklabel_format(useOffset=False)
    _finish(figure, panels, trial.motion.time_s)
    return figure


def _curves(axes: Axes, time_s: Floats, exact: Floats, inexact: Floats, recorded: Floats) -> None:
    axes.plot(time_s, exact, **EXACT)
    axes.plot(time_s, inexact, **INEXACT)
    axes.plot(time_s, recorded, **RECORDED)


def _finish(figure: Figure, panels: Any, time_s: Floats, errors: str = '') -> None:
    """Give panels above one another their time axis and, if lengths are in error, the legend of the curves."""
    from matplotlib.lines import Line2D

    for axes in panels:
        dress(axes)
        axes.set_xlim(time_s[0], time_s[-1])
    panels[-1].set_xlabel('time (s)')
    figure.align_ylabels()
    if errors:
        names = ('through J, exact lengths', f'through J, {errors}', 'recorded')
        handles = [Line2D([], [], **style) for style in (EXACT, INEXACT, RECORDED)]
        legend_under_title(figure, handles, list(names), 3)


def _title(trial: Trial, what: str) -> str:
    name = trial.motion.name.capitalize() if trial.motion.thesis else trial.motion.name
    return f'{name}: {what}'
