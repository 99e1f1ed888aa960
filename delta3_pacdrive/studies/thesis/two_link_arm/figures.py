"""Figures of the two-link arm (chapter 3): both solutions, workspace, manipulability, speeds near singularities."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.framework.figure_style import AXIS_COLOURS, DASHED, dress, titled_figure
from delta3_pacdrive.studies.framework.report_folder import Drawings, Table
from delta3_pacdrive.studies.thesis.two_link_arm.kinematics import (
    Branch,
    TwoLinkArm,
    elbow,
    forward,
    inverse,
    jacobian,
    joint_speeds,
    manipulability,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SPEED_M_S = 1.0  # of the tool on its line
CLEARANCES = (0.2, 0.05, 0.005)  # of the lines from the singular circles, relative to the width of the ring
SAMPLES = 4001
CONDITION_MAX = 1e3  # largest condition number that is shown
NARROW_RAD = 0.5  # smaller angles are labelled outside

LOWER, UPPER, SINGULAR = AXIS_COLOURS[0], AXIS_COLOURS[2], AXIS_COLOURS[1]
TOOL = '#111111'
PALE = '#B0B0B0'
LINES = ('#9CC3E6', '#0072B2', '#111111')  # darker closer to the singularity
OUTER: dict[str, Any] = {'color': SINGULAR, 'linewidth': 1.6}
INNER: dict[str, Any] = {'color': SINGULAR, 'linewidth': 1.6, 'linestyle': DASHED}
BEST: dict[str, Any] = {'color': TOOL, 'linewidth': 1.4, 'linestyle': (0, (1, 1.5))}
LEGEND: dict[str, Any] = {'loc': 'outside lower center', 'frameon': False, 'fontsize': 9}


def by_name(arm: TwoLinkArm, p: ArrayLike) -> Drawings:
    """Return the drawing functions by file name; ``p`` [m] is the tool position of the first figure."""
    return {
        'arm_solutions.png': partial(solutions, arm, p),
        'arm_workspace.png': partial(workspace, arm),
        'arm_manipulability.png': partial(manipulability_over_theta_2, arm),
        'arm_joint_speeds.png': partial(joint_speeds_along_lines, arm),
    }


def table(arm: TwoLinkArm) -> Table:
    """Return the curves over theta_2."""
    names = ('theta_2 [rad]', '|det J| [m2]', 'condition of J [1]')
    return Table.of_columns('arm_manipulability.csv', dict(zip(names, _over_theta_2(arm).T, strict=True)))


def _over_theta_2(arm: TwoLinkArm) -> Floats:
    """Return angle [rad], manipulability [m^2] and condition number of J as columns."""
    theta_2 = np.linspace(-math.pi, math.pi, SAMPLES)
    theta = np.stack([np.zeros(SAMPLES), theta_2], axis=-1)
    return np.stack([theta_2, manipulability(theta, arm), np.linalg.cond(jacobian(theta, arm))], axis=-1)


def solutions(arm: TwoLinkArm, p: ArrayLike) -> Figure:
    """Draw the arm in both solutions for one point [m], each with the other one in grey (Fig. 3.4, 3.5).

    Raises
    ------
    UnreachableError
        The point is out of reach.

    """
    point = np.asarray(p, dtype=np.float64)
    poses = {branch: inverse(point, arm, branch) for branch in Branch}
    figure = titled_figure(f'Both solutions for the point ({point[0]:g}, {point[1]:g}) m', 5.2, 8.6)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    seen = np.concatenate([_joints(theta, arm) for theta in poses.values()])
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2.0
    half = 0.68 * max(*np.ptp(seen, axis=0), 0.7 * arm.outer_reach_m)
    for axes, (branch, theta), other in zip(panels, poses.items(), reversed(poses.values()), strict=True):
        axes.plot(
            *_joints(other, arm).T, 'o-', color=PALE, linewidth=2.0, markersize=5, label='other solution'
        )
        _draw_pose(axes, theta, arm, 0.15 * half)
        first, second = np.degrees(theta)
        axes.set_title(
            rf'{branch.value}: $\theta_1 = {first:z.1f}$°, $\theta_2 = {second:z.1f}$°', fontsize=10
        )
        dress(axes, xlabel='x [m]', aspect='equal', xlim=(middle[0] - half, middle[0] + half),
              ylim=(middle[1] - half, middle[1] + half))  # fmt: skip
    panels[0].set_ylabel('y [m]')
    figure.legend(*panels[0].get_legend_handles_labels(), ncols=4, **LEGEND)
    return figure


def workspace(arm: TwoLinkArm) -> Figure:
    """Draw the workspace, a ring between the singular circles, coloured by manipulability [m^2] (3.3)."""
    figure = titled_figure('Workspace, manipulability and singular circles', 6.4, 7.0)
    axes = figure.subplots()
    r = np.linspace(arm.inner_reach_m, arm.outer_reach_m, 201)
    azimuth = np.linspace(-math.pi, math.pi, 361)
    points = r[:, None, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    measure = manipulability(inverse(points, arm, Branch.ELBOW_DOWN), arm)
    colours = axes.pcolormesh(
        points[..., 0], points[..., 1], measure, cmap='viridis', shading='gouraud', rasterized=True
    )
    bar = figure.colorbar(colours, ax=axes, shrink=0.85)
    bar.set_label(r'manipulability $|\det\,J|$ [m$^2$]')
    _circles(axes, arm)
    right_angle = math.hypot(arm.lower_arm_length_m, arm.upper_arm_length_m)
    _circle(axes, right_angle, rf'largest: $\theta_2$ = ±90°, r = {right_angle:.3g} m', BEST)
    dress(axes, xlabel='x [m]', ylabel='y [m]', aspect='equal')
    axes.grid(visible=False)
    axes.use_sticky_edges = False
    axes.margins(0.04)
    figure.legend(ncols=2, **LEGEND)
    return figure


def manipulability_over_theta_2(arm: TwoLinkArm) -> Figure:
    """Draw manipulability [m^2] and condition number of J over theta_2 [deg] (3.3)."""
    figure = titled_figure('Manipulability and condition of the Jacobian', 5.6)
    panels = figure.subplots(2, 1, sharex=True)
    theta_2, product, condition = _over_theta_2(arm).T
    panels[0].plot(np.degrees(theta_2), product, color=LOWER, linewidth=1.8)
    panels[1].semilogy(np.degrees(theta_2), condition, color=LOWER, linewidth=1.8)
    dress(panels[0], ylabel=r'$|\det\,J|$ [m$^2$]',
          ylim=(0.0, 1.22 * arm.lower_arm_length_m * arm.upper_arm_length_m))  # fmt: skip
    dress(panels[1], ylabel='condition number of J', ylim=(1.0, CONDITION_MAX),
          xlabel=r'$\theta_2$ [deg]', xticks=range(-180, 181, 45))  # fmt: skip
    for axes in panels:
        axes.margins(x=0.0)
        for degrees, style in ((-180.0, INNER), (0.0, OUTER), (180.0, INNER)):
            axes.axvline(degrees, clip_on=False, zorder=1.5, **style)
    for degrees, branch in ((-90.0, Branch.ELBOW_UP), (90.0, Branch.ELBOW_DOWN)):
        panels[0].text(
            degrees, 0.96, branch.value, transform=panels[0].get_xaxis_transform(), ha='center', va='top'
        )
    figure.align_ylabels()
    from matplotlib.lines import Line2D

    figure.legend(
        [Line2D([], [], **OUTER), Line2D([], [], **INNER)],
        [r'singular, stretched: $\theta_2$ = 0°', r'singular, folded: $\theta_2$ = ±180°'],
        ncols=2,
        **LEGEND,
    )
    return figure


def joint_speeds_along_lines(arm: TwoLinkArm) -> Figure:
    """Draw joint speeds [deg/s] along straight lines close to both singular circles, at constant tool speed.

    Each line keeps its clearance from the outer circle at both ends and from the inner circle in the middle.
    """
    figure = titled_figure(f'Joint speeds on straight lines at {SPEED_M_S:g} m/s, elbow down', 6.0, 9.4)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.0, 1.2))
    plane = figure.add_subplot(grid[:, 0])
    panels = [figure.add_subplot(grid[row, 1]) for row in range(3)]
    _circles(plane, arm)
    width = arm.outer_reach_m - arm.inner_reach_m
    for layer, (clearance, colour) in enumerate(zip(CLEARANCES, LINES, strict=True)):
        points = line(arm, clearance * width)
        theta = inverse(points, arm, Branch.ELBOW_DOWN)
        speeds = np.degrees(joint_speeds(theta, (SPEED_M_S, 0.0), arm))
        label = f'line {clearance * width:.2g} m from the circles'
        plane.plot(*points.T, color=colour, linewidth=1.8, label=label)
        for axes, values in zip(panels, (*speeds.T, manipulability(theta, arm)), strict=True):
            axes.plot(points[:, 0], values, color=colour, linewidth=1.5, zorder=3.0 - 0.1 * layer)
    for number, pose in enumerate(theta[:: SAMPLES // 4]):
        label = 'arm on the closest line' if number == 0 else ''
        plane.plot(
            *_joints(pose, arm).T, 'o-', color=PALE, linewidth=1.5, markersize=3, zorder=1.5, label=label
        )
    dress(plane, xlabel='x [m]', ylabel='y [m]', aspect='equal')
    plane.locator_params(nbins=7)
    labels = (r'$\dot\theta_1$ [deg/s]', r'$\dot\theta_2$ [deg/s]', r'$|\det\,J|$ [m$^2$]')
    for axes, label in zip(panels, labels, strict=True):
        dress(axes, ylabel=label)
        axes.tick_params(labelbottom=axes is panels[-1])
    panels[-1].set(ylim=(0.0, None), xlabel='x of the tool [m]')
    figure.align_ylabels(panels)
    figure.legend(ncols=3, **LEGEND)
    return figure


def line(arm: TwoLinkArm, clearance_m: float) -> Floats:
    """Return points [m] of a line along x with a clearance from both singular circles; shape (SAMPLES, 2)."""
    y = arm.inner_reach_m + clearance_m
    end = math.sqrt((arm.outer_reach_m - clearance_m) ** 2 - y**2)
    x = np.linspace(-end, end, SAMPLES)
    return np.stack([x, np.full(SAMPLES, y)], axis=-1)


def _joints(theta: Floats, arm: TwoLinkArm) -> Floats:
    """Return base, elbow and tool [m] of one pose; shape (3, 2)."""
    return np.stack([np.zeros(2), elbow(theta, arm), forward(theta, arm)])


def _circle(axes: Axes, radius_m: float, label: str, style: dict[str, Any]) -> None:
    azimuth = np.linspace(-math.pi, math.pi, 361)
    axes.plot(radius_m * np.cos(azimuth), radius_m * np.sin(azimuth), label=label, **style)


def _circles(axes: Axes, arm: TwoLinkArm) -> None:
    """Draw the singular circles; the inner one of equal links is a point."""
    outer, inner = arm.outer_reach_m, arm.inner_reach_m
    _circle(axes, outer, rf'singular, stretched: $\theta_2$ = 0°, r = {outer:.3g} m', OUTER)
    style = INNER if inner > 0.0 else INNER | {'marker': '.'}
    _circle(axes, inner, rf'singular, folded: $\theta_2$ = ±180°, r = {inner:.3g} m', style)


def _draw_pose(axes: Axes, theta: Floats, arm: TwoLinkArm, radius: float) -> None:
    """Draw an arm with arcs of radius [m] for its joint angles (Fig. 3.5)."""
    base, knee, tool = _joints(theta, arm)
    a, b = arm.lower_arm_length_m, arm.upper_arm_length_m
    link: dict[str, Any] = {'linewidth': 5.0, 'solid_capstyle': 'round'}
    axes.plot(*np.stack([base, knee]).T, color=LOWER, label=f'lower arm, a = {a:.3g} m', **link)
    axes.plot(*np.stack([knee, tool]).T, color=UPPER, label=f'upper arm, b = {b:.3g} m', **link)
    axes.plot(*np.stack([base, knee]).T, 'o', color='white', markeredgecolor=TOOL, markersize=8)
    axes.plot(*tool, 'x', color=TOOL, markersize=9, markeredgewidth=2.2, label='tool', linestyle='none')
    _angle(axes, base, (0.0, theta[0]), radius, r'$\theta_1$')
    _angle(axes, knee, (theta[0], theta[0] + theta[1]), radius, r'$\theta_2$')


def _angle(axes: Axes, corner: Floats, ends: tuple[float, float], radius: float, text: str) -> None:
    """Draw an angle between two directions [rad], the first as a dashed ray, with its label."""
    start, end = ends
    ray = np.stack([corner, corner + 1.7 * radius * np.array([math.cos(start), math.sin(start)])])
    axes.plot(*ray.T, color='#555555', linewidth=0.9, linestyle=DASHED)
    sweep = np.linspace(start, end, 61)
    arc = corner + radius * np.stack([np.cos(sweep), np.sin(sweep)], axis=-1)
    axes.plot(*arc.T, color='#555555', linewidth=1.2)
    narrow = abs(end - start) < NARROW_RAD
    direction = start - math.copysign(0.6 * NARROW_RAD, end - start) if narrow else (start + end) / 2.0
    middle = corner + 1.45 * radius * np.array([math.cos(direction), math.sin(direction)])
    axes.text(middle[0], middle[1], text, ha='center', va='center', fontsize=11)
