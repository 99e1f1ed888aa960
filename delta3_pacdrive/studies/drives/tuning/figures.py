"""Figures of a tuning: step responses, Bode plots with margins, recorded responses, effect on a program, sweep."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.axes import ARMS
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.drives.loops.analysis import LoopResult
from delta3_pacdrive.studies.drives.loops.disturbance import LOAD_N_M
from delta3_pacdrive.studies.drives.loops.identification import Measured
from delta3_pacdrive.studies.drives.loops.response import Complex, decibels, degrees
from delta3_pacdrive.studies.drives.tuning.effect import Effect
from delta3_pacdrive.studies.drives.tuning.measured_response import MeasuredResponse
from delta3_pacdrive.studies.drives.tuning.study import Results, SweepPoint, Variant
from delta3_pacdrive.studies.framework.figure_style import (
    AXIS_COLOURS,
    COLOURS,
    DASHED,
    MUTED,
    NORM_COLOUR,
    column_of_panels,
    dress,
    panel_title,
    titled_figure,
)
from delta3_pacdrive.studies.framework.report_folder import Drawings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Item = TypeVar('Item')
VARIANT_COLOURS = (COLOURS[0], COLOURS[1])  # before, after
DECIBELS = (-60.0, 60.0)  # shown range of an open loop
SHOWN = 1.5  # shown part of a step response, in settling times
CLOSED_DECIBELS = (-40.0, 12.0)
POINTS: dict[str, Any] = {'marker': 'o', 'markersize': 4, 'markerfacecolor': 'none', 'linestyle': 'none'}
LEGEND: dict[str, Any] = {'fontsize': 8, 'frameon': False}
TITLES = {
    'current': 'Current loop, shaft held',
    'velocity': 'Velocity loop',
    'position': 'Position loop',
    'cascade': 'All loops, open at the current set point',
}


def by_name(found: Results) -> Drawings:
    """Return the drawing functions of the figures by file name."""
    variants, by_loop = found.variants, found.by_loop
    drawings: dict[str, Any] = {'step.png': partial(steps, variants)}
    for name, results in by_loop.items():
        drawings[f'bode_{name}.png'] = partial(bode, results)
    drawings['effect.png'] = partial(effects, variants)
    if any(variant.rejection for variant in variants.values()):
        drawings['load_step.png'] = partial(load_step, variants)
    if found.points:
        drawings['sweep.png'] = partial(sweep, found.points, found.swept)
    for one in found.measured:
        loop = next(iter(by_loop[one.name].values())) if one.name in by_loop else None
        drawings[f'recorded_{one.name}.png'] = partial(measured_response, one, loop)
    return drawings


def steps(variants: dict[str, Variant]) -> Figure:
    """Draw the step responses of the three loops: drive on the bench and linear loop."""
    figure = titled_figure('Step responses', 4.6)
    panels, names = figure.subplots(1, 3), list(variants)
    for number, axes in enumerate(panels):
        lowest, highest, shown = 0.0, 1.2, 0.0
        loops = merged({name: variant.loops[number] for name, variant in variants.items()}, _same_step)
        for (name, loop), colour in zip(loops.items(), VARIANT_COLOURS, strict=False):
            if loop.step is None:
                axes.text(0.5, 0.35 - 0.08 * list(loops).index(name), f'{name}: the drive trips', color=colour,
                          transform=axes.transAxes, ha='center', fontsize=9)  # fmt: skip
                continue
            label = f'drive, {name}' + ('' if loop.stable else ': unstable')
            front = 3 if loop.stable else 2
            time_ms = 1e3 * loop.step.time_s
            axes.plot(time_ms, loop.step.drive, color=colour, linewidth=1.8, zorder=front, label=label)
            if loop.stable:
                axes.plot(time_ms, loop.step.linear, color='#111111', linewidth=0.9, zorder=4,
                          linestyle=DASHED, label='linear' if name == list(loops)[-1] else None)  # fmt: skip
            lowest = min(lowest, max(float(loop.step.drive.min()), -2.0))
            highest = max(highest, min(1.1 * float(loop.step.drive.max()), 4.0))
            settling = loop.step.figures.settling_time_s
            if loop.stable:
                shown = max(shown, float(loop.step.time_s[-1]) if settling is None else SHOWN * settling)
        axes.axhline(1.0, color=MUTED, linewidth=0.8)
        dress(axes, TITLES[variants[names[0]].loops[number].name], ylim=(1.1 * lowest - 0.05, highest),
              xlabel='time [ms]', xlim=(0.0, 1e3 * shown if shown > 0.0 else None))  # fmt: skip
    panels[0].set_ylabel('actual value, share of the step [1]')
    # a label marks an unstable loop, or equal variants
    entries = dict(
        pair for axes in panels for pair in zip(*reversed(axes.get_legend_handles_labels()), strict=True)
    )
    figure.legend(
        entries.values(),
        entries.keys(),
        loc='outside upper right',
        ncols=3 if len(entries) == 3 else 2,
        **LEGEND,
    )
    return figure


def bode(results: dict[str, LoopResult]) -> Figure:
    """Draw an open loop with margins and its closed loop: linear (lines) and drive on the bench (points)."""
    results = merged(results, _same_loop)
    first = next(iter(results.values()))
    closed = first.closed_loop is not None
    figure = titled_figure(TITLES[first.name], 6.0)
    grid = figure.subplots(2, 2 if closed else 1, sharex='col', squeeze=False)
    for (name, result), colour in zip(results.items(), VARIANT_COLOURS, strict=False):
        label = name if result.stable else f'{name}: unstable'
        linear = result.frequencies_hz, result.open_loop
        _curve(grid[:, 0], *linear, colour, f'linear, {label}')
        if result.measured_open is not None:
            _points(grid[:, 0], result.measured_open, linear, POINTS | {'color': colour}, f'drive, {name}')
        _mark_margins(grid[:, 0], result, colour)
    grid[1, 0].axhline(-180.0, color=MUTED, linewidth=0.8)
    panels = [('open loop L, margins marked', DECIBELS, 0.0)]
    if closed:
        panels.append(('closed loop, set point to actual value', CLOSED_DECIBELS, -3.0))
        top = grid[0, 1]
        for result, colour in zip(results.values(), VARIANT_COLOURS, strict=False):
            if result.closed_loop is None or not result.stable:
                continue
            linear = result.frequencies_hz[: len(result.closed_loop)], result.closed_loop
            _curve(grid[:, 1], *linear, colour)
            if result.measured_closed is not None:
                _points(grid[:, 1], result.measured_closed, linear, POINTS | {'color': colour})
            if result.bandwidth_hz is not None:
                label = f'bandwidth {_hertz(result.bandwidth_hz)}'
                style = {'color': colour, 'markersize': 6, 'markerfacecolor': 'white', 'linestyle': 'none'}
                top.plot(result.bandwidth_hz, -3.0, 's', label=label, **style)
        if top.get_legend_handles_labels()[0]:
            top.legend(fontsize=7, frameon=False, loc='lower left')
    for (top, bottom), (title, span, level) in zip(grid.T, panels, strict=True):
        top.axhline(level, color=MUTED, linewidth=0.8)
        dress(top, title, xscale='log', ylim=span, ylabel='magnitude [dB]')
        dress(bottom, xscale='log', ylim=(-360.0, 75.0), yticks=np.arange(-360.0, 1.0, 90.0),
              ylabel='phase [deg]', xlabel='frequency [Hz]')  # fmt: skip
    for axes in grid[:, 0]:
        axes.legend(fontsize=7, frameon=False, loc='upper right')
    return figure


def measured_response(one: MeasuredResponse, loop: LoopResult | None) -> Figure:
    """Draw a recorded response with the linear one and, if the loop was opened, the drive on the bench."""
    figure = titled_figure(f'Recorded: {one.title}, axis {one.axis}', 6.6)
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(2, 2, 1))
    frequencies, trusted = one.measured.frequencies_hz, one.measured.trusted
    linear, pair = (frequencies, one.linear), (top, middle)
    _curve(pair, *linear, '#111111', 'linear')
    dots: dict[str, Any] = {'marker': '.', 'linestyle': 'none'}
    _points(pair, one.measured, linear, dots | {'color': COLOURS[1]}, 'recorded', shown=trusted)
    _points(pair, one.measured, linear, dots | {'color': '#CCCCCC'}, 'recorded, not trusted', shown=~trusted)
    bench = None if loop is None else (loop.measured_closed if one.name == 'current' else loop.measured_open)
    if bench is not None:
        inside = (bench.frequencies_hz >= frequencies[0]) & (bench.frequencies_hz <= frequencies[-1])
        _points(pair, bench, linear, POINTS | {'color': COLOURS[0]}, 'drive on the bench', shown=inside)
    bottom.plot(frequencies, one.measured.coherence, color=COLOURS[1], linewidth=1.0)
    title = 'nothing is trusted'
    if (band := one.measured.band_hz()) is not None:
        title = f'trusted (shaded): {band[0]:.3g} to {band[1]:.4g} Hz'
        for axes in (top, middle, bottom):
            axes.axvspan(*band, color='#EEF5EE', zorder=0)
    dress(top, title, xscale='log', ylabel='magnitude [dB]')
    dress(middle, xscale='log', ylabel='phase [deg]')
    dress(bottom, xscale='log', ylabel='coherence [1]', ylim=(-0.05, 1.05), xlabel='frequency [Hz]')
    top.legend(loc='lower left', **LEGEND)
    return figure


def effects(variants: dict[str, Variant]) -> Figure:
    """Draw the following error of the drives and the TCP error over a program."""
    figure = titled_figure('Following error of the program', 6.6)
    axes = next((v.effect.axes for v in variants.values() if len(v.effect.time_s)), (1, 2, 3))
    drives = [f'arm {axis}' if axis <= ARMS else 'motor of the tool' for axis in axes]
    labels = [*(f'{drive}\n[mdeg]' for drive in drives), 'TCP error\n[µm]']
    panels = column_of_panels(figure, labels, 'time from the start of the program [s]')
    shown = merged({name: variant.effect for name, variant in variants.items()}, _same_effect)
    for (name, effect), colour in zip(shown.items(), VARIANT_COLOURS, strict=False):
        if not len(effect.time_s):
            panel_title(panels[0], f'{name}: {effect.fault}', color=colour)
            continue
        for i in range(len(axes)):
            panels[i].plot(effect.time_s, 1e3 * np.degrees(effect.following_error_rad[:, i]), color=colour,
                           linewidth=1.0, label=name if i == 0 else None)  # fmt: skip
        panels[-1].plot(effect.time_s, 1e6 * effect.tcp_error_m, color=colour, linewidth=1.0)
    if panels[0].get_legend_handles_labels()[0]:
        figure.legend(loc='outside upper right', ncols=2, **LEGEND)
    return figure


def load_step(variants: dict[str, Variant]) -> Figure:
    """Draw the deviation of the motor shaft after a load step."""
    figure = titled_figure(f'Step of the load by {LOAD_N_M:g} N m, motor side', 4.2)
    axes = figure.subplots()
    rejections = {name: variant.rejection for name, variant in variants.items() if variant.rejection}
    drawn = merged(rejections, lambda one, other: np.array_equal(one.deviation_rad, other.deviation_rad))
    latest = 0.0
    for (name, one), colour in zip(drawn.items(), VARIANT_COLOURS, strict=False):
        label = f'{name}; current by noise of the encoder {1e3 * one.noise_a:.1f} mA rms'
        axes.plot(1e3 * one.time_s, np.degrees(one.deviation_rad), color=colour, linewidth=1.6, label=label)
        latest = max(latest, one.back_s or float(one.time_s[-1]))
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    dress(axes, xlabel='time [ms]', ylabel='deviation of the shaft [deg]', xlim=(0.0, 1.3e3 * latest))
    axes.legend(loc='upper right', **LEGEND)
    return figure


def sweep(points: list[SweepPoint], swept: str) -> Figure:
    """Draw following error, phase margins and overshoots over a gain; the background marks instability."""
    figure = titled_figure(f'Sweep of {swept}', 7.0)
    top, middle, bottom = figure.subplots(3, 1, sharex=True)
    values = np.array([point.value for point in points])

    def series(read: Callable[[SweepPoint], float | None], scale: float) -> Floats:
        return np.array([np.nan if (v := read(point)) is None else scale * v for point in points])

    milli = 1e3 * 180.0 / np.pi
    for label, name, colour, marker in (
        ('max', 'following_error_max_rad', NORM_COLOUR, 'o'),
        ('rms', 'following_error_rms_rad', COLOURS[5], 's'),
    ):
        line = series(lambda point, name=name: getattr(point.effect, name), milli)  # type: ignore[misc]
        top.plot(values, line, marker=marker, color=colour, markersize=4, label=label)
    for n, (loop, colour, marker) in enumerate(zip(points[0].loops, AXIS_COLOURS, 'os^', strict=True)):
        style: dict[str, Any] = {'marker': marker, 'color': colour, 'markersize': 4, 'linewidth': 1.2}
        line = series(lambda point, n=n: point.loops[n].margins.phase_margin_deg, 1.0)  # type: ignore[misc]
        middle.plot(values, line, label=loop.name, **style)
        line = series(lambda point, n=n: point.overshoot[point.loops[n].name], 100.0)  # type: ignore[misc]
        stable = np.array([point.loops[n].stable for point in points])
        bottom.plot(values, np.where(stable, line, np.nan), **style)
    half = 0.5 * float(np.diff(values).min())
    for point in points:
        alone = all(loop.stable for loop in point.loops)
        if not alone or not point.workspace_stable or point.effect.fault:
            colour = '#F8DDDD' if not alone else '#FFF2D6'
            for axes in (top, middle, bottom):
                axes.axvspan(point.value - half, point.value + half, color=colour, zorder=0, linewidth=0)
    middle.axhline(0.0, color=MUTED, linewidth=0.8)
    title = 'red: a loop is unstable; yellow: one is somewhere in the workspace, or the program trips a drive'
    dress(top, title, ylabel='following error of the arm\n[mdeg]')
    dress(middle, ylabel='phase margin [deg]')
    dress(bottom, ylabel='overshoot of a step [%]', xlabel=f'{swept} [SI]')
    for axes in (top, middle):
        axes.legend(loc='center left', bbox_to_anchor=(1.0, 0.5), **LEGEND)
    return figure


def merged(items: dict[str, Item], alike: Callable[[Item, Item], bool]) -> dict[str, Item]:
    """Return items by name; two equal ones are merged under the name ``before and after``."""
    names = list(items)
    if len(names) == 2 and alike(items[names[0]], items[names[1]]):
        return {' and '.join(names): items[names[0]]}
    return items


def _same_loop(one: LoopResult, other: LoopResult) -> bool:
    return np.array_equal(one.open_loop, other.open_loop) and one.fault == other.fault


def _same_step(one: LoopResult, other: LoopResult) -> bool:
    if one.step is None or other.step is None:
        return False
    return np.array_equal(one.step.drive, other.step.drive)


def _same_effect(one: Effect, other: Effect) -> bool:
    return len(one.time_s) > 0 and np.array_equal(one.following_error_rad, other.following_error_rad)


def _curve(
    panels: Iterable[Axes], frequencies_hz: Floats, values: Complex, colour: str, label: str | None = None
) -> None:
    """Draw magnitude and phase of a linear response."""
    top, bottom = panels
    top.plot(frequencies_hz, decibels(values), color=colour, linewidth=1.3, label=label)
    bottom.plot(frequencies_hz, degrees(values), color=colour, linewidth=1.3)


def _points(
    panels: Iterable[Axes],
    measured: Measured,
    linear: tuple[Floats, Complex],
    style: dict[str, Any],
    label: str | None = None,
    shown: NDArray[np.bool_] | None = None,
) -> None:
    """Draw the trusted (or ``shown``) part of a measured response; its phase is shifted by turns to the linear one."""
    (top, bottom), shown = panels, measured.trusted if shown is None else shown
    if shown.any():
        at_hz = measured.frequencies_hz
        reference = np.interp(np.log(at_hz), np.log(linear[0]), degrees(linear[1]))
        phase = np.degrees(np.angle(measured.values))
        phase += 360.0 * np.round((reference - phase) / 360.0)
        top.plot(at_hz[shown], decibels(measured.values)[shown], label=label, **style)
        bottom.plot(at_hz[shown], phase[shown], **style)


def _hertz(frequency_hz: float) -> str:
    return f'{frequency_hz:.0f} Hz' if frequency_hz >= 100.0 else f'{frequency_hz:.3g} Hz'


def _mark_margins(panels: Iterable[Axes], result: LoopResult, colour: str) -> None:
    """Mark phase margin and gain margin of an open loop."""
    (top, bottom), m = panels, result.margins
    line: dict[str, Any] = {'color': colour, 'linewidth': 2.5, 'alpha': 0.6}
    if m.phase_margin_deg is not None and m.crossover_hz is not None:
        low, high = -180.0, -180.0 + m.phase_margin_deg
        at = np.log(m.crossover_hz)
        phase = float(np.interp(at, np.log(result.frequencies_hz), degrees(result.open_loop)))
        turn = 360.0 * round((phase - high) / 360.0)
        label = f'phase margin {m.phase_margin_deg:.0f} deg at {_hertz(m.crossover_hz)}'
        bottom.plot([m.crossover_hz] * 2, [low + turn, high + turn], '-', label=label, **line)
        top.plot(m.crossover_hz, 0.0, 'D', color=colour, markersize=6, markerfacecolor='white')
    if m.gain_margin_db is not None and m.gain_margin_hz is not None:
        label = f'gain margin {m.gain_margin_db:.1f} dB at {_hertz(m.gain_margin_hz)}'
        top.plot([m.gain_margin_hz] * 2, [-m.gain_margin_db, 0.0], '-', **line)
        bottom.plot(
            m.gain_margin_hz, -180.0, 'D', color=colour, markersize=6, markerfacecolor='white', label=label
        )
