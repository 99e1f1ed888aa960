"""Figures of a pose: forward kinematics, three spheres, inverse kinematics, eight solutions (Fig. 4.3 to 4.6)."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.units import millimetres
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.studies.framework.figure_style import (
    AXIS_COLOURS,
    DASHED,
    MUTED,
    NORM_COLOUR,
    dress,
    empty_figure,
    panel_title,
)
from delta3_pacdrive.studies.framework.report_folder import Drawings
from delta3_pacdrive.studies.places.pose import drawing
from delta3_pacdrive.studies.places.pose.evaluation import elbows
from delta3_pacdrive.studies.places.pose.study import Pose

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

MM = 1e3
INK, PALE = '#222222', '#B0B0B0'
CIRCLE_POINTS = 181
ARC_RADIUS_MM = 130.0
WHOLE: dict[str, Any] = {'clip_on': False}


def by_name(pose: Pose, parameters: Parameters) -> Drawings:
    """Return the drawing functions of the figures possible for a pose, by file name."""
    drawings: dict[str, Any] = {}
    if pose.jacobian is not None:
        drawings['forward_kinematics.png'] = partial(forward_kinematics, pose, parameters)
        drawings['three_spheres.png'] = partial(three_spheres, pose, parameters)
    if pose.solutions and np.isfinite(pose.solutions[0].arm_angle_rad).all():
        drawings['inverse_kinematics.png'] = partial(inverse_kinematics, pose, parameters)
        drawings['eight_solutions.png'] = partial(eight_solutions, pose, parameters)
    return drawings


def forward_kinematics(pose: Pose, parameters: Parameters) -> Figure:
    """Draw the forward kinematics: three arm angles determine the TCP position (Fig. 4.3)."""
    theta, point = pose.arm_angle_rad, pose.point_m
    assert theta is not None and point is not None  # noqa: S101, PT018
    k = parameters.kinematics
    figure = empty_figure(6.4)
    figure.set_layout_engine('none')
    figure.suptitle('Forward kinematics', fontsize=12, y=0.975)
    axes = drawing.space(figure, (0.06, 0.02, 0.88, 0.74))
    drawing.robot(axes, theta, point, k)
    tcp = MM * point
    levels = 2.0 * ARC_RADIUS_MM + MM * k.base_radius_m
    around = np.concatenate([levels * drawing.directions(k)[0], _axes_of_base(parameters), [tcp]])
    drawing.frame(axes, np.concatenate([drawing.corners(theta, point, k), around]))
    _angle_arcs(axes, theta, parameters)
    axes.plot(*tcp[:, None], 'o', color=NORM_COLOUR, markersize=7, zorder=400, **WHOLE)
    _frame_of_base(axes, parameters)
    _note(axes, tcp, f'TCP {millimetres(point)}', (-70, -22), NORM_COLOUR)
    _blocks(figure, 'forward\nkinematics', _angle_texts(theta), _position_texts(point))
    return figure


def inverse_kinematics(pose: Pose, parameters: Parameters) -> Figure:
    """Draw the inverse kinematics: two circles per arm intersect in the elbows, outward and inward (Fig. 4.5)."""
    point = pose.point_m
    assert point is not None  # noqa: S101
    outward, inward = pose.solutions[0].arm_angle_rad, pose.solutions[7].arm_angle_rad
    figure = empty_figure(5.6, 10.0)
    figure.set_layout_engine('none')
    figure.suptitle('Inverse kinematics', fontsize=12, y=0.98)
    _blocks(figure, 'inverse\nkinematics', _position_texts(point), _angle_texts(outward))
    grid = figure.add_gridspec(1, 3, left=0.07, right=0.985, bottom=0.17, top=0.70, wspace=0.16)
    panels = list(grid.subplots(sharey=True, squeeze=False)[0])
    for i, axes in enumerate(panels):
        _arm_plane(axes, i, (outward[i], inward[i]), point, parameters)
    panels[0].set_ylabel('z [mm]')
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='lower center', ncols=5, frameon=False, fontsize=9)
    return figure


def _arm_plane(
    axes: Axes, i: int, angles: tuple[float, float], point: Floats, parameters: Parameters
) -> None:
    """Draw the circle of the elbow, and the intersection of the forearm's sphere with the plane of the arm."""
    k = parameters.kinematics
    u, v = (rows[i] for rows in drawing.directions(k))
    centre = MM * np.array([k.base_radius_m, 0.0])
    wrist = MM * np.array([point @ u + k.plate_radius_m, point[2]])
    offset = float(point @ v)  # from the plane of the arm
    radius = MM * np.sqrt(k.forearm_length_m**2 - offset**2)
    turn = np.linspace(0.0, 2.0 * np.pi, CIRCLE_POINTS)
    ring = np.stack([np.cos(turn), np.sin(turn)])
    colour = AXIS_COLOURS[i]
    axes.plot(*(centre[:, None] + MM * k.upper_arm_length_m * ring), color=INK, linewidth=1.0,
              label='reach of the elbow, radius $l_A$')  # fmt: skip
    axes.plot(*(wrist[:, None] + radius * ring), color=MUTED, linewidth=1.0, linestyle=DASHED,
              label=r'reach of the forearm, radius $\sqrt{l_B^2 - y^2}$')  # fmt: skip
    styles: tuple[tuple[float, dict[str, Any], str], ...] = (
        (angles[1], {'color': PALE, 'linewidth': 2.4}, 'elbow inward'),
        (angles[0], {'color': colour, 'linewidth': 4.0}, 'elbow outward'),
    )
    for angle, style, label in styles:
        bend = centre + MM * k.upper_arm_length_m * np.array([np.cos(angle), -np.sin(angle)])
        chain = np.stack([centre, bend, wrist])
        axes.plot(*chain[:2].T, solid_capstyle='round', label=label, **style)
        axes.plot(*chain[1:].T, color=style['color'], linewidth=1.4)
        axes.plot(*bend, 'o', color=style['color'], markersize=6)
    axes.plot(*centre, 's', color='#6B7380', markersize=8)
    axes.plot(*wrist, 'o', color=NORM_COLOUR, markersize=6)
    panel_title(
        axes,
        rf'arm {i + 1}: $\theta_{i + 1}$ = {np.degrees(angles[0]):z.1f}°, or {np.degrees(angles[1]):z.1f}°',
    )
    dress(axes)
    axes.set_aspect('equal', adjustable='box')
    reach = MM * (k.upper_arm_length_m + 0.02)
    low = min(float(wrist[1]), -reach) - 40.0
    axes.set(xlim=(-reach + centre[0] - 60.0, reach + centre[0] + 60.0), ylim=(low, reach + 40.0))
    axes.set_xlabel('outward [mm]', fontsize=9)


