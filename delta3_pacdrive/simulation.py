"""All of the machine in one loop, without ROS: the same control and plant code as the nodes, cycle by cycle."""

from typing import Any

import numpy as np

from delta3_pacdrive.bus.words import in_torque
from delta3_pacdrive.drive.mc4 import MC4
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.kernel import mark_compiled
from delta3_pacdrive.kinematics import Floats
from delta3_pacdrive.motion import planning
from delta3_pacdrive.motion.checks import Limits
from delta3_pacdrive.motion.program import Dwell, MoveC, MoveL, Program, Target
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.plant.mechanism import Plant
from delta3_pacdrive.trace import SIGNALS, Trace
from delta3_pacdrive.transformation import FOLLOWING_ERROR, TCP_ACTUAL, TCP_COMMAND, TCP_ERROR, Transformation

AXES = ('axis1', 'axis2', 'axis3')


def placed(parameters: Parameters, program: Program) -> Parameters:
    """Return the parameters of a robot that stands where the program starts."""
    if program.start_m is None:
        return parameters
    return parameters.replace(motion__home_m=program.start_m)


class Robot:
    """Plant and drives, one exchange after the other."""

    def __init__(self, parameters: Parameters) -> None:
        bus = parameters.bus
        self.plant = Plant(parameters)
        self.drives = [MC4(parameters) for _ in AXES]
        self._exchanges = round(bus.cycle_time_s / bus.exchange_period_s)
        self._brakes = [False] * 3
        self._currents: Floats = np.zeros((len(self.drives[0].currents), 3))

    def encoder_positions(self) -> list[float]:
        """Motor shaft positions [rad] as the encoders read them."""
        positions = self.plant.shafts()[:3]
        return [drive.encoder_position(p) for drive, p in zip(self.drives, positions, strict=True)]

    def cycle(
        self, commands: Floats, control: int, answers: Floats, payload_kg: float | None = None
    ) -> list[int]:
        """Run one bus cycle; fill ``answers`` (3 rows: position, speed, torque) and return the status words."""
        shafts = self.plant.shafts()
        status = []
        for i, drive in enumerate(self.drives):
            status.append(
                drive.begin_cycle(
                    float(commands[i]), control, shafts[i], shafts[3 + i], shafts[6 + i], payload_kg
                )
            )
            answers[:, i] = drive.answer
        for exchange in range(self._exchanges):
            if exchange:
                shafts = self.plant.shafts()
            for i, drive in enumerate(self.drives):
                self._brakes[i] = drive.run_period(shafts[i], shafts[3 + i], shafts[6 + i])
                self._currents[:, i] = drive.currents
            self.plant.advance(self._currents, self._brakes, self.drives[0].payload)
        return status


def run(program: Program, parameters: Parameters) -> Trace:
    """Run a program from the start of cyclic operation to the settled end; the robot stands where it starts.

    Raises
    ------
    ProgramError
        The program is refused.
    RunError
        The drives are not enabled when the program should start, or one trips.

    """
    parameters = placed(parameters, program)
    robot = Robot(parameters)
    task = Transformation(parameters)
    tcp = task.locate(robot.encoder_positions())
    planned = planning.plan(program, tcp, parameters)
    task.load(planned.plan)
    motion = parameters.motion
    if motion.enable_cycle < 0 or motion.start_cycle < 0:
        raise RunError('motion.enable_cycle and motion.start_cycle must not be negative in a simulation')
    task.enable_cycle = motion.enable_cycle
    task.start(motion.start_cycle)
    cycles = task.last_cycle + 1
    columns = {name: np.empty((cycles, 3)) for name in SIGNALS}
    answers = np.empty((3, 3))
    for k in range(cycles):
        shafts = robot.plant.shafts()
        commands = task.command(k)
        columns['motor_command'][k] = commands
        columns['shaft_position'][k], columns['shaft_speed'][k] = shafts[:3], shafts[3:6]
        columns['coupling_torque'][k] = shafts[6:]
        status = robot.cycle(commands, task.control(k), answers, task.payload)
        if k >= motion.start_cycle:
            _require_torque(robot, status, k)
        columns['motor_position'][k], columns['motor_speed'][k], columns['current'][k] = answers
        result = task.receive(k, answers[0], answers[2])
        columns['following_error'][k] = result[FOLLOWING_ERROR]
        columns['tcp_command'][k] = result[TCP_COMMAND]
        columns['tcp_actual'][k] = result[TCP_ACTUAL]
        columns['tcp_error'][k] = result[TCP_ERROR]
    columns['current'] /= parameters.motor.torque_constant_n_m_a
    return Trace(
        np.arange(cycles, dtype=np.float64) * parameters.bus.cycle_time_s,
        columns,
        _meta(planned, parameters, task),
    )


def rehearse(parameters: Parameters) -> None:
    """Run every kernel once, so that none is compiled or loaded in the middle of a cycle."""
    quick = parameters.replace(motion__enable_cycle=-1)
    robot, task = Robot(quick), Transformation(quick)
    tcp = task.locate(robot.encoder_positions())
    plan = planning.plan(_rehearsal(parameters), tcp, quick).plan
    task.load(plan)
    task.start(0)
    answers = np.empty((3, 3))
    robot.cycle(task.command(0), task.control(0), answers, task.payload)
    task.receive(0, answers[0], answers[2])
    task.hold()
    robot.drives[0].phase_currents()
    mark_compiled()


def _rehearsal(parameters: Parameters) -> Program:
    """Return a program that asks for everything the planner knows."""
    limits = Limits(1.0, 10.0, 500.0)
    up, along = Target((0.0, 0.0, -0.01), relative=True), Target((0.02, 0.0, 0.0), relative=True)
    return Program(
        'rehearsal',
        (MoveL(up, limits, blend_m=0.004), MoveL(along, limits), MoveC(along, up, limits), Dwell(0.01)),
    )


def _require_torque(robot: Robot, status: list[int], cycle: int) -> None:
    for axis, word, drive in zip(AXES, status, robot.drives, strict=True):
        if not in_torque(word):
            raise RunError(
                f'{axis} is not enabled in bus cycle {cycle}: {drive.drive_state.name}, {drive.fault.name}'
            )


def _meta(planned: planning.Planned, parameters: Parameters, task: Transformation) -> dict[str, Any]:
    figures = task.figures()
    return {
        'program': planned.name,
        'notices': list(planned.notices),
        'program_s': planned.plan.duration_s,
        'repeat': planned.repeat,
        'checksum': parameters.checksum,
        'gear_ratio': parameters.dynamics.gear_ratio,
        'cycle_time_s': parameters.bus.cycle_time_s,
        'exchange_period_s': parameters.bus.exchange_period_s,
        'start_cycle': parameters.motion.start_cycle,
        'end_cycle': task.end_cycle,
        'figures': vars(figures),
    }
