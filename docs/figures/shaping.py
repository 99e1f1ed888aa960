"""Vibration of the built robot after a stop, with each kind of input shaping."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import delta3_pacdrive as d3
from delta3_pacdrive.studies.framework.figure_style import AXIS_COLOURS, dress, empty_figure
from delta3_pacdrive.studies.framework.residual_vibration import after_stop

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STANDS_S, ARRIVES_MS = 0.4, 3
COLOURS = dict(zip(('none', 'zvd', 'smooth'), AXIS_COLOURS, strict=True))
LIMITS = {'speed_m_s': 3.0, 'acceleration_m_s2': 100.0, 'jerk_m_s3': 20_000.0}


def make() -> Figure:
    """Draw the true TCP beside its place after a straight move, and behind an upright one in a rounded cycle."""
    figure = empty_figure(3.6)
    left, right = figure.subplots(1, 2)
    straight = [{'move_l': {'to_m': [0.1525, 0.0, -0.85], **LIMITS}}]
    rounded = [
        {'move_l': {'to_m': {'by_m': step}, **LIMITS, **blend}}
        for step, blend in (
            ([0.0, 0.0, 0.025], {'blend_m': 0.025}),
            ([0.305, 0.0, 0.0], {'blend_m': 0.025}),
            ([0.0, 0.0, -0.025], {}),
        )
    ]
    for axes, moves, title in ((left, straight, 'straight move'), (right, rounded, 'up, over and down')):
        for shaping, colour in COLOURS.items():
            times, tcp = _stopped(moves, shaping)
            axes.plot(times, 1e3 * tcp[:, 0], color=colour, label=shaping)
        dress(axes)
        axes.set(xlabel='time since the start [ms]', title=title)
    left.set_ylabel('true TCP beside its place, x [mm]')
    left.legend(title='control.shaping', fontsize=9, frameon=False)
    return figure


def _stopped(moves: list[dict], shaping: str) -> tuple[np.ndarray, np.ndarray]:
    """Return time [ms] and true TCP beside its place [m] after a stop."""
    robot = d3.load_parameters('built+model').replace(control__shaping=shaping)
    document = {
        'start_m': [-0.1525, 0.0, -0.85],
        'payload_kg': 0.5,
        'moves': [*moves, {'dwell': {'time_s': STANDS_S}}],
    }
    trace = d3.simulate(d3.load_program(document, robot), robot)
    stop = trace.meta['end_cycle'] - round(STANDS_S / robot.bus.cycle_time_s)
    tcp = after_stop(trace, stop)[:100]
    first_ms = stop - trace.meta['start_cycle'] + ARRIVES_MS
    return first_ms + np.arange(len(tcp)), tcp