def eight_solutions(pose: Pose, parameters: Parameters) -> Figure:
    """Draw the eight solutions of the inverse kinematics for one point; the robot uses the first (Fig. 4.6)."""
    point = pose.point_m
    assert point is not None  # noqa: S101
    figure = empty_figure(6.6, 11.0)
    figure.set_layout_engine('none')
    figure.suptitle(f'All eight solutions for {millimetres(point)}', fontsize=12, y=0.985)
    grid = figure.add_gridspec(2, 4, left=0.0, right=1.0, bottom=0.01, top=0.87, wspace=0.0, hspace=0.16)
    k = parameters.kinematics
    seen = np.concatenate([drawing.corners(one.arm_angle_rad, point, k) for one in pose.solutions])
    for n, one in enumerate(pose.solutions):
        axes = drawing.space(figure, grid[n // 4, n % 4])
        drawing.robot(axes, one.arm_angle_rad, point, k, width=0.8)
        axes.plot(*(MM * point)[:, None], 'o', color=NORM_COLOUR, markersize=5, zorder=400, **WHOLE)
        drawing.frame(axes, seen, 0.88)
        angles = ', '.join(f'{angle:z.0f}°' for angle in np.degrees(one.arm_angle_rad))
        chosen = n == 0
        remark = 'the robot works here' if chosen and one.is_legal else "beyond the arms' limits"
        if one.is_legal and not chosen:
            remark = "within the arms' limits"
        axes.text2D(0.5, 1.07, f'{", ".join(one.elbows)}', transform=axes.transAxes, ha='center', fontsize=10,
                    fontweight='bold' if chosen else 'normal', color=INK)  # fmt: skip
        axes.text2D(0.5, 1.01, f'{angles}: {remark}', transform=axes.transAxes, ha='center', fontsize=8,
                    color=AXIS_COLOURS[2] if one.is_legal else MUTED)  # fmt: skip
    return figure


def three_spheres(pose: Pose, parameters: Parameters) -> Figure:
    """Draw spheres of radius l_B around the elbows: two intersect in a circle, the third in two points (Fig. 4.4)."""
    theta, point, mirror = pose.arm_angle_rad, pose.point_m, pose.mirror_m
    assert theta is not None and point is not None and mirror is not None  # noqa: S101, PT018
    k = parameters.kinematics
    centres, radius = MM * elbows(theta, parameters), MM * k.forearm_length_m
    figure = empty_figure(7.0)
    figure.set_layout_engine('none')
    figure.suptitle('Three spheres of radius $l_B$ around the elbows', fontsize=12, y=0.975)
    axes = drawing.space(figure, (0.02, 0.05, 0.96, 0.89))
    for centre, colour in zip(centres, AXIS_COLOURS, strict=True):
        _sphere(axes, centre, radius, colour)
    drawing.frame(axes, np.concatenate([_ball(centre, radius).reshape(3, -1).T for centre in centres]), 0.96)
    style: dict[str, Any] = {'color': INK, 'linewidth': 2.2, 'zorder': 300}
    axes.plot(*_circle(centres[0], centres[1], radius), **style, **WHOLE)
    for one, other in ((1, 2), (2, 0)):
        ring = _circle(centres[one], centres[other], radius)
        axes.plot(*ring, color=MUTED, linewidth=1.0, linestyle=DASHED, zorder=250, **WHOLE)
    plane = np.vstack([centres, centres[:1]])
    axes.plot(*plane.T, color=MUTED, linewidth=1.0, zorder=260, **WHOLE)
    tcp, above = MM * point, MM * mirror
    for centre, colour in zip(centres, AXIS_COLOURS, strict=True):
        axes.plot(*np.stack([centre, tcp]).T, color=colour, linewidth=2.4, zorder=310, **WHOLE)
        axes.plot(
            *np.stack([centre, above]).T, color=colour, linewidth=1.0, linestyle=DASHED, zorder=305, **WHOLE
        )
        axes.plot(*centre[:, None], 'o', color=colour, markersize=7, zorder=320, **WHOLE)
    for n, centre in enumerate(centres):
        _note(axes, centre, f'elbow {n + 1}', (8, 8), AXIS_COLOURS[n])
    axes.plot(*tcp[:, None], 'o', color=NORM_COLOUR, markersize=9, zorder=400, **WHOLE)
    axes.plot(
        *above[:, None], 'o', markerfacecolor='white', color=NORM_COLOUR, markersize=9, zorder=400, **WHOLE
    )
    _note(axes, tcp, f'TCP {millimetres(point)}', (12, -18), NORM_COLOUR)
    _note(axes, above, f'above the elbow plane {millimetres(mirror)}', (12, 12), NORM_COLOUR)
    figure.text(
        0.5,
        0.025,
        'black: spheres 1 and 2 meet in this circle, sphere 3 cuts it twice; dashed: circles of the other pairs',
        ha='center',
        fontsize=9,
        color='#444444',
    )
    return figure


def _ball(centre: Floats, radius: float) -> Floats:
    """Return points on a sphere, shape (3, polar, azimuth)."""
    azimuth, polar = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 49), np.linspace(0.0, np.pi, 25))
    shape = np.stack([np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)])
    return np.asarray(centre[:, None, None] + radius * shape)


