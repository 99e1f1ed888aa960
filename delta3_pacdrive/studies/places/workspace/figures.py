"""Figures of the workspace: a map of every quantity in each slice."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.capability import REACHED
from delta3_pacdrive.studies.framework.columns import in_unit
from delta3_pacdrive.studies.framework.figure_style import MUTED, empty_figure, panel_title
from delta3_pacdrive.studies.framework.report_folder import Drawings
from delta3_pacdrive.studies.places.workspace.evaluation import LIMITS, mapped
from delta3_pacdrive.studies.places.workspace.study import Grid, Quantity, Results, Slice

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM = 1e3
COLUMNS = 3  # of panels
PANEL_IN = 3.3
LEVELS = 14
FRAME: dict[str, Any] = {'color': '#111111', 'linewidth': 1.3, 'linestyle': (0, (5, 3)), 'fill': False}
LIMIT_COLOURS = ('#E3F1E7', '#F4F4F4', '#D55E00', '#E69F00', '#CC79A7', '#7A3E9D', '#0072B2', '#CFE3F2', '#B5CFE3',
                 '#9BBBD4')  # fmt: skip


def by_name(found: Results, slices: tuple[Slice, ...], parameters: Parameters) -> Drawings:
    """Return the drawing functions of the figures by file name."""
    drawings: dict[str, Any] = {
        f'{quantity.key}.png': partial(quantity_map, found, slices, parameters, quantity)
        for quantity in mapped(found.volume)
    }
    return {'reach.png': partial(reach_map, found, slices, parameters), **drawings}


def quantity_map(
    found: Results, slices: tuple[Slice, ...], parameters: Parameters, quantity: Quantity
) -> Figure:
    """Draw one quantity in each slice within the limits of the arms; dashed: the workspace."""
    from matplotlib.ticker import MaxNLocator

    inside = [_inside(grid, quantity) for grid in found.slices]
    known = np.concatenate([values for values in inside if len(values)] or [np.array([0.0, 1.0])])
    low, high = float(known.min()), float(known.max())
    levels = MaxNLocator(LEVELS).tick_values(low, high if high > low else low + 1.0)
    unit = f' [{_unit(quantity)}]' if quantity.shown_unit else ''
    title = f'{quantity.title[0].upper()}{quantity.title[1:]}{unit}'
    figure, panels = _panels(slices, title)
    colours = 'viridis_r' if quantity.worst_is_large else 'viridis'
    filled = None
    for axes, plane, grid in zip(panels, slices, found.slices, strict=True):
        across, up, values = _plane(grid, plane, in_unit(grid.values[quantity.key], quantity.shown_unit))
        if np.isfinite(values).any():
            filled = axes.contourf(across, up, values, levels, cmap=colours, extend='both')
            axes.contour(across, up, values, levels, colors='white', linewidths=0.4, alpha=0.6)
        _dress(axes, plane, parameters)
    figure.supxlabel(
        "dashed: the workspace; white: out of reach, or beyond the arms' limits", fontsize=8, color=MUTED
    )
    if filled is not None:
        figure.colorbar(filled, ax=panels, shrink=0.9, aspect=28, pad=0.02)
    return figure


def _unit(quantity: Quantity) -> str:
    return {'m/s2': 'm/s$^2$', 'um': 'µm'}.get(quantity.shown_unit, quantity.shown_unit)


def _inside(grid: Grid, quantity: Quantity) -> Any:
    """Return the values that determine the colours: those in the workspace, or all if the slice is outside."""
    values = in_unit(grid.values[quantity.key], quantity.shown_unit)
    chosen = values[grid.limit == REACHED]
    return chosen if len(chosen) else values[np.isfinite(values)]


def reach_map(found: Results, slices: tuple[Slice, ...], parameters: Parameters) -> Figure:
    """Draw the reachable positions and the limit that is violated first outside of them."""
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.patches import Patch

    figure, panels = _panels(slices, 'Reachable positions and the limits around them', 0.55)
    colours = ListedColormap(LIMIT_COLOURS)
    norm = BoundaryNorm(np.arange(len(LIMITS) + 1) - 0.5, len(LIMITS))
    seen: set[int] = set()
    for axes, plane, grid in zip(panels, slices, found.slices, strict=True):
        across, up, codes = _plane(grid, plane, grid.limit)
        seen |= set(np.unique(codes).tolist())
        axes.pcolormesh(across, up, codes, cmap=colours, norm=norm, shading='nearest', rasterized=True)
        _dress(axes, plane, parameters)
    figure.legend(
        handles=[Patch(facecolor=LIMIT_COLOURS[code], edgecolor=MUTED, label=LIMITS[code]) for code in sorted(seen)],
        loc='outside lower center', ncols=4, frameon=False, fontsize=9,
    )  # fmt: skip
    return figure


def _panels(slices: tuple[Slice, ...], title: str, below_in: float = 0.0) -> tuple[Figure, list[Axes]]:
    columns = min(COLUMNS, len(slices))
    rows = math.ceil(len(slices) / columns)
    figure = empty_figure(PANEL_IN * rows + 0.7 + below_in, PANEL_IN * columns + 1.3)
    figure.suptitle(title, fontsize=12)
    grid = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for axes in grid[len(slices) :]:
        axes.set_axis_off()
    return figure, grid[: len(slices)]


def _plane(grid: Grid, plane: Slice, values: Any) -> tuple[Any, Any, Any]:
    """Return both coordinates of a slice [mm], and its values with rows upward."""
    coordinates = [MM * axis for axis in (grid.x_m, grid.y_m, grid.z_m)]
    del coordinates[plane.axis]
    return coordinates[0], coordinates[1], np.squeeze(values, axis=plane.axis).T


def _dress(axes: Axes, plane: Slice, parameters: Parameters) -> None:
    """Set the labels of a panel and draw the section of the workspace."""
    from matplotlib.patches import Circle, Rectangle

    k = parameters.kinematics
    radius, bottom, top = (
        MM * value for value in (0.5 * k.workspace_diameter_m, k.workspace_bottom_m, k.workspace_top_m)
    )
    names = [name for n, name in enumerate('xyz') if n != plane.axis]
    position = MM * plane.position_m
    if plane.axis == 2:
        if bottom - 1e-6 <= position <= top + 1e-6:
            axes.add_patch(Circle((0.0, 0.0), radius, **FRAME))
    elif abs(position) < radius:
        half = math.sqrt(radius**2 - position**2)
        axes.add_patch(Rectangle((-half, bottom), 2.0 * half, top - bottom, **FRAME))
    axes.set_aspect('equal')
    axes.set_xlabel(f'{names[0]} [mm]', fontsize=9)
    axes.set_ylabel(f'{names[1]} [mm]', fontsize=9)
    axes.tick_params(labelsize=8)
    axes.locator_params(nbins=5)
    panel_title(axes, plane.name)
