"""Figures of learning: error over the repetitions, and over time before and after."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from delta3_pacdrive.studies.framework.figure_style import (
    AXIS_COLOURS,
    COLOURS,
    MUTED,
    dress,
    figure_of_program,
    finish_over_time,
    legend_above,
)
from delta3_pacdrive.studies.framework.report_folder import Drawings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from delta3_pacdrive.studies.learning.study import Results

REPETITIONS, ERRORS = NAMES = ('repetitions.png', 'before_and_after.png')
WIDTHS = (0.9, 2.4, 0.9)  # of the lines: torques of motors 2 and 3 coincide for a path in the x-z plane


def by_name(found: Results) -> Drawings:
    """Return the drawing function of each figure by file name."""
    return {ERRORS: partial(before_and_after, found), REPETITIONS: partial(repetitions, found)}


def repetitions(found: Results) -> Figure:
    """TCP error of each repetition; the selected one is marked."""
    figure = figure_of_program('Learning', found.program, 3.4)
    axes = figure.subplots()
    numbers = [one.number for one in found.repetitions]
    largest = [1e3 * one.tcp_error_max_m for one in found.repetitions]
    rms = [1e3 * one.tcp_error_rms_m for one in found.repetitions]
    axes.semilogy(numbers, largest, 'o-', color=COLOURS[0], label='largest')
    axes.semilogy(numbers, rms, 's-', color=COLOURS[1], label='rms')
    axes.axvline(found.best.number, color=MUTED, linewidth=0.8, zorder=0)
    axes.set_xticks(numbers)
    dress(axes, xlabel='repetition', ylabel='TCP error [mm]')
    legend_above(axes)
    return figure


def before_and_after(found: Results) -> Figure:
    """TCP error without and with the learned torques, and the torques."""
    figure = figure_of_program('Before and after learning', found.program, 5.4)
    panels = figure.subplots(3, 1, sharex=True)
    for errors, label, colour in (
        (found.before_m, 'before', MUTED),
        (found.after_m, 'after', COLOURS[0]),
    ):
        size = 1e3 * np.linalg.norm(errors, axis=1)
        panels[0].plot(found.time_s, size, color=colour, linewidth=0.9, label=label)
    panels[1].plot(found.time_s, 1e3 * np.linalg.norm(found.after_m, axis=1), color=COLOURS[0], linewidth=0.9)
    for axis, (colour, width) in enumerate(zip(AXIS_COLOURS, WIDTHS, strict=False)):
        panels[2].plot(
            found.time_s,
            found.learned.torques[:, axis],
            color=colour,
            linewidth=width,
            label=f'motor {axis + 1}',
        )
    finish_over_time(panels, ('TCP error [mm]', 'after [mm]', 'learned [N m]'))
    legend_above(panels[0])
    legend_above(panels[2])
    return figure
