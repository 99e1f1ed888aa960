"""Figures of a calibration: measured poses, residuals before and after, estimated corrections."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.studies.calibration.study import Poses, Result
from delta3_pacdrive.studies.framework.figure_style import (
    AXIS_COLOURS,
    MUTED,
    NORM_COLOUR,
    dress,
    legend_above,
    titled_figure,
)
from delta3_pacdrive.studies.framework.report_folder import Drawings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MM = 1e3
NAMES = ('poses.png', 'left.png', 'corrections.png')
UNITS = {'m': ('mm', MM), 'rad': ('deg', float(np.degrees(1.0)))}


def by_name(result: Result, robot: Parameters) -> Drawings:
    """Return the drawing function of each figure by file name."""
    draw = (
        partial(measured_poses, result, robot),
        partial(residuals, result),
        partial(corrections, result),
    )
    return dict(zip(NAMES, draw, strict=True))


def plan_of(poses: Poses, robot: Parameters) -> Figure:
    """Poses to be measured, from above and from the side; dashed: the workspace."""
    return _places(poses.points_m, poses.checks, robot, 'Poses to be measured')


def measured_poses(result: Result, robot: Parameters) -> Figure:
    """Measured poses, from above and from the side; dashed: the workspace."""
    return _places(result.points_m, result.measurements.checks, robot, 'Measured poses')


def _places(points_m: Floats, checks: NDArray[np.bool_], robot: Parameters, title: str) -> Figure:
    from matplotlib.patches import Circle, Rectangle

    k, radius = robot.kinematics, 0.5 * MM * robot.kinematics.workspace_diameter_m
    low, high = MM * k.workspace_bottom_m, MM * k.workspace_top_m
    figure = titled_figure(title, 4.6)
    above, side = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
    style: dict[str, Any] = {'fill': False, 'linestyle': (0, (5, 3)), 'edgecolor': MUTED}
    above.add_patch(Circle((0.0, 0.0), radius, **style))
    side.add_patch(Rectangle((-radius, low), 2.0 * radius, high - low, **style))
    for rows, mark, label in ((~checks, 'o', 'to estimate from'), (checks, 'x', 'to check with')):
        colour = AXIS_COLOURS[0] if mark == 'o' else AXIS_COLOURS[1]
        x, y, z = MM * points_m[rows].T
        above.plot(x, y, mark, color=colour, markersize=5, label=label)
        side.plot(x, z, mark, color=colour, markersize=5)
    above.set_aspect('equal')
    dress(above, xlabel='x [mm]', ylabel='y [mm]', xlim=(-1.1 * radius, 1.1 * radius))
    dress(side, xlabel='x [mm]', ylabel='z [mm]', xlim=(-1.1 * radius, 1.1 * radius))
    legend_above(above)
    return figure


def residuals(result: Result) -> Figure:
    """Residual of each measurement before and after the calibration; crosses were not used for the estimation."""
    figure = titled_figure('Measurement less robot, before and after', 4.2)
    axes = figure.subplots()
    checks, number = result.measurements.checks, np.arange(1, len(result.points_m) + 1)
    for values, colour, word in zip(
        result.residuals_m, (MUTED, NORM_COLOUR), ('before', 'after'), strict=True
    ):
        shown = np.maximum(MM * values, 1e-4)
        axes.plot(number[~checks], shown[~checks], 'o', color=colour, label=f'{word}, used')
        if checks.any():
            axes.plot(
                number[checks], shown[checks], 'x', color=colour, markersize=8, label=f'{word}, not used'
            )
    axes.set_yscale('log')
    dress(axes, xlabel='measurement', ylabel='residual [mm]')
    legend_above(axes)
    return figure


def corrections(result: Result) -> Figure:
    """Estimated corrections of each arm with 95 % intervals; diamonds: true values of a simulated robot."""
    symbols = list(dict.fromkeys(one.symbol for one in result.estimates))
    figure = titled_figure('Corrections of the arms', 3.6, 2.4 + 1.9 * len(symbols))
    panels = figure.subplots(1, len(symbols), squeeze=False)[0]
    truth = result.truth or (np.nan,) * len(result.estimates)
    for axes, symbol in zip(panels, symbols, strict=True):
        for one, true in zip(result.estimates, truth, strict=True):
            if one.symbol != symbol:
                continue
            unit, scale = UNITS[one.unit]
            axes.errorbar(
                one.arm, scale * one.value, scale * one.half_width, fmt='o', capsize=4,
                color=AXIS_COLOURS[one.arm - 1] if one.is_identified else MUTED,
            )  # fmt: skip
            axes.plot(one.arm, scale * true, 'D', markersize=5, markerfacecolor='none', color='black')
        greek = {'alpha': r'$\alpha$', 'theta': r'$\theta$'}.get(symbol, f'${symbol}$')
        dress(axes, f'{greek} [{unit}]', xlabel='arm', xlim=(0.5, 3.5), xticks=(1, 2, 3))
    return figure
