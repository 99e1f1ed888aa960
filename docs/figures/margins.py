"""Why the gain margin of the velocity loop is larger than its continuous approximation says, piece by piece."""

from __future__ import annotations

from typing import TYPE_CHECKING

import delta3_pacdrive as d3
from delta3_pacdrive.studies.drives.loops.analysis import OperatingPoint
from delta3_pacdrive.studies.drives.loops.approximation import steps
from delta3_pacdrive.studies.drives.loops.load import extremes
from delta3_pacdrive.studies.framework.figure_style import AXIS_COLOURS, dress, empty_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN = AXIS_COLOURS
LABELS = (
    'approximation', 'low-pass sampled', 'hold not counted twice', 'means smaller', 'integrators sampled', 'the rest',
    'drive',
)  # fmt: skip
SPEED_RAD_S = 10.0


def make() -> Figure:
    """Draw the velocity loop of the lightest mode around -1, and what each piece adds to its gain margin."""
    robot = d3.load_parameters()
    found = steps(robot, OperatingPoint(extremes(robot)[0], SPEED_RAD_S))
    figure = empty_figure(4.2)
    left, right = figure.subplots(1, 2, width_ratios=(4, 5))
    for step, colour, label in ((found[0], ORANGE, 'approximation'), (found[-1], BLUE, 'drive')):
        left.plot(step.loop.real, step.loop.imag, color=colour, label=label)
        left.plot(-(10.0 ** (-step.gain_margin_db / 20.0)), 0.0, 'o', color=colour, markersize=5)
    left.plot(-1.0, 0.0, 'k+', markersize=9)
    left.annotate('-1', (-1.0, 0.0), (4, 5), textcoords='offset points')
    left.set(xlim=(-1.3, 0.1), ylim=(-0.6, 0.15), xlabel='real part of L', ylabel='imaginary part of L')
    left.legend(loc='lower left', fontsize=9, frameon=False)
    widths = [found[0].gain_margin_db, *(step.gained_db for step in found[1:]), found[-1].gain_margin_db]
    starts = [0.0, *(step.gain_margin_db - step.gained_db for step in found[1:]), 0.0]
    colours = [ORANGE, *[GREEN] * (len(found) - 1), BLUE]
    right.barh(range(len(widths)), widths, left=starts, color=colours)
    for place, (width, start) in enumerate(zip(widths, starts, strict=True)):
        text = f'{width:.2f}' if start == 0.0 else f'+{width:.2f}'
        right.annotate(
            text, (start + width, place), (4, 0), textcoords='offset points', va='center', fontsize=9
        )
    right.set(xlim=(10.5, 13.6), xlabel='gain margin [dB]')
    right.set_yticks(range(len(LABELS)), LABELS, fontsize=9)
    right.invert_yaxis()
    for axes in (left, right):
        dress(axes)
    return figure
