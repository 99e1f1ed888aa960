"""All of the machine in one loop, without ROS: the same control and plant code as the nodes, cycle by cycle."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive.bus.words import (
    CONTROL_ENABLE,
    CONTROL_ON,
    IN_TORQUE,
    READINESS_AND_ERROR,
    in_torque,
)
from delta3_pacdrive.disturbed import run_disturbed
from delta3_pacdrive.drive.diagnostics import fault_text
from delta3_pacdrive.drive.mc4 import MC4
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.kernel import (
    all_compiled,
    alone,
    compiled,
    kernel,
    mark_compiled,
    shared,
    watched,
)
from delta3_pacdrive.kinematics import Floats
from delta3_pacdrive.motion import planning
from delta3_pacdrive.motion.checks import Limits
from delta3_pacdrive.motion.program import Dwell, MoveC, MoveL, Program, Target
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.plant.mechanism import Plant, true_tcp
from delta3_pacdrive.robot import AXES, Robot, robot_cycle
from delta3_pacdrive.signals import SIGNALS, TRUE_SIGNALS
from delta3_pacdrive.trace import Trace
from delta3_pacdrive.transformation import Transformation, answer_cycle, command_cycle

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
    planned = planning.plan(program, tcp, parameters)
    task.load(planned.plan)
    motion = parameters.motion
    if motion.enable_cycle < 0 or motion.start_cycle < 0:
        raise RunError('motion.enable_cycle and motion.start_cycle must not be negative in a simulation')
    task.enable_cycle = motion.enable_cycle
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


def load_kernels(parameters: Parameters) -> None:
    """Load what ``run`` needs, so that no later one waits for it; if nothing is compiled yet, compile every kernel."""
    if all_compiled():
        _stand(parameters)
    else:
        rehearse(parameters)


# that a robot without the effects of ``rich`` needs; the others are compiled when they are called
KERNELS = 107
Show = Callable[[int, int], None]


def compile_kernels(show: Show = lambda done, total: None) -> None:
    """Compile what no process has compiled yet, on all cores; ``show`` is told how many kernels are done, of how many.

    A process that comes while another one compiles waits for it.
    """

    def tell() -> None:
        show(min(compiled(), KERNELS), KERNELS)

    if all_compiled():
        return
    tell()
    with alone(tell), watched(tell):
        if not all_compiled():
            _compile()
            mark_compiled()


def _compile() -> None:
    """Compile the parts side by side, one process for each core, and at last what needs all of them.

    Processes, not threads: the compiler holds a lock. New interpreters, not forked ones: who calls may have threads.
    """
    processes = min(len(_ORDERS), len(os.sched_getaffinity(0)))
    helpers = [
        subprocess.Popen(
            [sys.executable, '-P', '-c', _HELPER, str(Path(__file__).parents[1]), str(number)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for number in range(1, processes)
    ]
    try:
        rehearse_parts(0)  # what helpers have not done, for whatever reason, is done here
    finally:
        for helper in helpers:
            helper.kill()
            helper.wait()


# a helper dies with its parent
_HELPER = """\
import ctypes, signal, sys
ctypes.CDLL(None).prctl(1, signal.SIGKILL)
sys.path.insert(0, sys.argv[1])
from delta3_pacdrive import simulation
simulation.rehearse_parts(int(sys.argv[2]))
"""


def rehearse_parts(number: int) -> None:
    """Call the kernels of all parts of the machine, in an order of one's own, as one of several processes."""
    parameters = core.load()
    with shared():
        for part in _ORDERS[number]:
            part(parameters)
        _call_all(parameters)


def _stand(parameters: Parameters) -> None:
    run(
        Program('rehearsal', (Dwell(parameters.bus.cycle_time_s),)),
        parameters.replace(motion__enable_cycle=20, motion__start_cycle=120),
    )


def rehearse(parameters: Parameters) -> None:
    """Run every kernel once, so that none is compiled or loaded in the middle of a cycle."""
    compile_kernels()
    _call_all(parameters)