def _sphere(axes: Axes3D, centre: Floats, radius: float, colour: str) -> None:
    x, y, z = _ball(centre, radius)
    axes.plot_surface(x, y, z, color=colour, alpha=0.07, linewidth=0.0, shade=False, zorder=10, **WHOLE)
    axes.plot_wireframe(
        x, y, z, color=colour, alpha=0.12, linewidth=0.4, rcount=9, ccount=13, zorder=20, **WHOLE
    )


def _circle(one: Floats, other: Floats, radius: float) -> Floats:
    """Return points of the intersection circle of two spheres with equal radius, shape (3, n)."""
    apart = other - one
    distance = float(np.linalg.norm(apart))
    axis = apart / distance
    across = np.cross(axis, drawing.UP)
    across /= np.linalg.norm(across)
    around = np.cross(axis, across)
    size = np.sqrt(radius**2 - 0.25 * distance**2)
    turn = np.linspace(0.0, 2.0 * np.pi, CIRCLE_POINTS)
    ring = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * around
    return np.asarray((0.5 * (one + other) + size * ring).T)


def _angle_arcs(axes: Axes3D, theta: Floats, parameters: Parameters) -> None:
    """Draw each arm angle as an arc from the horizontal."""
    k = parameters.kinematics
    u, _ = drawing.directions(k)
    for i, (angle, colour) in enumerate(zip(theta, AXIS_COLOURS, strict=True)):
        centre = MM * k.base_radius_m * u[i]
        turn = np.linspace(0.0, float(angle), 40)[:, None]
        arc = centre + ARC_RADIUS_MM * (np.cos(turn) * u[i] - np.sin(turn) * drawing.UP)
        level = np.stack([centre, centre + 2.0 * ARC_RADIUS_MM * u[i]])
        axes.plot(*level.T, color=MUTED, linewidth=1.0, linestyle=DASHED, zorder=350, **WHOLE)
        axes.plot(*arc.T, color=colour, linewidth=1.6, zorder=360, **WHOLE)
        half = 0.5 * float(angle)
        position = centre + 1.9 * ARC_RADIUS_MM * (np.cos(half) * u[i] - np.sin(half) * drawing.UP)
        _note(axes, position, rf'$\theta_{i + 1}$', (0, 4), colour)


