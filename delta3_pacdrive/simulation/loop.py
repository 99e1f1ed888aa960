"""All of the machine in one loop, without ROS: the same control and plant code as the nodes, cycle by cycle."""

from typing import Any

import numpy as np

from delta3_pacdrive.controller.transformation import Transformation, answer_cycle, command_cycle
from delta3_pacdrive.drive.diagnostics import fault_text
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.motion import program_planner
from delta3_pacdrive.motion.program import Program
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.plant.plant import true_tcp
from delta3_pacdrive.recording.signals import SIGNALS, TRUE_SIGNALS
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.sercos.words import CONTROL_ENABLE, CONTROL_ON, IN_TORQUE, READINESS_AND_ERROR, in_torque
from delta3_pacdrive.simulation.disturbed import run_disturbed
from delta3_pacdrive.simulation.robot import AXES, Robot, robot_cycle

# places of the signals in the columns of a run
(
    MOTOR_COMMAND,
    MOTOR_POSITION,
    MOTOR_SPEED,
    CURRENT,
    FOLLOWING_ERROR,
    TCP_COMMAND,
    TCP_ACTUAL,
    TCP_ERROR,
    SHAFT_POSITION,
    SHAFT_SPEED,
    COUPLING_TORQUE,
    ARM_ANGLE,
    TCP_TRUE,
) = range(len((*SIGNALS, *TRUE_SIGNALS)))


def placed(parameters: Parameters, program: Program) -> Parameters:
    """Return the parameters of a robot that stands where the program starts."""
    if program.start_m is None:
        return parameters
    return parameters.replace(motion__home_m=program.start_m)


@kernel
def _run_cycles(first, last, start_cycle, enable_cycle, task, robot, status, columns):
    """Run bus cycles and fill the columns; return the first cycle of the program without torque, or -1."""
    course, table, tables, motors, answer, task_state, task_constants, geometry_record = task
    payload, exchanges, drives, drive_constants, plant = robot
    plant_state, plant_geometry, shafts = plant[1], plant[3], plant[6]
    answers, heard = np.empty((3, 3)), np.ones(3, dtype=np.int64)
    for k in range(first, last):
        command_cycle(k, course, table, tables, motors, task_state, task_constants, geometry_record)
        for i in range(3):
            columns[MOTOR_COMMAND][k, i] = motors[i]
            columns[SHAFT_POSITION][k, i] = shafts[i]
            columns[SHAFT_SPEED][k, i] = shafts[3 + i]
            columns[COUPLING_TORQUE][k, i] = shafts[6 + i]
            columns[ARM_ANGLE][k, i] = plant_state[0].theta[i]
        tcp = true_tcp(plant_state, plant_geometry)
        for i in range(3):
            columns[TCP_TRUE][k, i] = tcp[i]
        control = CONTROL_ENABLE if k >= enable_cycle else CONTROL_ON
        robot_cycle(
            heard,
            motors,
            control,
            task_state[0].payload,
            status,
            answers,
            payload,
            exchanges,
            drives,
            drive_constants,
            plant,
        )
        if k >= start_cycle and not (_torque(status[0]) and _torque(status[1]) and _torque(status[2])):
            return k
        answer_cycle(k, answers[0], answers[2], answer, task_state, task_constants, geometry_record)
        for i in range(3):
            columns[MOTOR_POSITION][k, i] = answers[0, i]
            columns[MOTOR_SPEED][k, i] = answers[1, i]
            columns[CURRENT][k, i] = answers[2, i]
            columns[TCP_ACTUAL][k, i] = answer[3 + i]
            columns[TCP_COMMAND][k, i] = answer[6 + i]
            columns[FOLLOWING_ERROR][k, i] = answer[9 + i]
            columns[TCP_ERROR][k, i] = answer[12 + i]
    return -1


@kernel
def _torque(status):
    return status & READINESS_AND_ERROR == IN_TORQUE


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
    planned = program_planner.plan(program, tcp, parameters)
    task.load(planned.plan)
    motion = parameters.motion
    if motion.enable_cycle < 0 or motion.start_cycle < 0:
        raise RunError('motion.enable_cycle and motion.start_cycle must not be negative in a simulation')
    task.enable(motion.enable_cycle)
    task.start(motion.start_cycle)
    if program.faults:
        signals, stopped, lost = run_disturbed(program.faults, robot, task, parameters)
    else:
        columns, stopped, lost = _run_undisturbed(robot, task, motion.start_cycle), '', 0
        signals = dict(zip((*SIGNALS, *TRUE_SIGNALS), columns, strict=True))
    signals['current'] /= parameters.motor.torque_constant_n_m_a
    return Trace(
        np.arange(len(signals['current']), dtype=np.float64) * parameters.bus.cycle_time_s,
        signals,
        _meta(planned, parameters, task) | {'stopped': stopped, 'lost_telegrams': lost},
    )


def _run_undisturbed(robot: Robot, task: Transformation, start_cycle: int) -> tuple[Floats, ...]:
    """Run a program in one compiled loop; raises RunError if a drive trips."""
    cycles = task.last_cycle + 1
    columns = tuple(np.empty((cycles, 3)) for _ in (*SIGNALS, *TRUE_SIGNALS))
    status = np.zeros(3, dtype=np.int64)
    stopped = _run_cycles(
        0, cycles, start_cycle, task.enable_cycle, task.arrays(), robot.arrays(), status, columns
    )
    if stopped >= 0:
        _refuse_without_torque(robot, status.tolist(), stopped)
    return columns


def _refuse_without_torque(robot: Robot, status: list[int], cycle: int) -> None:
    for axis, word, drive in zip(AXES, status, robot.drives, strict=True):
        if not in_torque(word):
            raise RunError(
                f'{axis} is not enabled in bus cycle {cycle}: '
                + (fault_text(drive.fault) if drive.fault else drive.drive_state.name.lower())
            )


def _meta(planned: program_planner.Planned, parameters: Parameters, task: Transformation) -> dict[str, Any]:
    figures = task.figures()
    return {
        'program': planned.name,
        'notices': list(planned.notices),
        'program_s': planned.plan.duration_s,
        'repeat': planned.repeat,
        'checksum': parameters.checksum,
        'gear_ratio': parameters.dynamics.gear_ratio,
        'rich': parameters.rich.enabled,
        'cycle_time_s': parameters.bus.cycle_time_s,
        'exchange_period_s': parameters.bus.exchange_period_s,
        'start_cycle': parameters.motion.start_cycle,
        'end_cycle': task.end_cycle,
        'planned_end_m': planned.plan.end_m().tolist(),
        'figures': vars(figures),
    }
