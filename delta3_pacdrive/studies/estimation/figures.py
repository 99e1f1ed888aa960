"""Figures of an estimation: estimates with intervals, sensitivities, residuals; analysis of chapter 9 of the thesis."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.studies.estimation.identifiability import Verdict
from delta3_pacdrive.studies.estimation.problem import Problem
from delta3_pacdrive.studies.estimation.solver import Fit
from delta3_pacdrive.studies.estimation.thesis_setup import (
    ATTEMPT_STEPS,
    FACTORS,
    STEPS,
    SYMBOLS,
    ThesisStudy,
)
from delta3_pacdrive.studies.framework.figure_style import (
    AXIS_COLOURS,
    COLOURS,
    DASHED,
    MUTED,
    dress,
    titled_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ERROR_MIN_PERCENT = 1e-6  # lower end of a logarithmic axis
POINTS_MAX = 3000  # of a line over time
LAGS = 60
IDEAL_STEP_MIN = 1e-5  # smallest drawn step with an ideal encoder
SMALL: dict[str, Any] = {'fontsize': 8, 'frameon': False}  # legends
AT_RIGHT: dict[str, Any] = SMALL | {'loc': 'center left', 'bbox_to_anchor': (1.0, 0.5)}
LINE: dict[str, Any] = {'marker': 'o', 'markersize': 4, 'linewidth': 1.0}
LEVEL: dict[str, Any] = {'color': MUTED, 'linewidth': 0.8, 'linestyle': DASHED}


def of_fit(fit: Fit, problem: Problem, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the drawing functions of an estimation by file name; ``rows`` are its estimates."""
    return {
        'estimates.png': partial(estimates, rows),
        'sensitivities.png': partial(sensitivities, fit, problem),
        'residuals.png': partial(residuals, fit, problem),
    }


def of_thesis(study: ThesisStudy) -> dict[str, Any]:
    """Return the drawing functions of the analysis of chapter 9 by file name."""
    return {'quotients.png': partial(quotients, study), 'attempts.png': partial(attempts, study)}


def estimates(rows: list[dict[str, Any]]) -> Figure:
    """Start, estimate and 95 % interval of each quantity relative to its true value, or else to the estimate."""
    shown = list(reversed(rows))
    figure = titled_figure('Estimates', 1.6 + 0.34 * len(rows))
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(1, 1.25))
    known = any(row['true'] is not None for row in rows)
    for place, row in enumerate(shown):
        if row['estimate'] is None:
            right.text(0.02, place, row['verdict'], color=MUTED, fontsize=8, va='center',
                       transform=right.get_yaxis_transform())  # fmt: skip
            left.plot([0.0], [place], alpha=0.0)
            continue
        reference = row['true'] if row['true'] is not None else row['estimate']
        start, value = (100.0 * (row[key] - reference) / row['scale'] for key in ('start', 'estimate'))
        left.plot([start, value], [place, place], color=COLOURS[0], linewidth=1.2)
        left.plot(start, place, 'o', color=COLOURS[1], markersize=5)
        left.plot(value, place, 'o', color=COLOURS[0], markersize=6)
        width = 100.0 * (row['half_width_relative'] or 0.0)
        right.plot([width, width], [place - 0.3, place + 0.3], color=COLOURS[0], linewidth=2.0)
        right.plot([ERROR_MIN_PERCENT, width], [place, place], color=COLOURS[0], linewidth=1.0, alpha=0.4)
        if known:
            error = max(100.0 * abs(row['error_relative']), ERROR_MIN_PERCENT)
            right.plot(error, place, 'D', color=COLOURS[2], markersize=5)
    left.set_yticks(range(len(shown)), [row['quantity'] for row in shown])
    right.axvline(1.0, **LEVEL)
    dress(left, 'start (orange) and estimate (blue)', ylim=(-0.6, len(shown) - 0.4),
          xlabel=f'distance from the {"truth" if known else "estimate"} [%]')  # fmt: skip
    title = 'half width of the 95 % interval (bar)' + (', true error (diamond)' if known else '')
    dress(right, title, xscale='log', xlim=(ERROR_MIN_PERCENT, 200.0), xlabel='share of the value [%]')
    return figure


def sensitivities(fit: Fit, problem: Problem) -> Figure:
    """Sensitivities of the signals to each quantity, and singular values."""
    report = fit.identifiability
    findings = list(reversed(report.findings))
    figure = titled_figure('Sensitivities of the signals', 1.9 + 0.34 * max(len(findings), 4))
    left, right = figure.subplots(1, 2, width_ratios=(1.7, 1))
    names = list(dict.fromkeys(block.name for block in problem.blocks))
    height = 0.8 / len(names)
    for n, name in enumerate(names):
        own = [k for k, block in enumerate(problem.blocks) if block.name == name]
        lengths = [math.hypot(*(f.sensitivity_by_block[k] for k in own)) for f in findings]
        places = np.arange(len(findings)) + 0.4 - (n + 0.5) * height
        left.barh(places, lengths, 0.9 * height, color=COLOURS[n], label=name)
    left.axvline(1.0, **LEVEL)
    labels = [f.symbol + ('' if f.verdict is Verdict.IDENTIFIABLE else ' *') for f in findings]
    left.set_yticks(range(len(findings)), labels)
    unclear = any(f.verdict is not Verdict.IDENTIFIABLE for f in findings)
    dress(left, '* not identifiable separately' if unclear else '', xscale='log',
          xlim=(0.3, 3.0 * max(f.sensitivity for f in findings)),
          xlabel='change of the signals for 100 % of the value\n[standard deviations of their noise]')  # fmt: skip
    figure.legend(loc='outside upper right', ncols=len(names), **SMALL)
    values = np.array(report.singular_values)
    number = np.arange(1, len(values) + 1)
    right.semilogy(number[: report.rank], values[: report.rank], 'o', color=COLOURS[0])
    floor = values[: report.rank].min() / 3.0
    for hidden in number[report.rank :]:
        right.semilogy(hidden, floor, 'x', color=COLOURS[1])
    below = ' (x: below threshold)' if report.rank < len(values) else ''
    dress(right, f'condition {report.condition:.3g}', xticks=number, xlabel=f'singular value{below}')
    return figure


