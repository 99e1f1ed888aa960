"""Common style of all figures: size, colours, axes, provenance line; saves figures to files.

pyplot and its global state are not used.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.framework.provenance import Provenance

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D


DPI = 150
WIDTH_IN = 8.0
TITLE_LENGTH = 80
AXIS_COLOURS = ('#0072B2', '#D55E00', '#009E73')  # Okabe and Ito: safe for colour-blind readers
NORM_COLOUR = '#7A3E9D'
COLOURS = (*AXIS_COLOURS, '#CC79A7', NORM_COLOUR, '#56B4E9')
GRID_COLOUR = '#DDDDDD'
MUTED = '#888888'
DASHED = (0, (4, 2))
# suffixes of keys of parameters and results, and their units; longer suffixes first
UNITS_OF_KEYS = {
    '_n_m_s_rad': 'N m s/rad', '_n_m_rad': 'N m/rad', '_n_m_a': 'N m/A', '_v_s_rad': 'V s/rad', '_a_s_rad': 'A s/rad',
    '_rad_s_rad': '1/s', '_v_a_s': 'V/(A s)', '_a_rad': 'A/rad', '_v_a': 'V/A', '_kg_m2': 'kg m2',
    '_deg_s3': 'deg/s3', '_deg_s2': 'deg/s2', '_deg_s': 'deg/s', '_rad_s2': 'rad/s2', '_rad_s': 'rad/s',
    '_m_s3': 'm/s3', '_m_s2': 'm/s2', '_m_s': 'm/s', '_n_m': 'N m', '_per_min': '1/min', '_rpm': 'rpm', '_rad': 'rad',
    '_deg': 'deg', '_ohm': 'ohm', '_mm': 'mm', '_kg': 'kg', '_hz': 'Hz', '_db': 'dB', '_m': 'm', '_s': 's', '_a': 'A',
    '_v': 'V', '_h': 'H', '_j': 'J',
}  # fmt: skip


def empty_figure(height_in: float, width_in: float = WIDTH_IN) -> Figure:
    """Return a figure without panels."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), dpi=DPI, layout='constrained', facecolor='white')


def titled_figure(title: str, height_in: float, width_in: float = WIDTH_IN, **style: Any) -> Figure:
    """Return a figure with a title and without panels."""
    figure = empty_figure(height_in, width_in)
    figure.suptitle(title, fontsize=12, **style)
    return figure


def figure_of_program(what: str, program: str | None, height_in: float) -> Figure:
    """Return a figure without panels, titled by its content and the program."""
    title = textwrap.shorten(f'{what}: {program}' if program else what, TITLE_LENGTH, placeholder=' ...')
    return titled_figure(title, height_in, parse_math=False)


def add_foot(figure: Figure, provenance: Provenance) -> None:
    """Write the provenance at the foot of a figure."""
    lines = provenance.lines()
    foot = (
        f'{lines["command"]}   seed {lines["seed"]}   parameters {lines["parameters"]}   {lines["versions"]}'
    )
    figure.supxlabel(textwrap.fill(foot, 150, max_lines=3, placeholder=' ...'), fontsize=6, color=MUTED,
                     x=0.01, ha='left', parse_math=False)  # fmt: skip


def dress(axes: Axes, title: str = '', **properties: Any) -> None:
    """Add grid, frame, title and the properties that ``Axes.set`` accepts to a panel."""
    if title:
        panel_title(axes, title)
    axes.set(**properties)
    axes.grid(color=GRID_COLOUR, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[['top', 'right']].set_visible(False)
    axes.tick_params(labelsize=9)


def finish_over_time(
    panels: Sequence[Axes], labels: Sequence[str] = (), what: str = 'time from program start [s]'
) -> None:
    """Add grid, labels and a common time axis to panels in a column, without margins in time."""
    for axes, label in zip(panels, labels or [''] * len(panels), strict=True):
        dress(axes, ylabel=label)
        axes.margins(x=0.0)
        axes.ticklabel_format(axis='both', useOffset=False)
    panels[-1].set_xlabel(what)
    panels[0].figure.align_ylabels()


def column_of_panels(
    figure: Figure, labels: Sequence[str], what: str = 'time from program start [s]', **options: Any
) -> list[Axes]:
    """Return a column of panels with grid, labels and a common time axis; ``options`` as for ``Figure.subplots``."""
    panels: list[Axes] = list(figure.subplots(len(labels), 1, sharex=True, squeeze=False, **options)[:, 0])
    finish_over_time(panels, labels, what)
    return panels


def label_of_key(key: str) -> str:
    """Return a key of a parameter or a result as a label with its unit in square brackets."""
    name, bracket, index = key.rpartition('[') if key.endswith(']') else (key, '', '')
    for end, unit in UNITS_OF_KEYS.items():
        if name.endswith(end):
            return f'{name.removesuffix(end)}{bracket}{index} [{unit}]'
    return key


def keep_span(panels: Sequence[Axes], least: float) -> None:
    """Widen the y axes to at least ``least``, so that rounding errors of a constant value are not magnified."""
    for axes in panels:
        low, high = axes.get_ylim()
        if high - low < least:
            middle = (low + high) / 2.0
            axes.set_ylim(middle - least / 2.0, middle + least / 2.0)


def panel_title(axes: Axes, text: str, **style: Any) -> None:
    """Write a title above a panel."""
    axes.set_title(text, fontsize=9, loc='left', **style)


def legend_above(axes: Axes) -> None:
    """Put the legend above a panel, where it covers no data."""
    axes.legend(
        loc='lower left', bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2, ncols=3, frameon=False, fontsize=9
    )


def save(figure: Figure, path: Path, metadata: Mapping[str, str]) -> None:
    """Write a figure as PNG, with ``metadata`` in the text fields of the file; raises OSError."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with whole_file.atomic_path(path) as partial:
        FigureCanvasAgg(figure).print_png(partial, metadata=metadata)


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
