"""Oscilloscope inside the drives: records drive states in every period of the current loop."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive import simulation
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, Parameters
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.robot.drive.arrays import words_of_state
from delta3_pacdrive.robot.sercos.increments import all_on_grid
from delta3_pacdrive.simulation.robot import Robot
from delta3_pacdrive.simulation.scoped import FOUND, run_recorded_exchange
from delta3_pacdrive.studies.framework.study import OnProgress


@dataclass(frozen=True)
class Added:
    """Values added to fields of a drive's state before each period and removed after it."""

    axis: int  # index of the drive, from 0
    fields: Sequence[tuple[str, float]]  # fields, each with a factor
    values: Floats  # one value per period of the current loop, shape (samples,)


NOTHING = Added(-1, (), np.empty(0))


def _places(names: Sequence[str]) -> NDArray[np.int64]:
    """Return the word offsets of fields in a drive's state; raises ValueError for an integer field."""
    words, whole = words_of_state(names)
    if whole.any():
        raise ValueError(
            f'{names[int(whole.argmax())]} is an integer field, an oscilloscope records floating-point fields'
        )
    return words


class Oscilloscope:
    """Runs drives and plant of a robot period by period and records states of the drives.

    Parameters
    ----------
    robot
        Robot whose bus cycle has begun whenever an exchange begins one.
    samples
        Number of recorded periods of the current loop.
    left
        State fields recorded at the end of each period.
    added
        Values added to the set points of a drive.

    Attributes
    ----------
    found, left
        Fields at the start and at the end of each period, shapes (samples, 3). At the start of an exchange the shaft
        is that of the plant, afterwards that of the drive.
    per_exchange
        Periods of the current loop per exchange.

    """

    def __init__(self, robot: Robot, samples: int, left: Sequence[str] = (), added: Added = NOTHING) -> None:
        self._robot = robot
        self._words = robot.record['drives'][0].view(np.float64).reshape(len(robot.record['drives'][0]), -1)
        self._brakes = robot.record['brakes'][0, :ARMS]
        self._found = _places(FOUND), np.empty((len(FOUND), samples, 3))
        self._left = _places(left), np.empty((len(left), samples, 3))
        factors = np.array([factor for _, factor in added.fields], dtype=np.float64)
        self._added = _places([name for name, _ in added.fields]), factors, added.axis, added.values
        self.found: dict[str, Floats] = dict(zip(FOUND, self._found[1], strict=True))
        self.left: dict[str, Floats] = dict(zip(left, self._left[1], strict=True))
        self.per_exchange = len(robot.currents)
        self._row = 0

    def begin_cycle(
        self, commands: Iterable[float], control: int, torques: Iterable[float] = (0.0, 0.0, 0.0)
    ) -> list[int]:
        """Begin a bus cycle of the drives; return their status words S-0-0135."""
        shafts = np.reshape(self._robot.plant.shafts(), (3, 3)).T.tolist()
        return [
            drive.begin_cycle(command, control, position, speed, coupling, torque=torque)
            for drive, command, torque, (position, speed, coupling) in zip(
                self._robot.drives, commands, torques, shafts, strict=False
            )
        ]

    def exchange(self, payload_kg: float | None = None) -> None:
        """Run drives and plant for one exchange period, with a newly gripped payload; None: unchanged."""
        robot = self._robot
        shafts = np.array(robot.plant.shafts())
        run_recorded_exchange(
            self._row, shafts, self._words, self._added, robot.record, robot.currents, self._found, self._left
        )
        robot.plant.advance(robot.currents, self._brakes.tolist(), payload_kg)
        self._row += self.per_exchange

    def signals(self) -> dict[str, Floats]:
        """Return the measurements of the drives by signal name."""
        per_rad = float(self._robot.drives[0].constants['increments_per_rad'][0])
        positions = np.empty(self.found['position'].shape)
        all_on_grid(self.found['position'].reshape(-1), per_rad, positions.reshape(-1))
        return {
            'motor_position': positions,
            'motor_speed': self.found['speed'],
            'current': self.found['motor_current'],
            'phase_voltage': self.found['voltage'],
        }


EXCHANGE_MIN_S = 125e-6
PROGRESS_EVERY = 50  # cycles


@dataclass(frozen=True)
class Recorded:
    """Run recorded by oscilloscopes."""

    scope: Oscilloscope
    # position [rad], speed [rad/s] and torque [N m] in the AT of each axis, shape (cycles, 3, 3)
    answers: Floats
    tcp_error: Floats  # set-point delay removed [m], shape (cycles, 3)
    steps: int  # periods of the current loop per bus cycle
    meta: dict[str, Any]  # format of Trace.meta


def finest(parameters: Parameters) -> Parameters:
    """Return the robot with the shortest exchange period, which needs no interpolation."""
    return parameters.replace(bus__exchange_period_s=max(EXCHANGE_MIN_S, parameters.drive.velocity_period_s))


def run(
    program: Program, parameters: Parameters, on_progress: OnProgress, stage: str, left: Sequence[str] = ()
) -> Recorded:
    """Run a program and record the states of the drives, and their fields ``left``, in every period.

    Raises
    ------
    ProgramError
        The program is rejected.
    RunError
        A drive has no torque at or after the program start.

    """
    placed = simulation.placed(finest(parameters), program)
    simulation.require_homed(placed)
    robot, task = Robot(placed), Transformation(placed)
    planned = program_planner.plan(program, task.locate(robot.encoder_positions()), placed)
    task.load(planned.plan)
    task.enable(placed.motion.enable_cycle)
    task.start(placed.motion.start_cycle)
    cycles = task.last_cycle + 1
    steps = round(placed.bus.cycle_time_s / placed.drive.current_period_s)
    scope = Oscilloscope(robot, cycles * steps, left)
    answers, tcp_error = np.empty((cycles, 3, 3)), np.empty((cycles, 3))
    for cycle in range(cycles):
        command = task.command(cycle)
        robot.take_payload(command.payload)
        status = scope.begin_cycle(command.motors, command.control, command.torques)
        for i, drive in enumerate(robot.drives[:ARMS]):
            answers[cycle, :, i] = drive.answer
        for _ in range(steps // scope.per_exchange):
            scope.exchange(robot.payload)
        if cycle >= placed.motion.start_cycle and not all(drive.powered for drive in robot.drives[:ARMS]):
            raise RunError(f'a drive has no torque in bus cycle {cycle}, status {status}')
        tcp_error[cycle] = task.receive(cycle, answers[cycle, 0], answers[cycle, 2])['tcp_error']
        if cycle % PROGRESS_EVERY == 0:
            on_progress(stage, cycle, cycles)
    meta = {
        'program': planned.name,
        'checksum': parameters.checksum,
        'gear_ratio': parameters.dynamics.gear_ratio,
        'cycle_time_s': placed.bus.cycle_time_s,
        'sample_time_s': placed.drive.current_period_s,
        'start_cycle': placed.motion.start_cycle,
        'end_cycle': task.end_cycle,
    }
    return Recorded(scope, answers, tcp_error, steps, meta)