def _call_all(parameters: Parameters) -> None:
    quick = parameters.replace(motion__enable_cycle=-1)
    robot, task = Robot(quick), Transformation(quick)
    tcp = task.locate(robot.encoder_positions())
    task.load(planning.plan(_rehearsal(parameters), tcp, quick).plan)
    task.start(0)
    answers = np.empty((3, 3))
    robot.cycle(task.command(0), task.control(0), answers, task.payload)
    task.receive(0, answers[0], answers[2])
    _rehearse_plant(parameters)
    _rehearse_drive(parameters)
    _stand(parameters)
    task.hold()
    robot.drives[0].phase_currents()


def _rehearse_plant(parameters: Parameters) -> None:
    """Call the plant as its node does."""
    samples = round(parameters.bus.exchange_period_s / parameters.drive.current_period_s)
    Plant(parameters).advance(np.zeros((samples, 3)), [False] * 3)


def _rehearse_drive(parameters: Parameters) -> None:
    """Call a drive as its node does."""
    drive, shaft = MC4(parameters), (0.0, 0.0, 0.0)
    drive.begin_cycle(shaft[0], CONTROL_ON, *shaft)
    drive.run_period(*shaft)
    drive.clear_fault()
    drive.bridge_cycle(*shaft)
    drive.leave_bus()


def _rehearse_planning(parameters: Parameters) -> None:
    planning.plan(_rehearsal(parameters), np.array(parameters.motion.home_m), parameters)


def _rehearse_task(parameters: Parameters) -> None:
    quick = parameters.replace(motion__enable_cycle=-1)
    task = Transformation(quick)
    tcp = task.locate(Robot(quick).encoder_positions())
    task.load(planning.plan(Program('rehearsal', (Dwell(1.0),)), tcp, quick).plan)
    task.start(0)
    task.command(0)
    task.receive(0, np.zeros(3), np.zeros(3))


def _rehearse_robot(parameters: Parameters) -> None:
    """Call drives and plant as the simulation does."""
    robot = Robot(parameters)
    robot.cycle(np.zeros(3), CONTROL_ON, np.empty((3, 3)))


# One for each process. What takes longest comes first, one part with each process; who has done his own helps with that
# of another one, since none compiles what another one is compiling. The robot takes what plant and drive have done.
_ORDERS = (
    (_rehearse_plant, _rehearse_drive, _rehearse_robot, _rehearse_planning, _rehearse_task),
    (_rehearse_drive, _rehearse_plant, _rehearse_task, _stand, _rehearse_planning),
    (_rehearse_task, _rehearse_planning, _rehearse_drive, _rehearse_plant, _stand),
    (_rehearse_planning, _rehearse_task, _rehearse_plant, _rehearse_drive, _rehearse_robot),
)


def _rehearsal(parameters: Parameters) -> Program:
    """Return a program that asks for everything the planner knows."""
    limits = Limits(1.0, 10.0, 500.0)
    up, along = Target((0.0, 0.0, -0.01), relative=True), Target((0.02, 0.0, 0.0), relative=True)
    return Program(
        'rehearsal',
        (MoveL(up, limits, blend_m=0.004), MoveL(along, limits), MoveC(along, up, limits), Dwell(0.01)),
    )


def _refuse_without_torque(robot: Robot, status: list[int], cycle: int) -> None:
    for axis, word, drive in zip(AXES, status, robot.drives, strict=True):
        if not in_torque(word):
            raise RunError(
                f'{axis} is not enabled in bus cycle {cycle}: '
                + (fault_text(drive.fault) if drive.fault else drive.drive_state.name.lower())
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
        'rich': parameters.rich.enabled,
        'cycle_time_s': parameters.bus.cycle_time_s,
        'exchange_period_s': parameters.bus.exchange_period_s,
        'start_cycle': parameters.motion.start_cycle,
        'end_cycle': task.end_cycle,
        'planned_end_m': planned.plan.end_m().tolist(),
        'figures': vars(figures),
    }