def _axes_of_base(parameters: Parameters) -> Floats:
    """Return the origin and the drawn ends of the axes of {R} [mm], shape (4, 3)."""
    return 0.6 * MM * parameters.kinematics.base_radius_m * np.eye(4, 3, -1)


def _frame_of_base(axes: Axes3D, parameters: Parameters) -> None:
    """Draw the frame {R} of the base."""
    ends = _axes_of_base(parameters)
    for n, name in enumerate('xyz'):
        axes.plot(*ends[[0, n + 1]].T, color=INK, linewidth=1.2, zorder=380, **WHOLE)
        _note(axes, 1.15 * ends[n + 1], name, (0, -3), INK)


def _note(axes: Axes3D, point: Floats, text: str, shift: tuple[float, float], colour: str) -> None:
    """Write a text next to a point in space."""
    from matplotlib.patheffects import withStroke
    from mpl_toolkits.mplot3d import proj3d

    x, y, _ = proj3d.proj_transform(*point, axes.get_proj())
    axes.annotate(
        text, (x, y), shift, textcoords='offset points', fontsize=9, color=colour, zorder=500, annotation_clip=False,
        path_effects=[withStroke(linewidth=2.5, foreground='white')],
    )  # fmt: skip


def _angle_texts(theta: Floats) -> list[tuple[str, str]]:
    """Return arm angles as text, each with its colour."""
    texts = [rf'$\theta_{i + 1}$ = {value:z.2f}°' for i, value in enumerate(np.degrees(theta))]
    return list(zip(texts, AXIS_COLOURS, strict=True))


def _position_texts(point: Floats) -> list[tuple[str, str]]:
    """Return coordinates as text, each with its colour."""
    return [
        (f'${name}$ = {value:z.2f} mm', NORM_COLOUR) for name, value in zip('xyz', MM * point, strict=True)
    ]


def _blocks(figure: Figure, name: str, inputs: list[tuple[str, str]], outputs: list[tuple[str, str]]) -> None:
    """Draw inputs and outputs of a transformation at the top of the figure."""
    from matplotlib.patches import FancyBboxPatch

    height_in = figure.get_figheight()
    axes = figure.add_axes((0.0, 1.0 - 1.35 / height_in, 1.0, 1.05 / height_in))
    axes.set_axis_off()
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    axes.add_patch(
        FancyBboxPatch(
            (0.42, 0.08), 0.16, 0.8, boxstyle='round,pad=0.005', facecolor='#EEF2F6', edgecolor=MUTED
        )
    )
    axes.text(0.5, 0.48, name, ha='center', va='center', fontsize=10, color=INK)
    arrow: dict[str, Any] = {
        'arrowstyle': '-|>',
        'color': MUTED,
        'linewidth': 1.2,
        'shrinkA': 0.0,
        'shrinkB': 0.0,
    }
    for height, (into, colour), (out, out_colour) in zip((0.8, 0.48, 0.16), inputs, outputs, strict=True):
        axes.text(0.33, height, into, ha='right', va='center', fontsize=10, color=colour)
        axes.annotate('', (0.415, height), (0.34, height), arrowprops=arrow)
        axes.annotate('', (0.66, height), (0.585, height), arrowprops=arrow)
        axes.text(0.67, height, out, ha='left', va='center', fontsize=10, color=out_colour)
