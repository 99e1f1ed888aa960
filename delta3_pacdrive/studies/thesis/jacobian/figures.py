"""Figures 11.25 to 11.45: trajectories, joint motion through the Jacobian, deviations, and the causes of deviations.

Causes are errors of the lengths, per millimetre, and the condition of J.
"""

from __future__ import annotations

from functools import partial
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Kinematics
from delta3_pacdrive.studies.framework.figure_style import (
    AXIS_COLOURS,
    COLOURS,
    DASHED,
    MUTED,
    column_of_panels,
    dress,
    keep_span,
    legend_above,
    panel_title,
    titled_figure,
)
from delta3_pacdrive.studies.framework.report_folder import Drawings
from delta3_pacdrive.studies.thesis.jacobian import condition
from delta3_pacdrive.studies.thesis.jacobian.deviation import THRESHOLD, Deviation
from delta3_pacdrive.studies.thesis.jacobian.mapping import LENGTHS, Pose
from delta3_pacdrive.studies.thesis.jacobian.study import Results, Trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EXACT: dict[str, Any] = {'color': COLOURS[0], 'linewidth': 2.6, 'solid_capstyle': 'round'}
INEXACT: dict[str, Any] = {'color': COLOURS[1], 'linewidth': 1.3}
RECORDED: dict[str, Any] = {'color': '#111111', 'linewidth': 0.9, 'linestyle': DASHED}
LIMIT: dict[str, Any] = {'color': MUTED, 'linewidth': 0.8, 'linestyle': DASHED}
TITLE_IN = 0.29  # height of a title
JOINTS = (1, 2, 3)
ROOM = 1.12  # range of a panel relative to its data
FAR = 30.0  # percent; larger ranges have a logarithmic axis
TICKS = (-10000, -1000, -100, -30, -10, 0, 10, 30, 100, 1000, 10000)  # of a logarithmic axis
SPAN_MIN = 1e-3  # percent
BINS = 4  # per decade of the condition
APPROACH = (0.0, 1.0, 0.0)  # direction of the single ray: along y, perpendicular to arm 1
IMPLAUSIBLE = (
    'Errors of centimetres are implausible. A misprinted formula or an omitted term\n'
    'explains far more of the deviations of accelerations.'
)
COURSES = COLOURS[2:5]  # of the other causes
CAUSE_WIDTH = 13  # characters in a line of a cause
MEANINGS = {
    Pose.RECORDED: 'angles and position recorded',
    Pose.FORWARD: 'angles recorded, position from them',
    Pose.INVERSE: 'position recorded, angles from it',
}


def by_name(found: Results, errors: str, kinematics: Kinematics, note: str = '') -> Drawings:
    """Return the drawing functions by file name; ``errors`` names the inexact lengths, ``note`` is a remark on them."""
    drawings: dict[str, Any] = {}
    for trial in found.trials:
        drawings |= of_trial(trial, errors, note)
    return drawings | {
        'causes.png': partial(causes, found.trials, errors),
        'sensitivities.png': partial(sensitivities, found.trials),
        'deviation_over_condition.png': partial(deviation_over_condition, found.sweep, kinematics),
    }


def of_trial(trial: Trial, errors: str, note: str = '') -> Drawings:
    """Return the seven figures of a trajectory; files of the experiments of the thesis have its figure numbers."""
    found: dict[str, Any] = {
        'arm_angles': partial(arm_angles, trial),
        'tcp_position': partial(tcp_position, trial),
        'joint_velocities': partial(joint_velocities, trial, errors),
        'velocity_deviation': partial(velocity_deviation, trial, errors, note),
    }
    for joint in JOINTS:
        found[f'acceleration_of_joint_{joint}'] = partial(joint_acceleration, trial, joint, errors, note)
    thesis = trial.motion.thesis
    if thesis is None:
        return {f'{trial.motion.name}_{name}.png': make for name, make in found.items()}
    return {
        f'figure_11_{thesis.first_figure + n}_{name}.png': make
        for n, (name, make) in enumerate(found.items())
    }


