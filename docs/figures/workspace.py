"""Where the robot reaches, and how evenly it moves there: condition of the Jacobian in two planes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import delta3_pacdrive as d3
from delta3_pacdrive.studies.framework.figure_style import empty_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from delta3_pacdrive.numerics.types import Floats

LEVELS = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 7.0, 10.0)
COUNT = 321
FRAME = {'color': '#111111', 'linewidth': 1.4, 'linestyle': (0, (5, 3)), 'fill': False}


def make() -> Figure:
    """Draw the condition in the plane of the bottom of the workspace, and in the plane of arm 1."""
    from matplotlib.patches import Circle, Rectangle

    robot = d3.load_parameters()
    lengths = robot.kinematics
    radius, top_m, bottom_m = (
        lengths.workspace_diameter_m / 2.0,
        lengths.workspace_top_m,
        lengths.workspace_bottom_m,
    )
    figure = empty_figure(4.0)
    left, right = figure.subplots(1, 2)
    x, y = np.meshgrid(np.linspace(-0.85, 0.85, COUNT), np.linspace(-0.85, 0.85, COUNT))
    _contours(left, x, y, np.stack([x, y, np.full_like(x, bottom_m)], axis=-1), robot)
    left.add_patch(Circle((0.0, 0.0), radius, **FRAME))
    for axes in (left, right):
        axes.set_xticks([-0.6, 0.0, 0.6])
    left.set(title=f'z = {bottom_m:g} m', xlabel='x [m]', ylabel='y [m]')
    x, z = np.meshgrid(np.linspace(-0.85, 0.85, COUNT), np.linspace(-1.25, -0.45, COUNT))
    filled = _contours(right, x, z, np.stack([x, np.zeros_like(x), z], axis=-1), robot)
    right.add_patch(Rectangle((-radius, bottom_m), 2.0 * radius, top_m - bottom_m, **FRAME))
    right.set(title='y = 0', xlabel='x [m]', ylabel='z [m]')
    figure.colorbar(filled, ax=[left, right], label='condition of the Jacobian', shrink=0.85)
    figure.suptitle(
        'White: out of reach, or beyond the limits of the arms. Dashed: the workspace.', fontsize=10
    )
    return figure


def _contours(axes: Axes, across: Floats, up: Floats, points: Floats, robot: d3.Parameters) -> object:
    """Fill the plane where all arms reach within their limits."""
    theta = d3.kinematics.inverse(points, robot, unreachable='nan')
    degrees, lengths = np.degrees(theta), robot.kinematics
    swing = np.degrees(np.abs(d3.kinematics.forearm_swing(points, robot)))
    with np.errstate(invalid='ignore'):
        legal = ((degrees >= lengths.arm_angle_min_deg) & (degrees <= lengths.arm_angle_max_deg)).all(axis=-1)
        legal &= (swing <= lengths.forearm_swing_max_deg).all(axis=-1)
    condition = np.full(across.shape, np.nan)
    condition[legal] = np.linalg.cond(d3.kinematics.jacobian(theta[legal], points[legal], robot))
    axes.set_aspect('equal')
    axes.tick_params(labelsize=9)
    return axes.contourf(across, up, condition, LEVELS, cmap='viridis_r', extend='max')
