"""Drawing of the robot in space as lines and surfaces: base, upper arms, forearms and plate, sorted by depth."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Kinematics
from delta3_pacdrive.studies.framework.figure_style import AXIS_COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

MM = 1e3
VIEW_DEG = (20.0, -72.0)  # elevation, azimuth of the viewer
BASE, PLATE, ROD = '#C9CED6', '#8B93A0', '#2F343B'
ROD_SHARE = 0.07  # half the distance of the rods of a forearm, relative to l_A
UP = np.array([0.0, 0.0, 1.0])
CUBE = 0.5947  # side of the cube drawn by matplotlib, relative to square axes
ORDER = 100  # drawing order of the origin


def view_direction() -> Floats:
    """Return the unit vector towards the viewer."""
    elevation, azimuth = np.radians(VIEW_DEG)
    return np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )


def depth_order(points_mm: Floats) -> float:
    """Return the zorder of an object; closer objects are drawn later."""
    return ORDER + float((points_mm @ view_direction()).mean()) / MM * 10.0


def directions(kinematics: Kinematics) -> tuple[Floats, Floats]:
    """Return the directions of the arms and of the motor axes, shapes (3, 3)."""
    azimuth = np.array(kinematics.arm_azimuth_rad)
    zero = np.zeros(3)
    return (
        np.stack([np.cos(azimuth), np.sin(azimuth), zero], axis=-1),
        np.stack([-np.sin(azimuth), np.cos(azimuth), zero], axis=-1),
    )


def joints(theta: Floats, point: Floats, kinematics: Kinematics) -> tuple[Floats, Floats, Floats]:
    """Return shoulders, elbows and joints on the plate [m], shapes (3, 3)."""
    u, _ = directions(kinematics)
    shoulders = np.array(kinematics.base_radii_m)[:, None] * u
    elbows = shoulders + np.array(kinematics.upper_arm_lengths_m)[:, None] * (
        np.cos(theta)[:, None] * u - np.sin(theta)[:, None] * UP
    )
    return shoulders, elbows, point + kinematics.plate_radius_m * u


def space(figure: Figure, cell: tuple[float, float, float, float] | Any) -> Axes3D:
    """Return 3D axes without a box, seen along ``VIEW_DEG``, in a rectangle or a grid cell of the figure."""
    add = figure.add_axes if isinstance(cell, tuple) else figure.add_subplot
    axes: Axes3D = add(cell, projection='3d', computed_zorder=False)
    axes.set_proj_type('ortho')
    axes.view_init(*VIEW_DEG)
    axes.set_axis_off()
    axes.patch.set_visible(False)  # adjacent axes may overlap
    return axes


def frame(axes: Axes3D, points_mm: Floats, share: float = 0.92) -> None:
    """Scale axes to points, shape (n, 3), as large as possible and equally in all directions."""
    elevation, azimuth = np.radians(VIEW_DEG)
    across = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    up = np.array(
        [-np.sin(elevation) * np.cos(azimuth), -np.sin(elevation) * np.sin(azimuth), np.cos(elevation)]
    )
    x, y = points_mm @ across, points_mm @ up
    width, height = axes.get_position(original=True).size * axes.figure.get_size_inches()
    square = min(width, height)
    side = CUBE * max(float(np.ptp(x)) * square / width, float(np.ptp(y)) * square / height) / share
    middle = 0.5 * (x.min() + x.max()) * across + 0.5 * (y.min() + y.max()) * up
    low, high = middle - 0.5 * side, middle + 0.5 * side
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect((1.0, 1.0, 1.0))


def corners(theta: Floats, point: Floats, kinematics: Kinematics) -> Floats:
    """Return the outermost points of the robot [mm], shape (n, 3)."""
    _, elbows, wrists = joints(theta, point, kinematics)
    return MM * np.concatenate([_outlines(theta, point, kinematics)[0], elbows, wrists])


def _outlines(theta: Floats, point: Floats, kinematics: Kinematics) -> tuple[Floats, Floats]:
    """Return the corners of base and plate [m], shapes (6, 3)."""
    u, v = directions(kinematics)
    shoulders, _, wrists = joints(theta, point, kinematics)
    half = ROD_SHARE * kinematics.upper_arm_length_m * v
    base = [shoulders + 0.05 * u - 2.0 * half, shoulders + 0.05 * u + 2.0 * half]
    plate = [wrists - half, wrists + half]
    return np.stack(base, axis=1).reshape(-1, 3), np.stack(plate, axis=1).reshape(-1, 3)


def robot(axes: Axes3D, theta: Floats, point: Floats, kinematics: Kinematics, width: float = 1.0) -> None:
    """Draw the robot; ``width`` scales the line widths."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    _, v = directions(kinematics)
    shoulders, elbows, wrists = joints(theta, point, kinematics)
    half = ROD_SHARE * kinematics.upper_arm_length_m * v
    base, plate = _outlines(theta, point, kinematics)
    for outline, colour in ((base, BASE), (plate, PLATE)):
        body = Poly3DCollection([MM * outline], facecolor=colour, edgecolor='white', linewidth=0.6 * width, alpha=0.95,
                                clip_on=False)  # fmt: skip
        body.set_zorder(depth_order(MM * outline))
        axes.add_collection3d(body)
    for i, colour in enumerate(AXIS_COLOURS):
        arm = np.stack([shoulders[i], elbows[i]])
        _rod(axes, arm, colour, 5.5 * width)
        motor = np.stack([shoulders[i] - 1.5 * half[i], shoulders[i] + 1.5 * half[i]])
        _rod(axes, motor, '#6B7380', 6.5 * width)
        _rod(axes, np.stack([elbows[i] - half[i], elbows[i] + half[i]]), ROD, 1.8 * width)
        for side in (-half[i], half[i]):
            _rod(axes, np.stack([elbows[i] + side, wrists[i] + side]), ROD, 1.5 * width)


def _rod(axes: Axes3D, ends: Floats, colour: str, width: float) -> None:
    axes.plot(
        *(MM * ends).T,
        color=colour,
        linewidth=width,
        solid_capstyle='round',
        zorder=depth_order(MM * ends),
        clip_on=False,
    )