def _legend_under_title(figure: Figure, columns: int, handles: list[Any], labels: list[str]) -> None:
    """Put a legend between the title and the panels, in space reserved by empty lines of the title."""
    rows = -(-len(labels) // columns)
    height = figure.get_size_inches()[1]
    figure.suptitle(figure.get_suptitle() + '\n' * rows, fontsize=12)
    figure.legend(handles, labels, ncols=columns, frameon=False, fontsize=9, loc='upper center',
                  bbox_to_anchor=(0.5, 1.0 - TITLE_IN / height), borderpad=0.0, borderaxespad=0.0,
                  labelspacing=0.3)  # fmt: skip


def arm_angles(trial: Trial) -> Figure:
    """Draw the arm angles [deg] of the trajectory (Fig. 11.25, 11.32, 11.39)."""
    labels = [rf'$\theta_{joint}$ [deg]' for joint in JOINTS]
    return _three_panels(_title(trial, 'arm angles', 0), trial, labels, np.degrees(trial.motion.theta))


def tcp_position(trial: Trial) -> Figure:
    """Draw the TCP coordinates [mm] of the trajectory (Fig. 11.26, 11.33, 11.40)."""
    labels = [f'{axis} [mm]' for axis in 'xyz']
    return _three_panels(_title(trial, 'TCP position', 1), trial, labels, 1e3 * trial.motion.tcp)


def joint_velocities(trial: Trial, errors: str) -> Figure:
    """Draw the joint velocities [deg/s], recorded and through the Jacobian (Fig. 11.27, 11.34, 11.41)."""
    figure = titled_figure(_title(trial, 'joint velocities', 2), 7.0)
    panels = column_of_panels(figure, [rf'$\dot\theta_{joint}$ [deg/s]' for joint in JOINTS], 'time [s]')
    motion = trial.motion
    series = (trial.exact.velocity, trial.inexact.velocity, motion.thetadot)
    for i, axes in enumerate(panels):
        _curves(axes, motion.time_s, *(np.degrees(values[:, i]) for values in series))
    _legend_of_curves(figure, errors)
    return figure


def velocity_deviation(trial: Trial, errors: str, note: str = '') -> Figure:
    """Draw the deviation of the joint velocities [%], of peak and momentary value (Fig. 11.28, 11.35, 11.42)."""
    figure = titled_figure(_title(trial, 'deviation of the joint velocities', 3), 7.0)
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
            if column == 0:
                _draw_courses(axes, trial, 'velocity', i)
            axes.set_ylabel(f'joint {i + 1} [%]')
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
        dress(axes, xlim=motion.time_s[[0, -1]])
    grid[-1, 0].set_xlabel(f'time [s]\n{note}' if note else 'time [s]')
    grid[-1, 1].set_xlabel('time [s]')
    figure.align_ylabels()
    handles, labels = grid[0, 0].get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    _legend_under_title(figure, 3, list(unique.values()), list(unique))
    return figure


def joint_acceleration(trial: Trial, joint: int, errors: str, note: str = '') -> Figure:
    """Draw a joint acceleration [deg/s^2], recorded and through J, and its deviation (Fig. 11.29 to 11.31)."""
    figure = titled_figure(_title(trial, f'acceleration of joint {joint}', 3 + joint), 6.4)
    labels = (rf'$\ddot\theta_{joint}$ [deg/s$^2$]', 'deviation\n[% of the peak]')
    what = f'time [s]\n{note}' if note else 'time [s]'
    panels = column_of_panels(figure, labels, what, height_ratios=(1.4, 1))
    motion, i = trial.motion, joint - 1
    series = (trial.exact.acceleration, trial.inexact.acceleration, motion.thetaddot)
    _curves(panels[0], motion.time_s, *(np.degrees(values[:, i]) for values in series))
    for values, style in zip(series[:2], (EXACT, INEXACT), strict=True):
        panels[1].plot(motion.time_s, Deviation.of(values, motion.thetaddot).of_peak[:, i], **style)
    _draw_courses(panels[1], trial, 'acceleration', i)
    if trial.courses:
        legend_above(panels[1])
    _legend_of_curves(figure, errors)
    return figure


def causes(trials: list[Trial], errors: str) -> Figure:
    """Draw the largest deviations of joint velocities and accelerations by inexact lengths and by each other cause."""
    figure = titled_figure('What makes calculated and recorded joint motion differ', 5.0)
    row = figure.subplots(1, 2, width_ratios=(1, 2))
    width = 0.8 / len(trials)
    for axes, quantity in zip(row, ('velocity', 'acceleration'), strict=True):
        names = [errors, *(cause.name for cause in trials[0].causes if cause.quantity == quantity)]
        positions = np.arange(len(names))
        for n, trial in enumerate(trials):
            recorded = trial.motion.thetadot if quantity == 'velocity' else trial.motion.thetaddot
            lengths = Deviation.of(getattr(trial.inexact, quantity), recorded).summary()['of_peak']['max']
            others = [cause.of_peak for cause in trial.causes if cause.quantity == quantity]
            axes.bar(positions - 0.4 + (n + 0.5) * width, [lengths, *others], 0.9 * width,
                     color=COLOURS[n % len(COLOURS)], label=trial.motion.name)  # fmt: skip
        axes.set_xticks(positions, [fill(name, CAUSE_WIDTH) for name in names], fontsize=8)
        axes.set_ylabel(f'{quantity} [% of the peak]')
        dress(axes)
    row[1].set_xlabel(IMPLAUSIBLE, fontsize=8)
    _legend_under_title(figure, min(len(trials), 4), *row[0].get_legend_handles_labels())
    return figure


def sensitivities(trials: list[Trial]) -> Figure:
    """Draw the largest deviations of joint velocities and accelerations per millimetre of each length as bars."""
    figure = titled_figure('Deviation by 1 mm of error of one length', 6.0)
    grid = figure.subplots(2, len(Pose), sharex=True, sharey='row')
    width = 0.8 / len(trials)
    positions = np.arange(len(LENGTHS))
    for column, pose in enumerate(Pose):
        for n, trial in enumerate(trials):
            own = [row for row in trial.sensitivities if row.pose is pose]
            middle = positions - 0.4 + (n + 0.5) * width
            for axes, quantity in zip(grid[:, column], ('velocity', 'acceleration'), strict=True):
                axes.bar(middle, [getattr(row, quantity).of_peak for row in own], 0.9 * width,
                         color=COLOURS[n % len(COLOURS)], label=trial.motion.name)  # fmt: skip
        panel_title(grid[0, column], MEANINGS[pose])
        if pose is Pose.RECORDED:
            for axes in grid[:, column]:
                axes.text(list(LENGTHS).index('l_B'), 0.02, 'does not enter', rotation=90, fontsize=8,
                          ha='center', va='bottom', color='#555555', transform=axes.get_xaxis_transform())  # fmt: skip
        grid[1, column].set_xticks(positions, [f'${symbol}$' for symbol in LENGTHS])
    grid[0, 0].set_ylabel('velocity [% of the peak]')
    grid[1, 0].set_ylabel('acceleration [% of the peak]')
    for axes in grid.flat:
        dress(axes)
    _legend_under_title(figure, min(len(trials), 4), *grid[0, 0].get_legend_handles_labels())
    return figure


def deviation_over_condition(found: condition.Sweep, kinematics: Kinematics) -> Figure:
    """Draw the deviation in the worst direction over the condition of J, and along one ray to a singularity."""
    figure = titled_figure('Deviation of the joint velocities, each length 1 mm off', 5.4)
    left, right = figure.subplots(1, 2, sharey=True)
    powers = condition.exponents(found)
    bins = condition.decades(found, BINS)
    middle = [np.sqrt(row['from'] * row['to']) for row in bins]
    ray = condition.along(
        np.array([[0.0, 0.0, 0.5 * (kinematics.workspace_top_m + kinematics.workspace_bottom_m)]]),
        np.array([APPROACH]),
        kinematics,
    )
    for pose, colour in zip(Pose, COLOURS, strict=False):
        low, median, high = ([row[pose.value][key] for row in bins] for key in ('p5', 'median', 'p95'))
        left.scatter(
            found.condition, found.total(pose), s=1.0, color=colour, alpha=0.08, linewidths=0, rasterized=True
        )
        left.fill_between(middle, low, high, color=colour, alpha=0.15, linewidth=0)
        left.plot(middle, median, color=colour, linewidth=1.8,
                  label=f'{MEANINGS[pose]}: {_powers(powers[pose.value])}')  # fmt: skip
        right.plot(1e3 * ray.gap_m, ray.total(pose), color=colour, linewidth=1.8)
    inside = condition.workspace(kinematics)['condition']
    left.axvspan(inside['min'], inside['max'], color='#E4E4E4', zorder=0)
    left.text(1.15 * inside['max'], 0.97, 'grey: inside\nthe workspace', fontsize=8, color='#555555', va='top',
              transform=left.get_xaxis_transform())  # fmt: skip
    dress(left, 'poses on rays to singularities: median, 5 to 95 %', xlabel='condition number of J',
          ylabel='deviation in the worst direction [%]', xscale='log', yscale='log')  # fmt: skip
    other = right.twinx()
    other.plot(1e3 * ray.gap_m, ray.condition, color=MUTED, linewidth=1.2, linestyle=DASHED)
    other.set_yscale('log')
    other.set_ylabel('condition number of J (dashed)', color='#555555')
    other.spines['top'].set_visible(False)
    right.invert_xaxis()
    dress(right, f'along y at z = {ray.tcp[0, 2]:.3g} m', xlabel='distance to the singularity [mm]',
          xscale='log', yscale='log')  # fmt: skip
    _legend_under_title(figure, 1, *left.get_legend_handles_labels())
    return figure


def _scale(axes: Axes, span: float) -> None:
    """Scale an axis for percentages up to ``span`` on both sides, logarithmically if it is large."""
    if span > FAR:
        axes.set_yscale('asinh', linear_width=FAR / 3.0)
        ticks = [tick for tick in TICKS if abs(tick) < 2.0 * span]
        axes.set_yticks(ticks, [str(tick) for tick in ticks])
        span *= 2.0 / ROOM
    axes.set_ylim(-ROOM * span, ROOM * span)


def _three_panels(title: str, trial: Trial, labels: list[str], values: Floats) -> Figure:
    figure = titled_figure(title, 6.0)
    panels = column_of_panels(figure, labels, 'time [s]')
    for axes, column, colour in zip(panels, values.T, AXIS_COLOURS, strict=True):
        axes.plot(trial.motion.time_s, column, color=colour, linewidth=1.6)
    keep_span(panels, 1.0)
    return figure


def _draw_courses(axes: Axes, trial: Trial, quantity: str, i: int) -> None:
    """Draw the deviation of a joint caused by each other cause on its own."""
    own = [course for course in trial.courses if course.quantity == quantity]
    for course, colour in zip(own, COURSES, strict=False):
        axes.plot(trial.motion.time_s, course.of_peak[:, i], color=colour, linewidth=1.0, label=course.name)


def _curves(axes: Axes, time_s: Floats, exact: Floats, inexact: Floats, recorded: Floats) -> None:
    axes.plot(time_s, exact, **EXACT)
    axes.plot(time_s, inexact, **INEXACT)
    axes.plot(time_s, recorded, **RECORDED)


def _legend_of_curves(figure: Figure, errors: str) -> None:
    from matplotlib.lines import Line2D

    names = ['through J, exact lengths', f'through J, {errors}', 'recorded']
    handles = [Line2D([], [], **style) for style in (EXACT, INEXACT, RECORDED)]
    _legend_under_title(figure, 3, handles, names)


def _title(trial: Trial, content: str, number: int) -> str:
    """Return the title of a figure by its number within its trajectory."""
    thesis, name = trial.motion.thesis, trial.motion.name
    return f'Figure 11.{thesis.first_figure + number}: {name}, {content}' if thesis else f'{name}: {content}'


def _powers(of_kind: dict[str, float]) -> str:
    names = {'serial': 'serial', 'parallel': 'parallel singularities'}
    found = [
        f'cond(J)$^{{{of_kind[kind]:.2f}}}$ towards {name}' for kind, name in names.items() if kind in of_kind
    ]
    return ', '.join(found)
