"""Figures of an optimisation: history, values of each varied quantity, importance."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.studies.framework.figure_style import (
    COLOURS,
    MUTED,
    dress,
    label_of_key,
    legend_above,
    titled_figure,
)
from delta3_pacdrive.studies.framework.report_folder import Drawings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from delta3_pacdrive.studies.fleet.optimisation.study import Trial, Trials

HISTORY, VALUES, IMPORTANCE = 'history.png', 'values.png', 'importance.png'
DRAWN, COLUMNS, HEIGHT_IN = 12, 2, 2.4
BEST = '#d92d3a'


def file_names() -> list[str]:
    """Return the file names of all figures."""
    return [HISTORY, VALUES, IMPORTANCE]


def by_name(found: Trials) -> Drawings:
    """Return the drawing function of each figure by file name."""
    drawings: Drawings = {}
    if any(found.value(one) is not None for one in found.trials):
        drawings = {HISTORY: partial(history_figure, found), VALUES: partial(value_figure, found)}
    if found.importance:
        drawings = {**drawings, IMPORTANCE: partial(importance_figure, found)}
    return drawings


def history_figure(found: Trials) -> Figure:
    """Result of each trial and the best so far; the dashed line is the result with the values of the files."""
    figure = titled_figure(f'{found.optimisation.sweep.name}: history', 3.6)
    axes = figure.add_subplot()
    good, other = _with_value(found)
    for trials, label, colour, marker in (
        (good, 'within the limits', COLOURS[0], 'o'),
        (other, 'beyond a limit', MUTED, 'x'),
    ):
        if trials:
            numbers = [one.number for one in trials]
            axes.scatter(numbers, _values(found, trials), s=16, label=label, color=colour, marker=marker)
    if good:
        best = (np.maximum if found.optimisation.maximise else np.minimum).accumulate(_values(found, good))
        steps = [*(one.number for one in good), len(found.trials)]
        axes.step(steps, [*best, best[-1]], where='post', color=BEST, label='best so far')
        spread = np.array(
            _values(found, [*good, found.base] if found.value(found.base) is not None else good)
        )
        low, high = np.percentile(spread, [0.0, 90.0] if not found.optimisation.maximise else [10.0, 100.0])
        room = max(high - low, 1e-12)
        axes.set_ylim(low - 0.1 * room, high + 0.4 * room)
    base = found.value(found.base)
    if base is not None:
        axes.axhline(base, color=COLOURS[1], linestyle='--', linewidth=1.0, label='values of the files')
    dress(axes, xlabel='trial', ylabel=label_of_key(found.optimisation.goal))
    legend_above(axes)
    return figure


def value_figure(found: Trials) -> Figure:
    """Result over the values of each varied quantity; the red dot is the best trial."""
    keys = [one.key for one in found.optimisation.sweep.vary][:DRAWN]
    rows = -(-len(keys) // COLUMNS)
    figure = titled_figure(f'{found.optimisation.sweep.name}: values', 1.0 + HEIGHT_IN * rows)
    good, other = _with_value(found)
    for n, key in enumerate(keys):
        axes = figure.add_subplot(rows, min(len(keys), COLUMNS), n + 1)
        best = [] if found.best is None else [found.best]
        for trials, colour, marker, size in (
            (other, MUTED, 'x', 12),
            (good, COLOURS[0], 'o', 12),
            (best, BEST, 'o', 40),
        ):
            places: Any = [_place(one.values[key]) for one in trials]
            axes.scatter(places, _values(found, trials), s=size, color=colour, marker=marker)
        dress(axes, xlabel=label_of_key(key), ylabel=label_of_key(found.optimisation.goal))
    return figure


def importance_figure(found: Trials) -> Figure:
    """Share of each quantity in whether a trial is among the best tenth (PED-ANOVA)."""
    keys = list(found.importance)[:DRAWN]
    figure = titled_figure(f'{found.optimisation.sweep.name}: importance', 1.2 + 0.32 * len(keys))
    axes = figure.add_subplot()
    axes.barh(keys[::-1], [found.importance[key] for key in keys[::-1]], color=COLOURS[0])
    dress(axes, xlabel='share', xlim=(0.0, 1.0))
    return figure


def _with_value(found: Trials) -> tuple[list[Trial], list[Trial]]:
    """Return the trials with a value: those within the limits, and the others."""
    known = [one for one in found.trials if found.value(one) is not None]
    return [one for one in known if one.keeps_limits], [one for one in known if not one.keeps_limits]


def _values(found: Trials, trials: list[Trial]) -> list[float]:
    return [one.kept[found.optimisation.goal] for one in trials]


def _place(value: object) -> object:
    """Return the coordinate of a value on an axis: a number, or text."""
    return value if isinstance(value, (int, float)) and not isinstance(value, bool) else str(value)
