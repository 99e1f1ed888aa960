"""Figures of a line: load of the robots, and arrived, picked and missed parts over the shift."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from delta3_pacdrive.studies.fleet.line.report import MINUTE_S, by_minute
from delta3_pacdrive.studies.framework.figure_style import COLOURS, dress, titled_figure
from delta3_pacdrive.studies.framework.report_folder import Drawings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from delta3_pacdrive.studies.fleet.line.study import Results

ROBOTS, MINUTES = 'robots.png', 'minutes.png'
MISSED = '#d92d3a'
POINTS_MAX = 60  # of a curve; longer shifts are drawn in longer steps


def by_name(results: Results) -> Drawings:
    """Return the drawing functions of the figures by file name."""
    return {ROBOTS: partial(robots_figure, results), MINUTES: partial(minutes_figure, results)}


def robots_figure(results: Results) -> Figure:
    """Draw the picks per minute of each robot, and the share of the shift in which it worked."""
    figure = titled_figure(f'{results.line.name}: robots', 3.4)
    shift_min = results.line.shift_s / MINUTE_S
    names = [name for belt in results.belts for name in belt.robots]
    own = [(belt, belt.robot == number) for belt in results.belts for number in range(len(belt.robots))]
    picks = [float(which.sum()) / shift_min for _, which in own]
    busy = [100.0 * float(belt.cycle_s[which].sum()) / results.line.shift_s for belt, which in own]
    positions = np.arange(len(names))
    for n, (values, label) in enumerate(((picks, 'picks [1/min]'), (busy, 'busy [%]')), start=1):
        axes = figure.add_subplot(1, 2, n)
        axes.bar(positions, values, color=COLOURS[n - 1])
        axes.set_xticks(positions, names, rotation=30, ha='right')
        dress(axes, ylabel=label, ylim=(0.0, None))
    return figure


def minutes_figure(results: Results) -> Figure:
    """Draw arrived, picked and missed parts per minute over the shift."""
    figure = titled_figure(f'{results.line.name}: parts', 1.0 + 2.2 * len(results.belts))
    for n, belt in enumerate(results.belts, start=1):
        axes = figure.add_subplot(len(results.belts), 1, n)
        came, picked, missed = by_minute(belt, results.line.shift_s)
        step = -(-len(came) // POINTS_MAX)
        edges = np.arange(0, len(came), step)
        for counts, label, colour in (
            (came, 'came', COLOURS[0]),
            (picked, 'picked', COLOURS[1]),
            (missed, 'missed', MISSED),
        ):
            sums = np.add.reduceat(counts, edges) / np.diff(np.append(edges, len(counts)))
            axes.step(edges, sums, where='post', color=colour, label=label)
        dress(axes, xlabel='time [min]', ylabel=f'{belt.belt}: parts [1/min]', ylim=(0.0, None))
        axes.legend(loc='center right')
    return figure
