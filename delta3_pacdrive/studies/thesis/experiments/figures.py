"""Figures 11.1 to 11.24: model, robot and reference, and the attribution of the difference.

A second column shows deviations from the reference if the curves are indistinguishable. Figures are numbered from the
first one of their experiment: 11.1, 11.9, 11.17.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.studies.framework.figure_style import (
    COLOURS,
    MUTED,
    WHOLE,
    column_of_panels,
    dress,
    finish_over_time,
    frame_path,
    legend_above,
    panel_title,
    path_axes,
    titled_figure,
)
from delta3_pacdrive.studies.framework.report_folder import Drawings
from delta3_pacdrive.studies.runs.run_figures import COMMAND
from delta3_pacdrive.studies.runs.run_signals import SLOPE_S, ZOOM_S, busiest
from delta3_pacdrive.studies.thesis.experiments.attribution import EFFECTS, Attribution
from delta3_pacdrive.studies.thesis.experiments.compared_signals import QUANTITIES
from delta3_pacdrive.studies.thesis.experiments.comparison import Comparison
from delta3_pacdrive.studies.thesis.experiments.conclusions import OTHER
from delta3_pacdrive.studies.thesis.experiments.study import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

PER_EXPERIMENT = 8
ATTRIBUTION = 'attribution.png'
MARGIN = 5.0  # of the bars of the shares [%]
# panels of the figure of effects
SHARED_OUT = ('tcp_error_norm', 'current', 'arm_angle', 'tcp_error_norm_true')
MAGNIFIED = 0.06  # size of magnified deviations relative to the longest side of the path

# the robot's curve is noisier and is drawn below
MODEL: dict[str, Any] = {'color': COLOURS[0], 'linewidth': 1.4, 'solid_capstyle': 'round', 'zorder': 3.0}
ROBOT: dict[str, Any] = {'color': COLOURS[1], 'linewidth': 1.0, 'zorder': 2.5}
REFERENCE: dict[str, Any] = COMMAND | {'zorder': 3.5}
TRUE: dict[str, Any] = {'color': COLOURS[4], 'linewidth': 1.0}


def by_name(found: Results) -> Drawings:
    """Return the drawing functions of an experiment by file name."""
    number, comparison, attribution = found.number, found.comparison, found.attribution
    zoom = _zoom(comparison)
    # name: (signal, drawing function)
    drawn: dict[str, tuple[str, Any]] = {
        'tcp_path': ('tcp', tcp_path),
        'arm_angles': ('arm_angle', partial(panels, name='arm_angle', symbol=r'$\theta_{}$')),
        'arm_velocities': (
            'arm_speed',
            partial(panels, name='arm_speed', symbol=r'$\dot\theta_{}$', marked=zoom),
        ),
        'arm_velocities_zoom': (
            'arm_speed',
            partial(panels, name='arm_speed', symbol=r'$\dot\theta_{}$', shown=zoom),
        ),
        'arm_accelerations': (
            'arm_acceleration',
            partial(panels, name='arm_acceleration', symbol=r'$\ddot\theta_{}$'),
        ),
        'currents': ('current', partial(panels, name='current', symbol=r'$I_{{\mathrm{{eff}},{}}}$')),
        'tcp_components': ('tcp', partial(panels, name='tcp', symbol='{}')),
        'tcp_error_norm': ('tcp_error_norm', tcp_error_norm),
    }
    first = 1 + PER_EXPERIMENT * ((number or 1) - 1)
    made = {}
    for figure, (name, (signal, draw)) in enumerate(drawn.items(), start=first):
        if signal in comparison.names:
            heading = f'Fig. 11.{figure}, experiment {number}' if number else f'As Fig. 11.{figure}'
            made[f'figure_11_{figure:02d}_{name}.png'] = partial(draw, comparison, heading)
    if attribution is not None:
        made[ATTRIBUTION] = partial(effects, attribution, found.title)
    return made


def file_names(number: int | None) -> list[str]:
    """Return patterns of the figure names of an experiment, or of any two runs."""
    first = 1 + PER_EXPERIMENT * ((number or 1) - 1)
    return [
        ATTRIBUTION,
        *(f'figure_11_{figure:02d}_*.png' for figure in range(first, first + PER_EXPERIMENT)),
    ]


def panels(
    comparison: Comparison,
    title: str,
    name: str,
    symbol: str,
    shown: tuple[float, float] | None = None,
    marked: tuple[float, float] | None = None,
) -> Figure:
    """Curves of the three columns (left), and their deviations from the reference or from each other (right).

    ``shown`` is a time range [s], ``marked`` a shaded one.
    """
    quantity = QUANTITIES[name]
    heading = f'{title}: {_typeset(quantity.text)}' + (' (zoom)' if shown else '')
    sampled = name == 'current' and all(
        'current_at' in run.actual for run in (comparison.model, comparison.robot)
    )
    if sampled:
        heading += ' (mean, band of all samples, dots of the AT)'
    if name == 'arm_acceleration':
        heading += f' (slope of the velocity within ±{1e3 * SLOPE_S:g} ms)'
    figure = titled_figure(heading, 6.6)
    grid = figure.subplots(3, 2, sharex=True, width_ratios=(1.35, 1))
    begin, end = shown or (-math.inf, math.inf)
    keep = (comparison.time_s >= begin) & (comparison.time_s <= end)
    time_s, runs = comparison.time_s[keep], (comparison.model, comparison.robot)
    model, robot = (quantity.factor * run.actual[name][keep] for run in runs)
    referred = name in comparison.model.reference and name in comparison.robot.reference
    thin: dict[str, Any] = {}
    if sampled:
        _draw_samples(comparison, keep, grid[:, 0])
        thin = {'linewidth': 0.6}  # leaves the band visible
    for i, (left, right) in enumerate(grid):
        left.plot(time_s, model[:, i], label='model', **MODEL | thin)
        left.plot(time_s, robot[:, i], label='robot', **ROBOT | thin)
        if referred:
            own = [quantity.factor * run.reference[name][keep, i] for run in runs]
            left.plot(time_s, own[0], label='reference', **REFERENCE)
            right.plot(time_s, robot[:, i] - own[1], **ROBOT)
            right.plot(time_s, model[:, i] - own[0], **MODEL)
        else:
            right.plot(time_s, robot[:, i] - model[:, i], color=MUTED, linewidth=1.0)
    unit = quantity.shown_unit.replace('^2', '²')
    finish_over_time(grid[:, 0], [f'{symbol.format(column)} [{unit}]' for column in quantity.columns])
    finish_over_time(grid[:, 1])
    if marked is not None:
        for axes in grid.flat:
            axes.axvspan(*marked, color='#EEEEEE', zorder=0)
    _alike(grid[:, 1])
    if name in ('arm_acceleration', 'current'):
        _alike(grid[:, 0])
    text = 'deviation from the reference' if referred else 'robot - model'
    panel_title(grid[0, 1], f'{text} [{unit}]')
    legend_above(grid[0, 0])
    return figure


def _draw_samples(comparison: Comparison, keep: NDArray[np.bool_], panels: Sequence[Axes]) -> None:
    """Draw all samples of the currents as bands, and the samples in the AT as dots."""
    time_s = comparison.time_s[keep]
    for run, look in ((comparison.robot, ROBOT), (comparison.model, MODEL)):
        dots = {'color': look['color'], 'linestyle': 'none', 'marker': '.', 'markersize': 0.7, 'zorder': 2.2}
        for i, axes in enumerate(panels):
            low, high = run.actual['current_min'][keep, i], run.actual['current_max'][keep, i]
            axes.fill_between(time_s, low, high, color=look['color'], alpha=0.45, linewidth=0.0, zorder=2.0)
            axes.plot(time_s, run.actual['current_at'][keep, i], **dots)


def tcp_path(comparison: Comparison, title: str) -> Figure:
    """TCP path in space [mm], with the deviations of the robot magnified."""
    figure = titled_figure(f'{title}: TCP path', 6.0)
    axes = path_axes(figure, 0.14, 0.79)
    of_model, of_robot = comparison.model, comparison.robot
    known = next((run.reference['tcp'] for run in (of_model, of_robot) if 'tcp' in run.reference), None)
    reference = 1e3 * comparison.measured(of_model.actual['tcp'] if known is None else known)
    model, robot = (1e3 * comparison.measured(run.actual['tcp']) for run in (of_model, of_robot))
    axes.plot(*model.T, label='model', **MODEL | WHOLE | {'linewidth': 3.0})
    axes.plot(*robot.T, label='robot', **ROBOT | WHOLE | {'linewidth': 1.6, 'zorder': 3.2})
    if known is not None:
        axes.plot(*reference.T, label='reference', **REFERENCE, **WHOLE)
    drawn = [model, robot]
    longest = max(float(np.ptp(reference, axis=0).max()), 1.0)
    for name, look, label in (
        ('tcp', ROBOT, 'robot, deviation'),
        ('tcp_true', TRUE, 'its true TCP, deviation'),
    ):
        if name not in of_robot.actual or name not in of_robot.reference:
            continue
        base, off = of_robot.reference[name], of_robot.actual[name] - of_robot.reference[name]
        both = comparison.measured(1e3 * np.hstack([base, off]))
        farthest = max(float(np.linalg.norm(both[:, 3:], axis=1).max()), 1e-9)
        factor = _round_factor(MAGNIFIED * longest / farthest)
        drawn.append(both[:, :3] + factor * both[:, 3:])
        axes.plot(*drawn[-1].T, label=rf'{label} $\times$ {factor:g}', **look | WHOLE | {'linewidth': 0.7})
    frame_path(axes, np.concatenate(drawn))
    figure.legend(loc='lower center', ncols=5, frameon=False, fontsize=8, bbox_to_anchor=(0.5, 0.06))
    return figure


def tcp_error_norm(comparison: Comparison, title: str) -> Figure:
    """Norm of the TCP error [mm]: from encoders, true if known, and with set-point delay."""
    texts = {
        'tcp_error_norm': 'by forward kinematics of the encoders, set-point delay removed',
        'tcp_error_norm_true': 'true TCP of the real arms',
        'tcp_error_norm_raw': 'by the encoders, command and actual position of the same cycle',
    }
    names = [name for name in texts if name in comparison.names]
    figure = titled_figure(f'{title}: norm of the TCP error', 1.8 + 1.7 * len(names))
    column = column_of_panels(figure, ['error [mm]'] * len(names))
    for axes, name in zip(column, names, strict=True):
        top = 0.0
        hidden = {'linestyle': (0, (3, 3)), 'zorder': 3.5} if name == 'tcp_error_norm_raw' else {}
        looks = (comparison.model, 'model', MODEL), (comparison.robot, 'robot', ROBOT | hidden)
        for run, label, look in looks:
            values = QUANTITIES[name].factor * run.actual[name]
            axes.plot(comparison.time_s, values, label=label, **look)
            top = max(top, float(np.nanmax(values)))
        axes.set_ylim(0.0, max(1.08 * top, 1e-3))
        axes.set_title(texts[name], fontsize=9, loc='left' if axes is not column[0] else 'right')
    legend_above(column[0])
    return figure


def effects(attribution: Attribution, title: str) -> Figure:
    """Share of each effect in the mean-square deviations: Shapley values, alone, left out."""
    names = [name for name in SHARED_OUT if (name, 'deviation') in attribution.outcomes]
    labels = [*(_typeset(EFFECTS[name].text) for name in attribution.effects), OTHER]
    heading = f'{title}: causes of the mean-square deviation of robot from model'
    figure = titled_figure(heading, 2.6 + 0.34 * len(labels))
    row = figure.subplots(1, len(names), sharey=True, sharex=True)
    places = np.arange(len(labels))
    for axes, name in zip(row, names, strict=True):
        outcome = attribution.outcomes[name, 'deviation']
        total = outcome.total if outcome.total > 0.0 else math.nan
        share, alone, left_out = (
            100.0 / total * np.array([by[effect] for effect in attribution.effects])
            for by in (outcome.share, outcome.alone, outcome.left_out)
        )
        bars = [*share, 100.0 / total * outcome.other]
        axes.barh(places, bars, 0.62, color=COLOURS[0], alpha=0.85, label='share (Shapley)')
        axes.plot(alone, places[:-1], 'o', color=COLOURS[1], markersize=4.5, label='effect alone')
        axes.plot(left_out, places[:-1], 'x', color='#111111', markersize=5, label='without it')
        quantity = QUANTITIES[name]
        rms = quantity.factor * math.sqrt(max(outcome.total, 0.0))
        text = textwrap.fill(quantity.text, 16)
        axes.axvline(0.0, color=MUTED, linewidth=0.8)
        dress(axes, f'{_typeset(text)}\n{rms:.2g} {quantity.shown_unit} rms', xlabel='share [%]')
        axes.grid(visible=False, axis='y')
    # effects may cancel one another, so that shares are below 0 or above 100 %
    row[0].set_xlim(right=max(105.0, *(axes.dataLim.xmax + MARGIN for axes in row)))
    row[0].set_xlim(left=min(-12.0, *(axes.dataLim.xmin - MARGIN for axes in row)))
    row[0].set_yticks(places, labels)
    row[0].invert_yaxis()
    row[0].legend(
        loc='lower right', bbox_to_anchor=(-0.04, 1.0), frameon=False, fontsize=8, borderaxespad=0.0
    )
    return figure


def _zoom(comparison: Comparison) -> tuple[float, float]:
    """Return the 0.15 s [s] around the fastest change of speed; the whole time without recorded speeds."""
    for run in (comparison.model, comparison.robot):
        for values in (run.reference, run.actual):
            if 'arm_speed' in values:
                begin = busiest(comparison.time_s, values['arm_speed'])
                return begin, begin + ZOOM_S
    return float(comparison.time_s[0]), float(comparison.time_s[-1])


def _round_factor(factor: float) -> float:
    """Return the next smaller of 1, 2, 5, 10, 20 ..."""
    decade = 10.0 ** math.floor(math.log10(factor))
    return max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= factor)


def _alike(column: Sequence[Axes]) -> None:
    """Give panels the same scale."""
    limits = [axes.get_ylim() for axes in column]
    for axes in column:
        axes.set_ylim(min(low for low, _ in limits), max(high for _, high in limits))


def _typeset(text: str) -> str:
    """Return a text with its symbols in TeX."""
    return text.replace('I_eff', r'$I_{\mathrm{eff}}$').replace('K_m', '$K_m$')
