"""Path in space, drawn with all three axes to the same scale in a box that fits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

FLAT = 0.4  # minimum extent of an axis relative to the longest, so that a plane path keeps a visible depth
VIEW_DEG = (24.0, -62.0)  # elevation, azimuth
WHOLE: dict[str, Any] = {'clip_on': False}  # line style: a wide box exceeds the square of its axes


def path_axes(figure: Figure, bottom: float, height: float) -> Axes3D:
    """Return 3D axes in a part of a figure."""
    figure.set_layout_engine('none')  # it assumes a cube
    axes: Axes3D = figure.add_axes((-0.02, bottom, 1.0, height), projection='3d', computed_zorder=False)
    return axes


def frame_path(axes: Axes3D, points: Floats) -> None:
    """Set limits and labels for a path of points [mm], shape (n, 3), with all axes to the same scale."""
    from matplotlib.ticker import MaxNLocator

    low, high = points.min(axis=0), points.max(axis=0)
    longest = max(float((high - low).max()), 1.0)
    spans = np.maximum(1.1 * (high - low), FLAT * longest)
    _fit_box(axes, spans)
    for name, axis, middle, span in zip('xyz', _three_axes(axes), (low + high) / 2.0, spans, strict=True):
        getattr(axes, f'set_{name}lim')(middle - span / 2.0, middle + span / 2.0)
        axis.set_major_locator(MaxNLocator(max(3, round(6 * span / longest))))
        axis.set_label_text(f'{name} [mm]')
    axes.ticklabel_format(useOffset=False)


def _fit_box(axes: Axes3D, spans: Floats) -> None:
    """Draw a box of these extents as large as the figure permits, with constant distances of the labels."""
    elevation, azimuth = np.radians(VIEW_DEG)
    across = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    up = np.array([*(-np.sin(elevation) * np.array([np.cos(azimuth), np.sin(azimuth)])), np.cos(elevation)])
    sides = spans / np.linalg.norm(spans)
    sides *= min(1.2 / (np.abs(across) @ sides), 0.78 / (np.abs(up) @ sides))
    axes.set_proj_type('ortho')
    axes.view_init(*VIEW_DEG)
    axes.set_box_aspect(spans.tolist(), zoom=float(np.linalg.norm(sides)))
    # matplotlib scales label distances beyond 8 and 21 with the sides along which the labels are moved
    moved = ((0, -1, -1), (1, 0, -1), (1, 1, 0))
    distances = ((7.0, 21.0), (9.0, 27.0), (14.0, 32.0))
    for axis, along, (tick, label) in zip(_three_axes(axes), moved, distances, strict=True):
        part = float(np.hypot(across @ (along * sides), up @ (along * sides)))
        axis.set_tick_params(labelsize=8, pad=tick / part - 8.0)
        axis.labelpad = label / part - 21.0


def _three_axes(axes: Axes3D) -> tuple[Any, Any, Any]:
    """Return the axes of x, y and z."""
    return axes.xaxis, axes.yaxis, axes.zaxis
