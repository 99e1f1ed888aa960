"""Figures of the explanation: deviation per millimetre of each length, and how it grows with the condition of J."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from delta3_pacdrive.analysis.figure_style import COLOURS, DASHED, MUTED, dress, panel_title, report_figure
from delta3_pacdrive.analysis.jacobian import condition
from delta3_pacdrive.analysis.jacobian.figures import legend_under_title
from delta3_pacdrive.analysis.jacobian.mapping import LENGTHS, Pose

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from delta3_pacdrive.analysis.jacobian.condition import Sweep
    from delta3_pacdrive.analysis.jacobian.study import Results, Trial
    from delta3_pacdrive.analysis.provenance import Provenance
    from delta3_pacdrive.analysis.report_folder import Drawings
    from delta3_pacdrive.parameters import Kinematics

BINS = 4  # per decade of the condition
APPROACH = (0.0, 1.0, 0.0)  # along y, square to arm 1: the ray that is shown by itself
MEANINGS = {
    Pose.RECORDED: 'angles and position recorded',
    Pose.FORWARD: 'angles recorded, position from them',
    Pose.INVERSE: 'position recorded, angles from it',
}


def by_name(found: Results, kinematics: Kinematics, provenance: Provenance) -> Drawings:
    """Return what draws each figure, by file name."""
    return {
        'sensitivities.png': partial(sensitivities, found.trials, provenance),
        'deviation_over_condition.png': partial(
            deviation_over_condition, found.sweep, kinematics, provenance
        ),
    }


def sensitivities(trials: list[Trial], provenance: Provenance) -> Figure:
    """Largest deviation of joint velocities and accelerations per millimetre of each length, as bars."""
    figure = report_figure('Deviation by 1 mm of error of one length', 6.0, provenance)
    grid = figure.subplots(2, len(Pose), sharex=True, sharey='row')
    width = 0.8 / len(trials)
    places = np.arange(len(LENGTHS))
    for column, pose in enumerate(Pose):
        for n, trial in enumerate(trials):
            own = [row for row in trial.sensitivities if row.pose is pose]
            middle = places - 0.4 + (n + 0.5) * width
            for axes, shares in (
                (grid[0, column], [row.velocity for row in own]),
                (grid[1, column], [row.acceleration for row in own]),
            ):
                axes.bar(middle, [share.of_peak for share in shares], 0.9 * width,
                         color=COLOURS[n % len(COLOURS)], label=trial.motion.name)  # fmt: skip
        panel_title(grid[0, column], MEANINGS[pose])
        if pose is Pose.RECORDED:
            for axes in grid[:, column]:
                axes.text(list(LENGTHS).index('l_B'), 0.02, 'does not enter', rotation=90, fontsize=8,
                          ha='center', va='bottom', color='#555555', transform=axes.get_xaxis_transform())  # fmt: skip
        grid[1, column].set_xticks(places, [f'${symbol}$' for symbol in LENGTHS])
    grid[0, 0].set_ylabel('velocity (% of the peak)')
    grid[1, 0].set_ylabel('acceleration (% of the peak)')
    for axes in grid.flat:
        dress(axes)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    legend_under_title(figure, handles, labels, min(len(trials), 4))
    return figure


def deviation_over_condition(found: Sweep, kinematics: Kinematics, provenance: Provenance) -> Figure:
    """Deviation in the worst direction over the condition of J, and along one ray to the limit of the workspace."""
    figure = report_figure('Deviation of the joint velocities, each length 1 mm off', 5.4, provenance)
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
    panel_title(left, 'poses on rays to singularities: median, 5 to 95 %')
    left.set_xlabel('condition number of J')
    left.set_ylabel('deviation in the worst direction (%)')
    other = right.twinx()
    other.plot(1e3 * ray.gap_m, ray.condition, color=MUTED, linewidth=1.2, linestyle=DASHED)
    other.set_yscale('log')
    other.set_ylabel('condition number of J (dashed)', color='#555555')
    other.spines['top'].set_visible(False)
    right.invert_xaxis()
    right.set_xlabel('distance to the singularity (mm)')
    panel_title(right, f'along y at z = {ray.tcp[0, 2]:.3g} m')
    for axes in (left, right):
        axes.set_xscale('log')
        axes.set_yscale('log')
        dress(axes)
    handles, labels = left.get_legend_handles_labels()
    legend_under_title(figure, handles, labels, 1)
    return figure


def _powers(of_kind: dict[str, float]) -> str:
    names = {'serial': 'serial', 'parallel': 'parallel singularities'}
    found = [
        f'cond(J)$^{{{of_kind[kind]:.2f}}}$ towards {name}' for kind, name in names.items() if kind in of_kind
    ]
    return ', '.join(found)
