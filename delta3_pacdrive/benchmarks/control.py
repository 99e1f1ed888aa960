"""``delta3 bench control``: the packaging cycle with each controller, on the robot of its model and on others.

``known`` are the parameters of the controller, ``machine`` those of the driven robot.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive import simulation
from delta3_pacdrive.control.cycle.task_arrays import SETTLE_CYCLES
from delta3_pacdrive.errors import Delta3Error
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.learned_torques import Learned
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.planning.program_planner import Planned
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.drives.tuning.proposal import Kept, margins_kept, spread
from delta3_pacdrive.studies.framework.study import OnProgress, silent
from delta3_pacdrive.studies.learning.responses import with_masses
from delta3_pacdrive.studies.learning.run import Study
from delta3_pacdrive.studies.learning.study import Settings
from delta3_pacdrive.studies.runs.run_signals import energy_of_round

PACKAGING, FAST = 'packaging', 'packaging_fast'
ROUNDS = 3
MASSES_OFF = 0.3  # relative error of all masses
LEARNED, REPETITIONS, BANDWIDTH_HZ = 'learned', 5, 80.0  # a controller, and the settings of its learning
OBSERVER_HZ = 10.0  # bandwidth at which the loops of the built robot are still stable
SHAFT_SPEED_RAD_S = 10.0  # at which ``tune`` linearizes friction
MM = 1e3


@dataclass(frozen=True)
class Controller:
    """A controller: its parameter file, its program and its input shaping."""

    file: str
    program: str = PACKAGING
    shaping: str = core.UNSHAPED
    observer_hz: float = 0.0  # bandwidth of the disturbance observer

    def parameters(self, built: bool) -> Parameters:
        """Return the parameters; a built robot gets the arm lengths that the controller assumes."""
        built_file = 'rich' if self.file == core.THESIS_CONTROLLER else f'rich+{self.file}'
        loaded = core.load(built_file if built else self.file)
        return loaded.replace(
            control__shaping=self.shaping,
            rich__geometry=False,
            drive__disturbance_bandwidth_hz=self.observer_hz,
        )


CONTROLLERS = {
    'off': Controller(core.THESIS_CONTROLLER),
    'feed-forward': Controller(core.MODEL_CONTROLLER),
    LEARNED: Controller(core.MODEL_CONTROLLER),
    'shaped': Controller(core.MODEL_CONTROLLER, shaping=core.SMOOTH),
    'time-optimal': Controller(core.MODEL_CONTROLLER, FAST),
    'observer': Controller(core.THESIS_CONTROLLER, observer_hz=OBSERVER_HZ),
    'observer+model': Controller(core.MODEL_CONTROLLER, observer_hz=OBSERVER_HZ),
}
NOMINAL, LIGHTER, HEAVIER, BUILT = ROBOTS = ('nominal', 'masses - 30 %', 'masses + 30 %', 'built')


@dataclass(frozen=True)
class Row:
    """The figures of a run."""

    error_max_m: float  # TCP, commanded against actual by the encoders
    error_rms_m: float
    true_error_max_m: float  # TCP, commanded against true
    true_error_rms_m: float
    peak_current_a: float  # of the motor with the largest
    rms_current_a: float  # of the motor with the largest
    heat: float  # (rms current / nominal current)^2
    lost_j: float  # in windings and friction, per round
    cycle_s: float
    planning_s: float


def measure(
    controllers: Sequence[str] = tuple(CONTROLLERS),
    robots: Sequence[str] = ROBOTS,
    show: OnProgress = silent,
) -> dict[str, Any]:
    """Return the figures of every controller on every robot; a failed run contains its error message.

    ``show`` is called with the next run, the number of finished runs and their total.
    """
    simulation.precompile(core.load())  # including kernels that are compiled at their first use
    found: dict[str, dict[str, Any]] = {}
    for name in controllers:
        found[name] = {}
        for robot in robots:
            done = sum(map(len, found.values()))
            show(f'{name}, {robot}', done, len(controllers) * len(robots))
            try:
                found[name][robot] = asdict(_row(name, robot))
            except Delta3Error as error:
                found[name][robot] = {'failed': str(error)}
    least_margins = {robot: asdict(margins(robot)) for robot in robots}
    with_observer = {robot: asdict(margins(robot, OBSERVER_HZ)) for robot in robots}
    return {
        'program': PACKAGING,
        'time_optimal_program': FAST,
        'rounds': ROUNDS,
        'controllers': found,
        'margins': least_margins,
        'margins_with_observer': with_observer,
    }


def margins(robot: str, observer_hz: float = 0.0) -> Kept:
    """Return the smallest margins of the drives on a robot, over loops, workspace, and payloads up to the rated one.

    Feed-forward closes no loop, so the margins are the same for all controllers with the same ``observer_hz``, the
    bandwidth of the disturbance observer [Hz].
    """
    known = core.load('rich' if robot == BUILT else None).replace(drive__disturbance_bandwidth_hz=observer_hz)
    machine = _machine(known, robot)
    return margins_kept(machine, spread(machine, core.RATED_PAYLOAD_KG), SHAFT_SPEED_RAD_S)


def _machine(known: Parameters, robot: str) -> Parameters:
    """Return the parameters of the driven robot, which may differ from those of the controller."""
    if robot in (LIGHTER, HEAVIER):
        return with_masses(known, 1.0 - MASSES_OFF if robot == LIGHTER else 1.0 + MASSES_OFF)
    return known


def _row(name: str, robot: str) -> Row:
    chosen = CONTROLLERS[name]
    known = chosen.parameters(robot == BUILT)
    machine = _machine(known, robot)
    program = replace(programs.load(chosen.program, known.motion), repeat=ROUNDS)
    learned = _learned(chosen, program, known, machine) if name == LEARNED else None
    planned, planning_s = _planned(program, simulation.placed(known, program))
    trace = simulation.run(program, known, learned=learned, machine=machine, planner=lambda *_: planned)
    return _figures(trace, machine, planning_s)


@lru_cache(maxsize=1)
def _planned(program: Program, known: Parameters) -> tuple[Planned, float]:
    """Plan a program, once for all robots with the same known parameters; also return the planning time [s]."""
    started = time.perf_counter()
    planned = simulation.plan_of(program, known)
    return planned, time.perf_counter() - started


def _learned(chosen: Controller, program: Program, known: Parameters, machine: Parameters) -> Learned:
    """Return the torques of the best repetition."""
    settings = Settings(chosen.program, chosen.file, None, REPETITIONS, BANDWIDTH_HZ)
    study = Study(settings, Path(LEARNED), '', silent)  # writes nothing unless it is run
    study.program = program
    study.robot, study.machine = (simulation.placed(one, program) for one in (known, machine))
    improvements: list[Learned] = []
    study.learned(lambda learned, number: improvements.append(learned))
    return improvements[-1]


def _figures(trace: Trace, machine: Parameters, planning_s: float) -> Row:
    meta = trace.meta
    if meta['stopped']:
        raise Delta3Error(meta['stopped'])
    figures = meta['figures']
    measured = slice(meta['start_cycle'], meta['end_cycle'] + SETTLE_CYCLES)
    # true and actual TCP are recorded at the same instant
    true_error = (trace['tcp_error'] + trace['tcp_actual'] - trace['tcp_true'])[measured]
    distances = np.linalg.norm(true_error, axis=1)
    energy = energy_of_round(trace, machine, meta['repeat'])
    rms_a = max(figures['current_rms_a'])
    return Row(
        error_max_m=figures['tcp_error_max_m'],
        error_rms_m=figures['tcp_error_rms_m'],
        true_error_max_m=float(distances.max()),
        true_error_rms_m=float(np.sqrt((distances**2).mean())),
        peak_current_a=max(figures['current_peak_a']),
        rms_current_a=rms_a,
        heat=(rms_a / machine.motor.nominal_current_a) ** 2,
        lost_j=0.0 if energy is None else energy.lost_j,
        cycle_s=meta['program_s'] / meta['repeat'],
        planning_s=planning_s,
    )


def text(result: dict[str, Any]) -> Iterator[str]:
    """Yield the results as lines of text, one line per controller and robot."""
    yield f'{result["program"]}; time-optimal: {result["time_optimal_program"]}. TCP errors max / rms [mm]'
    yield (
        f'{"controller":>13} {"robot":>14} {"encoders":>15} {"true":>15} {"peak":>7} {"rms":>7} {"heat":>6} '
        f'{"lost":>7} {"round":>8} {"planned in":>10}'
    )
    for controller, robots in result['controllers'].items():
        for robot, row in robots.items():
            if 'failed' in row:
                yield f'{controller:>13} {robot:>14} {row["failed"]}'
                continue
            figures = Row(**row)
            yield (
                f'{controller:>13} {robot:>14} {MM * figures.error_max_m:7.3f} /{MM * figures.error_rms_m:6.3f} '
                f'{MM * figures.true_error_max_m:7.3f} /{MM * figures.true_error_rms_m:6.3f} '
                f'{figures.peak_current_a:5.2f} A {figures.rms_current_a:5.2f} A {100.0 * figures.heat:4.0f} % '
                f'{figures.lost_j:5.1f} J {figures.cycle_s:6.3f} s {MM * figures.planning_s:7.0f} ms'
            )
    for key, of in (
        ('margins', 'every controller without observer'),
        ('margins_with_observer', f'those with one of {OBSERVER_HZ:g} Hz'),
    ):
        yield f'\nleast margins over loops, workspace, and 0 to {core.RATED_PAYLOAD_KG:g} kg, of {of}'
        for robot, margin in result[key].items():
            kept = Kept(**margin)
            state = '' if kept.stable else ', not stable'
            yield (
                f'{robot:>28} {kept.gain_db:5.1f} dB ({kept.gain_where}), '
                f'{kept.phase_deg:4.1f} deg ({kept.phase_where}){state}'
            )
