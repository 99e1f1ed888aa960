"""A pick from a moving belt: the cell from above with the way of the TCP, and how far the TCP is from the part."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.patches import Rectangle

from delta3_pacdrive import scripting
from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.studies.framework.figure_style import AXIS_COLOURS, dress, empty_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from delta3_pacdrive.recording.trace import Trace

BLUE, ORANGE, GREEN = AXIS_COLOURS
INK, MUTED, SURFACE = '#222222', '#666666', '#E8E8E8'
QUICK = {'speed_m_s': 4.0, 'acceleration_m_s2': 40.0, 'jerk_m_s3': 4000.0}
ORIGIN_MM, LENGTH_MM, WIDTH_MM = (-700.0, 100.0, -870.0), 1500.0, 200.0
WINDOW_MM, BARRIER_MM, SIZE_MM = (400.0, 1100.0), 300.0, (60.0, 40.0, 20.0)
TRAY_MM = (0.0, -200.0, -870.0)
AROUND = {
    'cup': {'output': 'gripper', 'diameter_mm': 60, 'vacuum_pa': 60000, 'build_up_s': 0.006},
    'parts': {'bar': {'mass_kg': 0.2, 'size_mm': list(SIZE_MM), 'friction': 0.5}},
    'boxes': {'tray': {'at_mm': list(TRAY_MM)}},
    'belts': {
        'line': {
            'origin_mm': list(ORIGIN_MM),
            'length_mm': LENGTH_MM,
            'width_mm': WIDTH_MM,
            'encoder': {'bits': 14, 'circumference_mm': 200},
            'speed': [{'after_s': 0, 'speed_m_s': 0.5}],
            'stream': {'part': 'bar', 'count': 1, 'spacing_mm': 400},
            'barrier': {'at_mm': BARRIER_MM, 'delay_s': 0.0005},
            'window_mm': list(WINDOW_MM),
        }
    },
}


def make() -> Figure:
    """Draw a pick on a belt of 0.5 m/s."""
    trace = _picked()
    told = trace.meta['cell']['parts'][0]
    tcp_mm, along_mm = 1e3 * trace['tcp_true'], 1e3 * trace['cell_belts'][:, 0]
    top_mm = np.column_stack(
        [
            ORIGIN_MM[0] + along_mm,
            np.full(len(along_mm), ORIGIN_MM[1]),
            np.full(len(along_mm), ORIGIN_MM[2] + SIZE_MM[2]),
        ]
    )
    cycle_s = trace.meta['cycle_time_s']
    taken = int(np.searchsorted(trace.time_s / cycle_s, told['picked_cycle'] - 0.5))
    figure = empty_figure(3.2)
    left, right = figure.subplots(1, 2, width_ratios=(1.7, 1.0))
    _from_above(left, tcp_mm, taken, top_mm[taken])
    far_mm = np.linalg.norm(tcp_mm - top_mm, axis=1)
    lifted = taken + int(np.argmax(far_mm[taken:] > 1.0))
    shown = slice(max(taken - 450, 0), lifted + 40)
    time_s = cycle_s * (np.arange(len(far_mm)) - taken)
    right.semilogy(time_s[shown], far_mm[shown], color=BLUE, linewidth=1.6)
    right.axvline(0.0, color=ORANGE, linewidth=1.2)
    right.text(-0.01, 200.0, 'in hand', color=ORANGE, fontsize=9, ha='right')
    dress(right)
    right.set_yticks(ticks := [0.01, 0.1, 1.0, 10.0, 100.0], [f'{tick:g}' for tick in ticks])
    right.minorticks_off()
    right.set(xlabel='time from the pick [s]', ylabel='true TCP to the top\nof the part [mm]')
    return figure


def _picked() -> Trace:
    """Return the trace of a script that picks one part from the belt."""
    with scripting.simulate(cell=cell_file.parse(AROUND), signals=['cell_belts']) as robot:
        with robot.track('line', timeout_s=5.0, **QUICK):
            robot.move_l(to_mm=[0, 0, 40], **QUICK)
            robot.move_l(to_mm=[0, 0, 20], **QUICK)
            robot.output('gripper', True, payload_kg=0.2)
            robot.dwell(0.06)
            robot.move_l(to_mm=[0, 0, 40], **QUICK)
        robot.arch(to_mm=[0, -200, -850], up_mm=20, down_mm=20, **QUICK)
        robot.output('gripper', False, payload_kg=0.0)
        robot.dwell(0.05)
    return robot.trace


def _from_above(axes: Axes, tcp_mm: np.ndarray, taken: int, part_mm: np.ndarray) -> None:
    """Draw belt, light barrier, window, part, tray, and the way of the TCP."""
    x, y = ORIGIN_MM[:2]
    axes.add_patch(Rectangle((x, y - WIDTH_MM / 2), LENGTH_MM, WIDTH_MM, facecolor=SURFACE, edgecolor=MUTED))
    begin, end = WINDOW_MM
    axes.add_patch(
        Rectangle(
            (x + begin, y - WIDTH_MM / 2), end - begin, WIDTH_MM, facecolor=GREEN, alpha=0.2, edgecolor='none'
        )
    )
    axes.plot([x + BARRIER_MM] * 2, [y - WIDTH_MM / 2 - 30, y + WIDTH_MM / 2 + 30], '--', color=ORANGE)
    axes.annotate('', (x + 230, y), (x + 40, y), arrowprops={'arrowstyle': '-|>', 'color': INK})
    for place, name in ((part_mm, ''), (TRAY_MM, 'tray')):
        axes.add_patch(
            Rectangle(
                (place[0] - SIZE_MM[0] / 2, place[1] - SIZE_MM[1] / 2),
                *SIZE_MM[:2],
                facecolor='white',
                edgecolor=INK,
            )
        )
        axes.text(place[0] + 45, place[1] - 14, name, fontsize=9, color=INK)
    axes.plot(tcp_mm[:, 0], tcp_mm[:, 1], color=BLUE, linewidth=1.4)
    axes.plot(*tcp_mm[taken, :2], 'o', color=BLUE, markersize=4)
    axes.text(x + BARRIER_MM, y + WIDTH_MM / 2 + 45, 'light barrier', fontsize=9, color=ORANGE, ha='center')
    axes.text(x + end - 15, y - WIDTH_MM / 2 + 15, 'window', fontsize=9, color=GREEN, ha='right')
    axes.text(x + 40, y + 25, 'belt', fontsize=9, color=INK)
    axes.text(part_mm[0] - 30, part_mm[1] + 40, 'part, when it is taken', fontsize=9, color=INK)
    dress(axes)
    axes.set(
        xlabel='x [mm]', ylabel='y [mm]', xlim=(x - 30, x + LENGTH_MM + 30), ylim=(-320, 330), aspect='equal'
    )
