"""Four bus cycles: which telegram goes when, and when a command is reached."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import delta3_pacdrive as d3
from delta3_pacdrive.studies.framework.figure_style import AXIS_COLOURS, dress, empty_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN = AXIS_COLOURS
LANES = {'controller': 2.0, 'drive': 1.0, 'plant': 0.0}
CYCLES = 4
FLIGHT_MS = 0.12  # of a telegram, as drawn
COMMAND = np.array([0.0, 0.0, 1.0, 2.0, 3.0, 4.0])  # of MDT(-1), MDT(0) ...


def make() -> Figure:
    """Draw telegrams between controller, drive and plant, and the set point of a drive."""
    robot = d3.load_parameters()
    cycle_ms = 1e3 * robot.bus.cycle_time_s
    quarter_ms = 1e3 * robot.drive.position_period_s
    figure = empty_figure(5.0)
    top, bottom = figure.subplots(2, sharex=True, height_ratios=(1.15, 1.0))
    _draw_telegrams(top, cycle_ms)
    _draw_set_points(bottom, cycle_ms, quarter_ms, robot.set_point_delay_cycles * cycle_ms)
    bottom.set_xlim(-0.3, CYCLES * cycle_ms - 0.2)
    bottom.set_xticks(np.arange(CYCLES) * cycle_ms, ['cycle k', 'k + 1', 'k + 2', 'k + 3'])
    return figure


def _draw_telegrams(axes: Axes, cycle_ms: float) -> None:
    axes.set(ylim=(-0.4, 2.4), yticks=list(LANES.values()), yticklabels=list(LANES))
    axes.spines[['top', 'right', 'bottom']].set_visible(False)
    axes.tick_params(length=0.0)
    for y in LANES.values():
        axes.axhline(y, color='#888888', linewidth=1.0)
    for k in range(CYCLES):
        start = k * cycle_ms
        axes.axvline(start, color='#DDDDDD', linewidth=0.8, zorder=0)
        number = f'k + {k}' if k else 'k'
        _arrow(axes, start, 'controller', 'drive', BLUE, f'MDT({number})')
        _arrow(axes, start + FLIGHT_MS + 0.05, 'drive', 'controller', ORANGE, f'AT({number})')
        _arrow(axes, start + 0.01, 'plant', 'drive', GREEN, 'shafts')
        _arrow(axes, start + 0.42, 'drive', 'plant', ORANGE, r'16 $\times$ $I_{eff}$')
    axes.tick_params(labelsize=10)


def _arrow(axes: Axes, start_ms: float, sender: str, receiver: str, colour: str, name: str) -> None:
    y0, y1 = LANES[sender], LANES[receiver]
    style = {'arrowstyle': '-|>', 'color': colour, 'linewidth': 1.2, 'shrinkA': 0, 'shrinkB': 0}
    axes.annotate('', (start_ms + FLIGHT_MS, y1), (start_ms, y0), arrowprops=style)
    up = sender == 'drive' and receiver == 'controller'
    x, side = (
        (start_ms + FLIGHT_MS * 0.75 + 0.03, 'left')
        if up or sender != 'controller'
        else (start_ms - 0.02, 'right')
    )
    axes.text(
        x, (y0 + y1) / 2 + (0.12 if up else -0.12), name, fontsize=8.5, color=colour, ha=side, va='center'
    )


def _draw_set_points(axes: Axes, cycle_ms: float, quarter_ms: float, delay_ms: float) -> None:
    dress(axes)
    cycles = np.arange(CYCLES)
    axes.plot(
        cycles * cycle_ms, COMMAND[1 : CYCLES + 1], 'o', color=BLUE, label='command of MDT(k)', zorder=4
    )
    steps = round(cycle_ms / quarter_ms)
    times, values = [], []
    for k in range(CYCLES):
        before, after = COMMAND[max(k - 1, 0)], COMMAND[k]
        for n in range(steps):
            times.append(k * cycle_ms + n * quarter_ms)
            values.append(before + (after - before) * (n + 1) / steps)
    axes.step(times, values, where='post', color=ORANGE, label='set point in the drive', linewidth=1.6)
    reached = cycle_ms + delay_ms
    axes.annotate('', (reached, 1.0), (cycle_ms, 1.0), arrowprops={'arrowstyle': '<|-|>', 'color': '#555555'})
    axes.text(
        cycle_ms + delay_ms / 2,
        1.08,
        f'{delay_ms:g} ms',
        fontsize=9,
        color='#555555',
        ha='center',
        va='bottom',
    )
    axes.set(ylabel='position', yticks=[], ylim=(-0.3, 3.4))
    axes.legend(fontsize=9, frameon=False, loc='upper left')
