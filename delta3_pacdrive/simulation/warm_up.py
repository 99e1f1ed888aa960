"""Compilation and loading of all kernels in advance, because a bus cycle has no time for it."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.kinematics import geometry
from delta3_pacdrive.numerics.kernel import (
    all_compiled,
    alone,
    compiled,
    kernels,
    mark_compiled,
    shared,
    watched,
)
from delta3_pacdrive.parameters import Parameters, commissioned, flat_document
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.limits.limits import Limits, check_speed
from delta3_pacdrive.planning.limits.supply import MotorMotion, load_of_motion
from delta3_pacdrive.planning.limits.temperature import sampled_heat_load
from delta3_pacdrive.planning.program.model import Dwell, MoveC, MoveL, Program, Target
from delta3_pacdrive.robot.drive.channels import CHANNELS
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.drive.mounting import INVERTED
from delta3_pacdrive.robot.drive.procedures import Procedure
from delta3_pacdrive.robot.drive.scope import DriveScope
from delta3_pacdrive.robot.plant.dc_link import DcLink, advance_link
from delta3_pacdrive.robot.plant.plant import Plant
from delta3_pacdrive.robot.plant.rotary_plant import RotaryPlant
from delta3_pacdrive.robot.plant.temperatures import Temperatures
from delta3_pacdrive.robot.sercos.telegrams import JOINTS
from delta3_pacdrive.robot.sercos.words import CONTROL_ON
from delta3_pacdrive.scene.joints import tree_joints
from delta3_pacdrive.simulation.robot import Robot
from delta3_pacdrive.simulation.run import run


def load_kernels(parameters: Parameters) -> None:
    """Load everything that ``run`` needs; compile missing kernels.

    Parameters
    ----------
    parameters
        Parameters of the robot that will run.

    """
    compile_kernels(parameters)
    _stand(commissioned(parameters))


Show = Callable[[int, int], None]


def compile_kernels(parameters: Parameters | None = None, show: Show = lambda done, total: None) -> None:
    """Compile missing kernels on all cores; if another process is compiling them, wait for it.

    Parameters
    ----------
    parameters
        Parameters of the robot that will run; None: a plain one.
    show
        Called with the number of compiled kernels and their total, which is 0 for those only this kind of robot needs.

    """
    if not all_compiled():
        _compile_together(core.load(), lambda: show(compiled(), kernels()))
    if parameters is not None and parameters.kind and not all_compiled(parameters.kind):
        before = compiled()
        _compile_together(parameters, lambda: show(compiled() - before, 0))


def _compile_together(parameters: Parameters, show: Callable[[], None]) -> None:
    """Compile the kernels of a robot, unless another process has done so meanwhile."""
    show()
    with alone(show), watched(show):
        if not all_compiled(parameters.kind):
            _compile(parameters)
            mark_compiled(parameters.kind)


def _compile(parameters: Parameters) -> None:
    """Compile the parts in parallel, one process per core, then everything that depends on all of them.

    Processes are used because the compiler holds a lock, and new interpreters because the caller may have threads.
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
        precompile_parts(0, parameters)  # includes parts that a helper failed to compile
    finally:
        for helper in helpers:
            helper.kill()
            helper.wait()


