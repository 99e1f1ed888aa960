"""``delta3 bench timing``: TCP errors with the timing of the thesis and with that of a SERCOS II ring."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive import simulation
from delta3_pacdrive.benchmarks.belts import run_row
from delta3_pacdrive.parameters import MODEL_CONTROLLER, TIMINGS, Parameters
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.studies.framework.study import OnProgress, silent

PROGRAMS = ('experiment1', 'experiment2', 'experiment3', 'packaging', 'packaging_fast')
ROBOTS = ('nominal', 'built')
BELTS_M_S, PARTS_PER_MIN, BELT_SECONDS = (0.3, 1.5), 70.0, 12.0
MM, MS = 1e3, 1e3


def measure(
    programs: Sequence[str] = PROGRAMS,
    belts_m_s: Sequence[float] = BELTS_M_S,
    seconds: float = BELT_SECONDS,
    show: OnProgress = silent,
) -> dict[str, Any]:
    """Return the errors of each program on each robot, and those of picks from belts, with both timings.

    Parameters
    ----------
    programs
        Names of packaged programs, each with its own controller.
    belts_m_s, seconds
        Speeds of the belts [m/s], and bus time at each [s].
    show
        Called with stage, number done and total number.

    """
    total = len(programs) * len(ROBOTS) + len(belts_m_s)
    rows = []
    for n, (name, robot) in enumerate((name, robot) for name in programs for robot in ROBOTS):
        show(f'{name}, {robot}', n, total)
        for timing in TIMINGS:
            rows.append({'program': name, 'robot': robot, 'timing': timing, **_errors(name, robot, timing)})
    picks = []
    for n, speed in enumerate(belts_m_s):
        show(f'belt of {speed:g} m/s', total - len(belts_m_s) + n, total)
        for timing in TIMINGS:
            found = run_row(speed, PARTS_PER_MIN, seconds, with_timing(MODEL_CONTROLLER, timing))
            errors = {'error_rms_m': found.error_rms_m, 'error_max_m': found.error_max_m}
            picks.append({'speed_m_s': speed, 'timing': timing, 'picked': found.picked, **errors})
    return {'runs': rows, 'picks': picks}


def with_timing(source: str, timing: str) -> Parameters:
    """Return the parameters of a file with another ``bus.timing``."""
    return core.load(source).replace(bus__timing=timing)


def _errors(name: str, robot: str, timing: str) -> dict[str, float]:
    """Return the errors of a run [m]: command less actual TCP of the same cycle, and without the dead time."""
    own = with_timing(core.of_run('built' if robot == 'built' else None, name), timing)
    trace = simulation.run(program_file.load(name, own.motion), own)
    figures = trace.meta['figures']
    rows = slice(trace.meta['start_cycle'], None)
    raw_m = np.linalg.norm(trace['tcp_command'][rows] - trace['tcp_actual'][rows], axis=1)
    return {
        'dead_time_s': own.set_point_delay_cycles * own.bus.cycle_time_s,
        'raw_max_m': float(raw_m.max()),
        'raw_rms_m': float(np.sqrt(np.mean(raw_m**2))),
        'error_max_m': figures['tcp_error_max_m'],
        'error_rms_m': figures['tcp_error_rms_m'],
    }


def text(result: dict[str, Any]) -> Iterator[str]:
    """Yield the results as lines of text, one line per run and per belt."""
    yield (
        f'{"program":>14} {"robot":>8} {"timing":>8} {"dead time":>9}   {"command less actual TCP":>25}   '
        f'{"without the dead time":>25}'
    )
    for one in result['runs']:
        yield (
            f'{one["program"]:>14} {one["robot"]:>8} {one["timing"]:>8} {MS * one["dead_time_s"]:6.2f} ms   '
            f'{MM * one["raw_max_m"]:10.3f} / {MM * one["raw_rms_m"]:.3f} mm     '
            f'{MM * one["error_max_m"]:10.3f} / {MM * one["error_rms_m"]:.3f} mm'
        )
    for one in result['picks']:
        yield (
            f'belt of {one["speed_m_s"]:g} m/s, {one["timing"]}: {one["picked"]} parts, distance from the part '
            f'{MM * one["error_max_m"]:.3f} / {MM * one["error_rms_m"]:.3f} mm'
        )
    yield 'errors as maximum / rms'
