"""Figures of a tuning: steps, Bode plots with margins, what a recording tells, the effect on a program, a sweep."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.analysis.figure_style import (
    AXIS_COLOURS,
    COLOURS,
    DASHED,
    MUTED,
    NORM_COLOUR,
    dress,
    panel_title,
    report_figure,
)
from delta3_pacdrive.analysis.tuning.response import decibels, degrees

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from delta3_pacdrive.analysis.provenance import Provenance
    from delta3_pacdrive.analysis.report_folder import Drawings
    from delta3_pacdrive.analysis.tuning.analysis import LoopResult
    from delta3_pacdrive.analysis.tuning.identification import Measured
    from delta3_pacdrive.analysis.tuning.measured_response import MeasuredResponse
    from delta3_pacdrive.analysis.tuning.study import Results, SweepPoint, Variant
    from delta3_pacdrive.numerics.types import Floats

WAYS = (COLOURS[0], COLOURS[1])  # before, after
DECIBELS = (-60.0, 60.0)  # of what is shown of an open loop
SHOWN = 1.5  # of the longest settling time, of a step response
CLOSED_DECIBELS = (-40.0, 12.0)
TITLES = {
    'current': 'Current loop, shaft held',
    'velocity': 'Velocity loop',
    'position': 'Position loop',
    'cascade': 'All loops, open at the current set point',
}


def by_name(found: Results, provenance: Provenance) -> Drawings:
    """Return what draws each figure, by file name."""
    variants, by_loop = found.variants, found.by_loop
    drawings: dict[str, Any] = {'step.png': partial(steps, variants, provenance)}
    for name, results in by_loop.items():
        drawings[f'bode_{name}.png'] = partial(bode, results, provenance)
    drawings['effect.png'] = partial(effects, variants, provenance)
    if found.points:
        drawings['sweep.png'] = partial(sweep, found.points, found.swept, provenance)
    for one in found.measured:
        loop = next(iter(by_loop[one.name].values())) if one.name in by_loop else None
        drawings[f'recorded_{one.name}.png'] = partial(measured_response, one, loop, provenance)
    return drawings


def steps(variants: dict[str, Variant], provenance: Provenance) -> Figure:
    """Step responses of the three loops: the drive on the bench, and the linear loop."""
    figure = report_figure('Step responses', 4.6, provenance)
    panels, names = figure.subplots(1, 3), list(variants)
    for number, axes in enumerate(panels):
        lowest, highest, shown = 0.0, 1.2, 0.0
        for (name, variant), colour in zip(variants.items(), WAYS, strict=False):
            loop = variant.loops[number]
            if loop.step is None:
                axes.text(0.5, 0.35 - 0.08 * names.index(name), f'{name}: the drive trips', color=colour,
                          transform=axes.transAxes, ha='center', fontsize=9)  # fmt: skip
                continue
            label = f'drive, {name}' + ('' if loop.stable else ': unstable')
            front = 3 if loop.stable else 2
            time_ms = 1e3 * loop.step.time_s
            axes.plot(time_ms, loop.step.drive, color=colour, linewidth=1.8, zorder=front, label=label)
            if loop.stable:
                axes.plot(time_ms, loop.step.linear, color='#111111', linewidth=0.9, zorder=4,
                          linestyle=DASHED, label='linear' if name == names[-1] else None)  # fmt: skip
            lowest = min(lowest, max(float(loop.step.drive.min()), -2.0))
            highest = max(highest, min(1.1 * float(loop.step.drive.max()), 4.0))
            settling = loop.step.figures.settling_time_s
            if loop.stable:
                shown = max(shown, float(loop.step.time_s[-1]) if settling is None else SHOWN * settling)
        axes.axhline(1.0, color=MUTED, linewidth=0.8)
        axes.set_ylim(1.1 * lowest - 0.05, highest)
        axes.set_xlabel('time (ms)')
        panel_title(axes, TITLES[variants[names[0]].loops[number].name])
        axes.set_xlim(0.0, 1e3 * shown if shown > 0.0 else None)
        dress(axes)
    panels[0].set_ylabel('actual value, share of the step (1)')
    # a loop that is not stable is told in the label: the last panel has them all
    handles, labels = panels[-1].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=8, frameon=False, loc='outside upper right', ncols=len(labels))
    return figure


def bode(results: dict[str, LoopResult], provenance: Provenance) -> Figure:
    """Open loop with its margins and closed loop: linear lines, points of the drive on the bench."""
    first = next(iter(results.values()))
    closed = first.closed_loop is not None
    figure = report_figure(TITLES[first.name], 6.0, provenance)
    grid = figure.subplots(2, 2 if closed else 1, sharex='col', squeeze=False)
    (top, bottom) = grid[:, 0]
    for (name, result), colour in zip(results.items(), WAYS, strict=False):
        label = name if result.stable else f'{name}: unstable'
        _curve(top, bottom, result.frequencies_hz, result.open_loop, colour, f'linear, {label}')
        if result.measured_open is not None:
            _points(
                top,
                bottom,
                result.measured_open,
                result.open_loop,
                result.frequencies_hz,
                colour,
                f'drive, {name}',
            )
        _mark_margins(top, bottom, result, colour)
    top.set_ylim(*DECIBELS)
    top.axhline(0.0, color=MUTED, linewidth=0.8)
    bottom.axhline(-180.0, color=MUTED, linewidth=0.8)
    bottom.set_ylim(-360.0, 75.0)
    panel_title(top, 'open loop L, margins marked')
    if closed:
        (top, bottom) = grid[:, 1]
        for result, colour in zip(results.values(), WAYS, strict=False):
            values = result.closed_loop
            if values is None or not result.stable:
                continue
            frequencies = result.frequencies_hz[: len(values)]
            _curve(top, bottom, frequencies, values, colour, None)
            if result.measured_closed is not None:
                _points(top, bottom, result.measured_closed, values, frequencies, colour, None)
            if result.bandwidth_hz is not None:
                label = f'bandwidth {_hertz(result.bandwidth_hz)}'
                style = {'color': colour, 'markersize': 6, 'markerfacecolor': 'white', 'linestyle': 'none'}
                top.plot(result.bandwidth_hz, -3.0, 's', label=label, **style)
        if top.get_legend_handles_labels()[0]:
            top.legend(fontsize=7, frameon=False, loc='lower left')
        top.set_ylim(*CLOSED_DECIBELS)
        top.axhline(-3.0, color=MUTED, linewidth=0.8)
        bottom.set_ylim(-360.0, 75.0)
        panel_title(top, 'closed loop, set point to actual value')
    for axes in grid.flat:
        axes.set_xscale('log')
        dress(axes)
    for axes in grid[0]:
        axes.set_ylabel('magnitude (dB)')
    for axes in grid[1]:
        axes.set_ylabel('phase (deg)')
        axes.set_yticks(np.arange(-360.0, 1.0, 90.0))
        axes.set_xlabel('frequency (Hz)')
    grid[0, 0].legend(fontsize=7, frameon=False, loc='upper right')
    grid[1, 0].legend(fontsize=7, frameon=False, loc='upper right')
    return figure


def measured_response(one: MeasuredResponse, loop: LoopResult | None, provenance: Provenance) -> Figure:
    """Response of a recording with the linear one and, of a loop that was opened, the drive on the bench."""
    figure = report_figure(f'Recorded: {one.title}, axis {one.axis}', 6.6, provenance)
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(2, 2, 1))
    frequencies, trusted = one.measured.frequencies_hz, one.measured.trusted
    _curve(top, middle, frequencies, one.linear, '#111111', 'linear')
    for mask, colour, label in (
        (trusted, COLOURS[1], 'recorded'),
        (~trusted, '#CCCCCC', 'recorded, not trusted'),
    ):
        if mask.any():
            phase = _phase_near(one.measured.values, one.linear, frequencies, frequencies)
            top.plot(frequencies[mask], decibels(one.measured.values)[mask], '.', color=colour, label=label)
            middle.plot(frequencies[mask], phase[mask], '.', color=colour)
    bench = None if loop is None else (loop.measured_closed if one.name == 'current' else loop.measured_open)
    if bench is not None and loop is not None:
        inside = (bench.frequencies_hz >= frequencies[0]) & (bench.frequencies_hz <= frequencies[-1])
        reference = _phase_near(bench.values, one.linear, bench.frequencies_hz, frequencies)
        top.plot(bench.frequencies_hz[inside], decibels(bench.values)[inside], 'o', color=COLOURS[0], markersize=4,
                 markerfacecolor='none', label='drive on the bench')  # fmt: skip
        middle.plot(bench.frequencies_hz[inside], reference[inside], 'o', color=COLOURS[0], markersize=4,
                    markerfacecolor='none')  # fmt: skip
    bottom.plot(frequencies, one.measured.coherence, color=COLOURS[1], linewidth=1.0)
    band = one.measured.band_hz()
    for axes in (top, middle, bottom):
        if band is not None:
            axes.axvspan(*band, color='#EEF5EE', zorder=0)
        axes.set_xscale('log')
        dress(axes)
    top.set_ylabel('magnitude (dB)')
    middle.set_ylabel('phase (deg)')
    bottom.set_ylabel('coherence (1)')
    bottom.set_ylim(-0.05, 1.05)
    bottom.set_xlabel('frequency (Hz)')
    told = 'nothing is trusted' if band is None else f'trusted (shaded): {band[0]:.3g} to {band[1]:.4g} Hz'
    panel_title(top, told)
    top.legend(fontsize=8, frameon=False, loc='lower left')
    return figure


def effects(variants: dict[str, Variant], provenance: Provenance) -> Figure:
    """Following error of the arms and TCP error over a program."""
    figure = report_figure('Following error of the program', 6.6, provenance)
    panels = figure.subplots(4, 1, sharex=True)
    for (name, variant), colour in zip(variants.items(), WAYS, strict=False):
        effect = variant.effect
        if not len(effect.time_s):
            panel_title(panels[0], f'{name}: {effect.fault}', color=colour)
            continue
        for i in range(3):
            panels[i].plot(effect.time_s, 1e3 * np.degrees(effect.following_error_rad[:, i]), color=colour,
                           linewidth=1.0, label=name if i == 0 else None)  # fmt: skip
        panels[3].plot(effect.time_s, 1e6 * effect.tcp_error_m, color=colour, linewidth=1.0)
    for i, axes in enumerate(panels):
        axes.set_ylabel(f'arm {i + 1}\n(0.001 deg)' if i < 3 else 'TCP error\n(um)')
        axes.margins(x=0.0)
        dress(axes)
    panels[3].set_xlabel('time from the start of the program (s)')
    figure.align_ylabels(panels)
    if panels[0].get_legend_handles_labels()[0]:
        figure.legend(fontsize=8, frameon=False, loc='outside upper right', ncols=2)
    return figure


def sweep(points: list[SweepPoint], swept: str, provenance: Provenance) -> Figure:
    """Following error, phase margins and overshoots over a gain; the ground tells where it is not stable."""
    figure = report_figure(f'Sweep of {swept}', 7.0, provenance)
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
    top.set_ylabel('following error\n(0.001 deg, arm)')
    middle.set_ylabel('phase margin (deg)')
    middle.axhline(0.0, color=MUTED, linewidth=0.8)
    bottom.set_ylabel('overshoot of a step (%)')
    bottom.set_xlabel(f'{swept} (SI)')
    told = 'red: a loop is unstable; yellow: one is somewhere in the workspace, or the program trips a drive'
    panel_title(top, told)
    for axes in (top, middle):
        axes.legend(fontsize=8, frameon=False, loc='center left', bbox_to_anchor=(1.0, 0.5))
    for axes in (top, middle, bottom):
        dress(axes)
    return figure


def _curve(
    top: Axes,
    bottom: Axes,
    frequencies_hz: Floats,
    values: NDArray[np.complex128],
    colour: str,
    label: str | None,
) -> None:
    top.plot(frequencies_hz, decibels(values), color=colour, linewidth=1.3, label=label)
    bottom.plot(frequencies_hz, degrees(values), color=colour, linewidth=1.3)


def _points(
    top: Axes,
    bottom: Axes,
    measured: Measured,
    linear: NDArray[np.complex128],
    grid_hz: Floats,
    colour: str,
    label: str | None,
) -> None:
    good = measured.trusted
    style: dict[str, Any] = {'color': colour, 'markersize': 4, 'markerfacecolor': 'none', 'linestyle': 'none'}
    phase = _phase_near(measured.values, linear, measured.frequencies_hz, grid_hz)
    top.plot(measured.frequencies_hz[good], decibels(measured.values)[good], 'o', label=label, **style)
    bottom.plot(measured.frequencies_hz[good], phase[good], 'o', **style)


def _phase_near(
    values: NDArray[np.complex128], linear: NDArray[np.complex128], at_hz: Floats, grid_hz: Floats
) -> Floats:
    """Phase [deg] of a measured curve, on the turn of the linear one that is drawn with it."""
    reference = np.interp(np.log(at_hz), np.log(grid_hz), degrees(linear))
    phase = np.degrees(np.angle(values))
    return np.asarray(phase + 360.0 * np.round((reference - phase) / 360.0))


def _hertz(frequency_hz: float) -> str:
    return f'{frequency_hz:.0f} Hz' if frequency_hz >= 100.0 else f'{frequency_hz:.3g} Hz'


def _mark_margins(top: Axes, bottom: Axes, result: LoopResult, colour: str) -> None:
    """Mark phase margin and gain margin of an open loop."""
    m = result.margins
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
