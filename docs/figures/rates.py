"""The packaging cycle at different rates: what a round takes, and how far the TCP is off."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import delta3_pacdrive as d3
from delta3_pacdrive.planning.limits.energy import Energy
from delta3_pacdrive.planning.program.model import Aim, Arch
from delta3_pacdrive.studies.framework.figure_style import AXIS_COLOURS, dress, empty_figure
from delta3_pacdrive.studies.runs.run_signals import energy_of_round

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN = AXIS_COLOURS
JERKS_M_S3 = (1500.0, 3000.0, 6000.0, 12000.0, 20000.0)
ROUNDS = 3


def make() -> Figure:
    """Draw losses of a round and largest TCP error over the rate, of arches between different limits of jerk."""
    off, model = d3.load_parameters(), d3.load_parameters('model')
    figure = empty_figure(4.0)
    left, right = figure.subplots(1, 2)
    fast, gentle, fed = (
        [_driven('packaging_fast', robot, jerk, aim) for jerk in JERKS_M_S3]
        for robot, aim in ((off, Aim.TIME), (off, Aim.ENERGY), (model, Aim.TIME))
    )
    corners, corners_fed = _driven('packaging', off), _driven('packaging', model)
    for found, colour, label in ((fast, BLUE, 'aim: time'), (gentle, GREEN, 'aim: energy')):
        left.plot(*_columns(found, 1), 'o-', color=colour, label=f'arches, {label}')
    left.plot(*_columns([corners], 1), 's', color=BLUE, markerfacecolor='none', label='packaging')
    right.plot(*_columns(fast, 2), 'o-', color=BLUE, label='arches, thesis')
    right.plot(*_columns(fed, 2), 'o-', color=ORANGE, label='arches, model')
    for found, colour, label in ((corners, BLUE, 'thesis'), (corners_fed, ORANGE, 'model')):
        right.plot(
            *_columns([found], 2), 's', color=colour, markerfacecolor='none', label=f'packaging, {label}'
        )
    left.set(ylabel='lost in a round [J]', ylim=(0.0, None))
    right.set(ylabel='largest TCP error [mm]', yscale='log', yticks=(ticks := [0.03, 0.1, 0.3, 1.0]))
    right.set_yticklabels([f'{tick:g}' for tick in ticks])
    right.minorticks_off()
    for axes in (left, right):
        dress(axes)
        axes.set_xlabel('rounds a minute')
    left.set_title('controller of the thesis', fontsize=11)
    left.legend(fontsize=9, frameon=False)
    right.legend(title='program, controller', fontsize=9, frameon=False)
    return figure


def _driven(
    name: str, robot: d3.Parameters, jerk_m_s3: float = 0.0, aim: Aim = Aim.TIME
) -> tuple[float, float, float]:
    """Return rounds a minute, energy lost in a round [J] and largest TCP error [mm] of a packaged program."""
    program = d3.load_program(name, robot)
    statements = tuple(
        replace(one, aim=aim, limits=replace(one.limits, jerk_m_s3=jerk_m_s3))
        if isinstance(one, Arch)
        else one
        for one in program.statements
    )
    trace = d3.simulate(replace(program, statements=statements, repeat=ROUNDS), robot)
    energy = energy_of_round(trace, robot, ROUNDS) or Energy()
    return (
        60.0 * ROUNDS / trace.meta['program_s'],
        energy.lost_j,
        1e3 * trace.meta['figures']['tcp_error_max_m'],
    )


def _columns(found: list[tuple[float, float, float]], column: int) -> tuple[list[float], list[float]]:
    return [one[0] for one in found], [one[column] for one in found]