def residuals(fit: Fit, problem: Problem) -> Figure:
    """Residuals over time and their autocorrelation, one row per signal."""
    count = len(problem.blocks)
    figure = titled_figure('Residuals', 1.4 + 2.0 * count)
    grid = figure.subplots(count, 2, squeeze=False, width_ratios=(2, 1))
    rows = zip(grid, problem.blocks, fit.residuals, fit.whiteness, strict=True)
    for (left, right), block, array, white in rows:
        every = -(-len(array) // POINTS_MAX)
        for column, colour, label in zip(array.T, AXIS_COLOURS, block.columns, strict=True):
            left.plot(block.times(len(array))[::every], column[::every], color=colour, linewidth=0.5, label=label,
                      alpha=0.8)  # fmt: skip
        left.axhspan(-2.0 * white.rms, 2.0 * white.rms, color='#EEEEEE', zorder=0)
        left.margins(x=0.0)
        title = f'rms {white.rms:.3g} {block.unit}, sensor noise {block.sigma:.3g} {block.unit}'
        dress(left, title, ylabel=f'{block.name} [{block.unit}]')
        shown = white.autocorrelation[: min(LAGS, len(white.autocorrelation))]
        right.vlines(np.arange(len(shown)), 0.0, shown, color=COLOURS[0], linewidth=1.2)
        bound = 2.0 / math.sqrt(array.size)
        right.axhspan(-bound, bound, color='#EEEEEE', zorder=0)
        dress(right, 'autocorrelation', ylim=(-0.5, 1.05))
    grid[-1, 0].set_xlabel('time [s]')
    grid[-1, 1].set_xlabel(f'lag [samples of {problem.blocks[-1].period_s * 1e3:.3g} ms]')
    grid[0, 0].legend(ncols=3, loc='upper right', **SMALL)
    return figure


def quotients(study: ThesisStudy) -> Figure:
    """Difference quotients of the closed-loop current over the step size, with encoders and with ideal encoders."""
    figure = titled_figure('Difference quotients of the current in the closed loop', 4.8)
    left, right = figure.subplots(1, 2, sharex=True)
    for symbol, colour in zip(SYMBOLS, COLOURS, strict=False):
        own = [q for q in study.quotients if q.symbol == symbol]
        left.loglog(STEPS, [q.through_encoder for q in own], color=colour, **LINE)
        # smaller steps are dominated by rounding
        true = [q for q in own if q.step >= IDEAL_STEP_MIN]
        left.loglog([q.step for q in true], [q.ideal for q in true], '--', color=colour, linewidth=1.2)
        right.semilogx(STEPS, [q.agreement for q in own], color=colour, label=symbol, **LINE)
    step = 'step, share of the value'
    dress(left, 'with encoders (solid), true slope (dashed)', xlabel=step,
          ylabel='length of the quotient [noise per 100 %]')  # fmt: skip
    dress(right, '1: correct direction, 0: chance', xlabel=step, ylabel='cosine to the true slope',
          ylim=(-0.15, 1.05))  # fmt: skip
    right.legend(**AT_RIGHT)
    return figure


def attempts(study: ThesisStudy) -> Figure:
    """Change of the values by each attempt, and the cost over each quantity."""
    figure = titled_figure('The estimation of chapter 9, repeated', 4.8)
    left, right = figure.subplots(1, 2)
    off = max(a.off for a in study.attempts)
    width = 0.8 / len(ATTEMPT_STEPS)
    for n, step in enumerate(ATTEMPT_STEPS):
        (attempt,) = (a for a in study.attempts if a.step == step and a.off == off)
        moved = [max(100.0 * abs(m), 1e-4) for m in attempt.moved]
        places = np.arange(len(SYMBOLS)) - 0.4 + (n + 0.5) * width
        left.bar(places, np.array(moved) - 1e-4, 0.9 * width, bottom=1e-4, color=COLOURS[n],
                 label=f'step {step:.2g}')  # fmt: skip
    needed = 100.0 * off / (1.0 + off)
    left.axhline(needed, color='#111111', linewidth=1.0, linestyle=DASHED)
    left.text(len(SYMBOLS) - 0.5, 1.25 * needed, 'needed', ha='right', va='bottom', fontsize=8)
    left.set_xticks(range(len(SYMBOLS)), SYMBOLS)
    dress(left, f'from values {100.0 * off:g} % off, default settings', yscale='log', ylim=(1e-4, 1e4),
          ylabel='change of the value by the estimation [%]')  # fmt: skip
    left.legend(loc='upper center', ncols=2, **SMALL)
    for symbol, colour in zip(SYMBOLS, COLOURS, strict=False):
        costs = np.maximum(study.profiles[symbol], 0.03)
        right.semilogy(FACTORS, costs, color=colour, label=symbol, **LINE)
    right.axhline(3.84, **LEVEL)
    right.text(FACTORS[0], 4.3, '95 %', color=MUTED, fontsize=8)
    dress(right, 'cost of the current of the bus cycles', xlabel='factor on the true value',
          ylabel='cost above its minimum [squares of the noise]')  # fmt: skip
    right.legend(**AT_RIGHT)
    return figure
