"""Figures of a sweep: distributions of the results, and their dependence on the varied quantities."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from delta3_pacdrive.studies.fleet.sweep.effects import effects
from delta3_pacdrive.studies.fleet.sweep.study import Law, Runs
from delta3_pacdrive.studies.framework.figure_style import COLOURS, dress, label_of_key, titled_figure
from delta3_pacdrive.studies.framework.report_folder import Drawings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DRAWN = 6  # maximum number of drawn results, and of drawn quantities
DOTS = 5000
COLUMNS, HEIGHT_IN = 2, 2.4
LIMIT = '#d92d3a'
DISTRIBUTIONS, EFFECTS, SCATTER = 'distributions.png', 'effects.png', 'scatter_{}.png'


def file_names() -> list[str]:
    """Return patterns of the file names of all figures."""
    return [DISTRIBUTIONS, EFFECTS, SCATTER.format('*')]


def by_name(found: Runs) -> Drawings:
    """Return the drawing function of each figure by file name."""
    names = [name for name in (found.sweep.limits or found.kept) if _known(found, name).sum() > 1][:DRAWN]
    varied = [one.key for one in found.sweep.vary if one.law is not Law.RUN and one.is_number]
    drawings = {}
    if names:
        drawings[DISTRIBUTIONS] = partial(distribution_figure, found, names)
        if any(one.name in names for one in effects(found)):
            drawings[EFFECTS] = partial(effect_figure, found, names)
    if varied:
        drawings |= {
            SCATTER.format(name): partial(scatter_figure, found, name, varied[:DRAWN]) for name in names
        }
    return drawings


def _panels(title: str, count: int) -> tuple[Figure, list[Axes]]:
    rows = -(-count // COLUMNS)
    figure = titled_figure(title, 1.0 + HEIGHT_IN * rows)
    return figure, [figure.add_subplot(rows, min(count, COLUMNS), n + 1) for n in range(count)]


def _known(found: Runs, name: str) -> np.ndarray:
    return found.done & np.isfinite(found.kept[name])


def distribution_figure(found: Runs, names: list[str]) -> Figure:
    """Histogram of each result; the red line is its limit."""
    figure, axes = _panels(f'{found.sweep.name}: distributions', len(names))
    for axis, name in zip(axes, names, strict=True):
        values = found.kept[name][_known(found, name)]
        axis.hist(values, bins=min(60, max(10, len(values) // 20)), color=COLOURS[0])
        dress(axis, xlabel=label_of_key(name), ylabel='runs')
        if name in found.sweep.limits:
            axis.axvline(found.sweep.limits[name], color=LIMIT)
    return figure


def effect_figure(found: Runs, names: list[str]) -> Figure:
    """Share of the variance of each result due to each quantity; Sobol indices for a Saltelli design."""
    every = effects(found)
    shown = [name for name in names if any(one.name == name for one in every)]
    figure, axes = _panels(f'{found.sweep.name}: sources of variance', len(shown))
    for axis, name in zip(axes, shown, strict=True):
        rows = [one for one in every if one.name == name]
        of_sobol = all(np.isfinite(one.total) for one in rows)
        rows.sort(key=lambda one: one.total if of_sobol else one.share)
        places = np.arange(len(rows))
        if of_sobol:
            for shift, kind, label, colour in ((0.2, 'first', 'alone', 0), (-0.2, 'total', 'with others', 1)):
                widths, errors = ([getattr(one, f'{kind}{end}') for one in rows] for end in ('', '_interval'))
                axis.barh(places + shift, widths, 0.4, xerr=errors, color=COLOURS[colour], label=label)
            axis.legend(fontsize=8, frameon=False)
        else:
            axis.barh(places, [one.share for one in rows], color=COLOURS[0])
        axis.set_yticks(places, [one.key for one in rows])
        dress(axis, name, xlabel='share of its variance')
        axis.set_xlim(0.0, None)
    return figure


def scatter_figure(found: Runs, name: str, keys: list[str]) -> Figure:
    """One result over each varied quantity; each dot is a run."""
    figure, axes = _panels(f'{found.sweep.name}: {name}', len(keys))
    known = np.flatnonzero(_known(found, name))[:DOTS]
    for axis, key in zip(axes, keys, strict=True):
        axis.plot(
            found.values[key][known].astype(float),
            found.kept[name][known],
            '.',
            markersize=2,
            color=COLOURS[0],
        )
        dress(axis, xlabel=label_of_key(key), ylabel=label_of_key(name))
        if name in found.sweep.limits:
            axis.axhline(found.sweep.limits[name], color=LIMIT)
    return figure
