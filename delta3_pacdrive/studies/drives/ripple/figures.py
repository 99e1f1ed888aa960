"""Figures of the ripple: signals inside a bus cycle, and all current samples of a program."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.studies.framework.figure_style import (
    AXIS_COLOURS,
    COLOURS,
    MUTED,
    dress,
    finish_over_time,
    panel_title,
    titled_figure,
)
from delta3_pacdrive.studies.framework.report_folder import Drawings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from delta3_pacdrive.studies.drives.ripple.study import Case, Results

CURRENTS = 'currents.png'
CYCLES_SHOWN = (1, 2)  # bus cycles before the selected one, and from it on
REFERENCE: dict[str, Any] = {'color': '#111111', 'linewidth': 1.0}
ACTUAL: dict[str, Any] = {'color': AXIS_COLOURS[0], 'linewidth': 1.6}
AT: dict[str, Any] = {'color': COLOURS[1], 'linestyle': 'none', 'marker': 'o', 'markersize': 4}


def by_name(found: Results) -> Drawings:
    """Return the drawing function of each figure by file name."""
    times = sorted({case.cycle_time_s for case in found.cases})
    drawings: dict[str, Any] = {}
    for cycle_time_s in times:
        cases = [case for case in found.cases if case.cycle_time_s == cycle_time_s]
        drawings[_inside_name(cycle_time_s)] = partial(inside_a_cycle, found, cases)
    drawings[CURRENTS] = partial(currents, found)
    return drawings


def _inside_name(cycle_time_s: float) -> str:
    return f'inside_a_cycle_{1e3 * cycle_time_s:g}ms.png'


def inside_a_cycle(found: Results, cases: list[Case]) -> Figure:
    """Set point, speed, current and voltage of a motor inside a bus cycle, in every period of the current loop."""
    cycle_s = cases[0].cycle_time_s
    title = f'Inside a bus cycle of {1e3 * cycle_s:g} ms: {found.program}, motor {found.axis}'
    figure = titled_figure(title, 7.4, parse_math=False)
    grid = figure.subplots(4, len(cases), sharex=True, sharey='row', squeeze=False)
    first = round(found.shown_s / cycle_s)
    begin, end = (first - CYCLES_SHOWN[0]) * cycle_s, (first + CYCLES_SHOWN[1]) * cycle_s
    for column, case in zip(grid.T, cases, strict=True):
        s = case.samples
        keep = (s.time_s >= begin - 1e-9) & (s.time_s < end - 1e-9)
        shown = (s.at_time_s >= begin - 1e-9) & (s.at_time_s < end + 1e-9)
        time_ms = 1e3 * (s.time_s[keep] - first * cycle_s)
        at_ms = 1e3 * (s.at_time_s[shown] - first * cycle_s)
        period_ms = 1e3 * float(s.time_s[1] - s.time_s[0])
        origin = s.set_point[keep][0]
        position, speed, current, voltage = column
        position.step(
            time_ms, 1e3 * (s.set_point[keep] - origin), where='post', label='set point', **REFERENCE
        )
        speed.step(time_ms, s.speed_reference[keep], where='post', label='reference', **REFERENCE)
        speed.plot(time_ms, s.speed[keep], label='shaft', **ACTUAL)
        current.step(time_ms, s.current_reference[keep], where='post', label='reference', **REFERENCE)
        current.plot(time_ms + period_ms, s.current[keep], label='all samples', **ACTUAL)
        current.plot(at_ms, s.at_current[shown], label='sample in the AT', zorder=4, **AT)
        voltage.step(time_ms, s.voltage[keep], where='post', label='of a phase', **ACTUAL)
        for axes in column:
            axes.axvspan(0.0, 1e3 * cycle_s, color='#EEEEEE', zorder=0)
        panel_title(position, case.interpolation)
        finish_over_time(column, what='time from the start of the bus cycle [ms]')
    labels = ('set point [mrad]', 'speed [rad/s]', 'current [A]', 'voltage [V]')
    for axes, label in zip(grid[:, 0], labels, strict=True):
        axes.set_ylabel(label)
    for axes in grid[1:3, -1]:
        axes.legend(loc='best', frameon=False, fontsize=8)
    return figure


def currents(found: Results) -> Figure:
    """All current samples of a motor, and the samples in the AT."""
    times = sorted({case.cycle_time_s for case in found.cases})
    names = list(dict.fromkeys(case.interpolation for case in found.cases))
    figure = titled_figure(
        f'Motor currents: {found.program}, motor {found.axis}', 1.6 + 1.9 * len(times), parse_math=False
    )
    grid = figure.subplots(len(times), len(names), sharex=True, sharey=True, squeeze=False)
    for case in found.cases:
        axes = grid[times.index(case.cycle_time_s), names.index(case.interpolation)]
        s = case.samples
        steps = round(case.cycle_time_s / float(s.time_s[1] - s.time_s[0]))
        of_cycles = s.current[: len(s.at_time_s) * steps].reshape(-1, steps)
        middle = s.at_time_s + 0.5 * case.cycle_time_s
        axes.fill_between(
            middle,
            of_cycles.min(axis=1),
            of_cycles.max(axis=1),
            color=COLOURS[5],
            linewidth=0.0,
            label='all samples',
        )
        axes.plot(middle, np.mean(of_cycles, axis=1), label='mean of a cycle', **ACTUAL | {'linewidth': 0.9})
        axes.plot(s.at_time_s, s.at_current, label='sample in the AT', **AT | {'markersize': 0.9})
        i = found.axis - 1
        dress(axes, f'{1e3 * case.cycle_time_s:g} ms, {case.interpolation}')
        axes.annotate(
            f'{case.current_peak_a[i]:.2f} / {case.current_rms_a[i]:.2f} A, '
            f'AT {case.at_current_peak_a[i]:.2f} / {case.at_current_rms_a[i]:.2f} A',
            (1.0, 1.02), xycoords='axes fraction', ha='right', fontsize=7, color=MUTED,
        )  # fmt: skip
        axes.margins(x=0.0)
    for axes in grid[:, 0]:
        axes.set_ylabel('current [A]')
    for axes in grid[-1]:
        axes.set_xlabel('time from program start [s]')
    grid[0, -1].legend(loc='lower left', frameon=False, fontsize=8)
    return figure
