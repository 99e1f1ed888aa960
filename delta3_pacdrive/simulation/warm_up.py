"""Every kernel compiled and loaded before it is needed: a cycle has no time for that."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive.controller.transformation import Transformation
from delta3_pacdrive.drive.channels import CHANNELS
from delta3_pacdrive.drive.mc4 import MC4
from delta3_pacdrive.drive.scope import DriveScope
from delta3_pacdrive.kinematics import geometry
from delta3_pacdrive.motion import program_planner
from delta3_pacdrive.motion.limits import Limits, check_speed
from delta3_pacdrive.motion.program import Dwell, MoveC, MoveL, Program, Target
from delta3_pacdrive.numerics.kernel import (
    all_compiled,
    alone,
    compiled,
    mark_compiled,
    shared,
    watched,
)
from delta3_pacdrive.parameters import Parameters, flat_document
from delta3_pacdrive.plant.plant import Plant
from delta3_pacdrive.scene.joints import tree_joints
from delta3_pacdrive.sercos.telegrams import JOINTS
from delta3_pacdrive.sercos.words import CONTROL_ON
from delta3_pacdrive.simulation.robot import Robot
from delta3_pacdrive.simulation.run import run


def load_kernels(parameters: Parameters) -> None:
    """Load what ``run`` needs, so that no later one waits for it; compile what nobody has compiled yet.

    Parameters
    ----------
    parameters
        Of the robot that will run.

    """
    compile_kernels(parameters)
    _stand(parameters)


KERNELS = 177  # that a plain robot needs
Show = Callable[[int, int], None]


def compile_kernels(parameters: Parameters | None = None, show: Show = lambda done, total: None) -> None:
    """Compile what no process has compiled yet, on all cores.

    A process that comes while another one compiles waits for it.

    Parameters
    ----------
    parameters
        Of the robot that will run; None: a plain one.
    show
        Is told how many kernels are done, of how many; of those that only this kind of robot needs, of 0.

    """
    if not all_compiled():
        _compile_together(core.load(), lambda: show(min(compiled(), KERNELS), KERNELS))
    if parameters is not None and parameters.kind and not all_compiled(parameters.kind):
        before = compiled()
        _compile_together(parameters, lambda: show(compiled() - before, 0))


def _compile_together(parameters: Parameters, tell: Callable[[], None]) -> None:
    """Compile what a robot needs, unless another process does it meanwhile."""
    tell()
    with alone(tell), watched(tell):
        if not all_compiled(parameters.kind):
            _compile(parameters)
            mark_compiled(parameters.kind)


def _compile(parameters: Parameters) -> None:
    """Compile the parts side by side, one process for each core, and at last what needs all of them.

    Processes, not threads: the compiler holds a lock. New interpreters, not forked ones: who calls may have threads.
    """
    processes = min(len(_ORDERS), len(os.sched_getaffinity(0)))
    robot = json.dumps(flat_document(parameters))
    helpers = [
        subprocess.Popen(
            [sys.executable, '-P', '-c', _HELPER, str(Path(__file__).parents[2]), str(number), robot],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for number in range(1, processes)
    ]
    try:
        precompile_parts(0, parameters)  # what helpers have not done, for whatever reason, is done here
    finally:
        for helper in helpers:
            helper.kill()
            helper.wait()


# a helper dies with its parent
_HELPER = """\
import ctypes, json, signal, sys
ctypes.CDLL(None).prctl(1, signal.SIGKILL)
sys.path.insert(0, sys.argv[1])
from delta3_pacdrive import parameters, simulation
simulation.precompile_parts(int(sys.argv[2]), parameters.from_flat(json.loads(sys.argv[3])))
"""


def precompile_parts(number: int, parameters: Parameters) -> None:
    """Call the kernels of all parts of the machine, as one of several processes.

    Parameters
    ----------
    number
        Of the process, 0 to 3: each has an order of its own.
    parameters
        Of the robot that will run.

    """
    with shared():
        for part in _ORDERS[number]:
            part(parameters)
        _call_all(parameters)


def _stand(parameters: Parameters) -> None:
    run(
        Program('rehearsal', (Dwell(parameters.bus.cycle_time_s),)),
        parameters.replace(motion__enable_cycle=20, motion__start_cycle=120),
    )


def precompile(parameters: Parameters) -> None:
    """Run every kernel once, so that none is compiled or loaded in the middle of a cycle.

    Parameters
    ----------
    parameters
        Of the robot that will run.

    """
    compile_kernels(parameters)
    _call_all(parameters)


def load_cyclic_kernels(parameters: Parameters) -> None:
    """Load what nodes call in their bus cycles, in the process that they are forked from.

    The first cycles would be late otherwise, by up to 72 ms on a slow machine.

    Parameters
    ----------
    parameters
        Of the robot that will run.

    """
    for part in (_precompile_plant, _precompile_drive, _precompile_task):
        part(parameters)


def _call_all(parameters: Parameters) -> None:
    robot, task = _started(_rehearsal(parameters), parameters)
    robot.cycle(task.command(0), task.control(0), task.payload)
    task.receive(0, robot.answers[0], robot.answers[2])
    _precompile_plant(parameters)
    _precompile_drive(parameters)
    _stand(parameters)
    _precompile_joints(parameters)
    task.hold()
    robot.drives[0].phase_currents()


def _started(program: Program, parameters: Parameters) -> tuple[Robot, Transformation]:
    """Return a robot and a task that has started a program, of drives that are not enabled."""
    quick = parameters.replace(motion__enable_cycle=-1)
    robot, task = Robot(quick), Transformation(quick)
    task.load(program_planner.plan(program, task.locate(robot.encoder_positions()), quick).plan)
    task.start(0)
    return robot, task


def _precompile_plant(parameters: Parameters) -> None:
    """Call the plant as its node does."""
    samples = round(parameters.bus.exchange_period_s / parameters.drive.current_period_s)
    Plant(parameters).advance(np.zeros((samples, 3)), [False] * 3)


def _precompile_drive(parameters: Parameters) -> None:
    """Call a drive as its node does."""
    drive, shaft = MC4(parameters), (0.0, 0.0, 0.0)
    drive.begin_cycle(shaft[0], CONTROL_ON, *shaft)
    drive.run_period(*shaft)
    drive.powered  # noqa: B018 (a kernel tells it)
    drive.clear_fault()
    drive.extrapolate_cycle(*shaft)
    scope = DriveScope(drive, tuple(CHANNELS.values()), 1, lambda: parameters, lambda _: None)
    scope.run_period(0, *shaft)
    scope.flush()
    drive.leave_bus()


def _precompile_planning(parameters: Parameters) -> None:
    program_planner.plan(_rehearsal(parameters), np.array(parameters.motion.home_m), parameters)


def _precompile_task(parameters: Parameters) -> None:
    """Call the task as its node does: it looks at plans, commands, and receives answers."""
    _, task = _started(Program('rehearsal', (Dwell(1.0),)), parameters)
    check_speed(task.timeline.plan.move(0), 1.0, parameters)
    task.command(0)
    task.receive(0, np.zeros(3), np.zeros(3))
    _precompile_joints(parameters)


def _precompile_joints(parameters: Parameters) -> None:
    """Call what tells the joint states."""
    tree_joints(np.zeros((1, 3)), np.zeros((1, 3)), np.empty((1, 2, len(JOINTS))), geometry(parameters))


def _precompile_robot(parameters: Parameters) -> None:
    """Call drives and plant as the simulation does."""
    Robot(parameters).cycle(np.zeros(3), CONTROL_ON)


# One for each process. What takes longest comes first, one part with each process; who has done his own helps with that
# of another one, since none compiles what another one is compiling. The robot takes what plant and drive have done.
_ORDERS = (
    (_precompile_plant, _precompile_drive, _precompile_robot, _precompile_planning, _precompile_task),
    (_precompile_drive, _precompile_plant, _precompile_task, _stand, _precompile_planning),
    (_precompile_task, _precompile_planning, _precompile_drive, _precompile_plant, _stand),
    (_precompile_planning, _precompile_task, _precompile_plant, _precompile_drive, _precompile_robot),
)


def _rehearsal(parameters: Parameters) -> Program:
    """Return a program that asks for everything the planner knows."""
    limits = Limits(1.0, 10.0, 500.0)
    up, along = Target((0.0, 0.0, -0.01), relative=True), Target((0.02, 0.0, 0.0), relative=True)
    return Program(
        'rehearsal',
        (
            MoveL(up, limits=limits, blend_m=0.004),
            MoveL(along, limits=limits),
            MoveC(along, up, limits=limits),
            MoveL(along, limits=limits, time_optimal=True, torque_rate_n_m_s=1000.0),
            Dwell(0.01),
        ),
    )