# a helper process ends with its parent
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
        Number of the process, 0 to 3, which selects the order of the parts.
    parameters
        Parameters of the robot that will run.

    """
    parameters = commissioned(parameters)
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
    """Run every kernel once, so that none is compiled or loaded during a bus cycle.

    Parameters
    ----------
    parameters
        Parameters of the robot that will run.

    """
    compile_kernels(parameters)
    _call_all(commissioned(parameters))


def load_cyclic_kernels(parameters: Parameters) -> None:
    """Load the kernels of the nodes' bus cycles, in the process from which the nodes are forked.

    Otherwise their first cycles are late, by up to 72 ms on a slow machine.

    Parameters
    ----------
    parameters
        Parameters of the robot that will run.

    """
    for part in (_precompile_plant, _precompile_drive, _precompile_task):
        part(commissioned(parameters))


def _call_all(parameters: Parameters) -> None:
    robot, task = _started(_rehearsal(parameters), parameters)
    robot.cycle(task.command(0).motors, task.control(0), task.payload)
    task.receive(0, robot.answers[0], robot.answers[2])
    _precompile_plant(parameters)
    _precompile_drive(parameters)
    _stand(parameters)
    _precompile_joints(parameters)
    task.servo.precompile(task.timeline)
    task.hold()
    robot.drives[0].phase_currents()


def _started(program: Program, parameters: Parameters) -> tuple[Robot, Transformation]:
    """Return a robot with disabled drives, and a task that has started a program."""
    quick = parameters.replace(motion__enable_cycle=-1)
    robot, task = Robot(quick), Transformation(quick)
    task.load(program_planner.plan(program, task.locate(robot.encoder_positions()), quick).plan)
    task.start(0)
    return robot, task


def _precompile_plant(parameters: Parameters) -> None:
    """Call the plant as its node does."""
    samples = round(parameters.bus.exchange_period_s / parameters.drive.current_period_s)
    Plant(parameters).advance(np.zeros((samples, 3)), [False] * 3)
    link = DcLink(parameters)
    link.begin_cycle()
    advance_link(0.0, link.record)
    bodies, currents = Temperatures(parameters), np.zeros((samples, len(parameters.axes)))
    rotary = [RotaryPlant(parameters, number).state[0] for number in range(len(parameters.rotary_axes))]
    bodies.warm(Plant(parameters).state[0], rotary)
    bodies.collect(currents, [0.0] * len(parameters.axes))
    bodies.end_cycle()
    bodies.values()


def _precompile_drive(parameters: Parameters) -> None:
    """Call a drive as its node does."""
    drive, shaft = MC4(parameters), (0.0, 0.0, 0.0)
    drive.take_link(DcLink(parameters).values())
    drive.take_temperatures(Temperatures(parameters).of_axis(0))
    drive.begin_cycle(shaft[0], CONTROL_ON, *shaft)
    drive.run_period(*shaft)
    drive.powered  # noqa: B018 (calls a kernel)
    drive.clear_fault()
    drive.extrapolate_cycle(*shaft)
    drive.start_procedure(Procedure.HOMING)
    drive.cancel_procedure()
    drive.encoder_position(shaft[0])
    drive.set_data('polarity', 0.0)
    drive.set_data('polarity', INVERTED)
    scope = DriveScope(drive, tuple(CHANNELS.values()), 1, lambda: parameters, lambda _: None)
    scope.run_period(0, *shaft)
    scope.flush()
    drive.leave_bus()


def _precompile_planning(parameters: Parameters) -> None:
    program_planner.plan(_rehearsal(parameters), np.array(parameters.motion.home_m), parameters)
    still = np.zeros((2, 3))
    times_s = np.array([0.0, parameters.bus.cycle_time_s])
    load_of_motion([MotorMotion(times_s, still, still, parameters)], parameters)
    sampled_heat_load(times_s, still, still, still, parameters).temperatures(parameters)


def _precompile_task(parameters: Parameters) -> None:
    """Call the task as its node does: check plans, command, and receive feedback."""
    _, task = _started(Program('rehearsal', (Dwell(1.0),)), parameters)
    check_speed(task.timeline.plan.move(0), 1.0, parameters)
    task.command(0)
    task.receive(0, np.zeros(3), np.zeros(3))
    task.servo.precompile(task.timeline)
    _precompile_joints(parameters)


def _precompile_joints(parameters: Parameters) -> None:
    """Call the computation of the joint states."""
    tree_joints(np.zeros((1, 3)), np.zeros((1, 3)), np.empty((1, 2, len(JOINTS))), geometry(parameters))


def _precompile_robot(parameters: Parameters) -> None:
    """Call drives and plant as the simulation does."""
    Robot(parameters).cycle(np.zeros(3), CONTROL_ON)


# One order per process, longest part first, each process with another part. A process that has finished its part helps
# with those of the others, since a kernel being compiled is skipped. The robot reuses the kernels of plant and drive.
_ORDERS = (
    (_precompile_plant, _precompile_drive, _precompile_robot, _precompile_planning, _precompile_task),
    (_precompile_drive, _precompile_plant, _precompile_task, _stand, _precompile_planning),
    (_precompile_task, _precompile_planning, _precompile_drive, _precompile_plant, _stand),
    (_precompile_planning, _precompile_task, _precompile_plant, _precompile_drive, _precompile_robot),
)


def _rehearsal(parameters: Parameters) -> Program:
    """Return a program that uses all functions of the planner."""
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
