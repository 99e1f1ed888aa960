"""The packaging cycle before and after: TCP error of a round by several controllers."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

import delta3_pacdrive as d3
from delta3_pacdrive.studies.framework.figure_style import AXIS_COLOURS, dress, empty_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN = AXIS_COLOURS
CONTROLLERS = (
    ('off: one inertia per axis', BLUE, 'delta3', 'built', 'none'),
    ('the whole model', ORANGE, 'model', 'built+model', 'none'),
    ('the whole model, shaped (smooth)', GREEN, 'model', 'built+model', 'smooth'),
)


def make() -> Figure:
    """Draw the true TCP error of the second round, of the nominal robot and of the built one."""
    figure = empty_figure(3.6)
    left, right = figure.subplots(1, 2)
    for axes, title, number in ((left, 'nominal robot', 2), (right, 'built robot, its true TCP', 3)):
        for label, colour, *files, shaping in CONTROLLERS:
            times, error = _round(files[number - 2], shaping)
            axes.plot(times, 1e3 * error, color=colour, label=label)
        dress(axes)
        axes.set(xlabel='time in a round [ms]', title=title, ylim=(0.0, None))
    left.set(ylabel='TCP error [mm]', ylim=(0.0, 1.15))  # room for the legend
    left.legend(fontsize=8, frameon=False)
    return figure


def _round(file: str, shaping: str) -> tuple[np.ndarray, np.ndarray]:
    """Return time [ms] and error of the true TCP [m] over the second of three rounds."""
    robot = d3.load_parameters(file).replace(control__shaping=shaping, rich__geometry=False)
    trace = d3.simulate(replace(d3.load_program('packaging', robot), repeat=3), robot)
    cycles = round(trace.meta['program_s'] / 3.0 / robot.bus.cycle_time_s)
    first = trace.meta['start_cycle'] + cycles
    off = (trace['tcp_error'] + trace['tcp_actual'] - trace['tcp_true'])[first : first + cycles]
    return np.arange(cycles), np.linalg.norm(off, axis=1)
