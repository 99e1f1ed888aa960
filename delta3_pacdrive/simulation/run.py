"""All of the machine in one loop, without ROS: the same control and plant code as the nodes, cycle by cycle."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from delta3_pacdrive.controller.transformation import Transformation
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.motion import plan_times, program_planner
from delta3_pacdrive.motion.learned import Learned
from delta3_pacdrive.motion.program import Program
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters, flat_document
from delta3_pacdrive.peripherals.cell import Cell
from delta3_pacdrive.peripherals.world import World
from delta3_pacdrive.plant.decoupled import require_stable
from delta3_pacdrive.recording.acquisition import Acquisition
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.simulation.cycle import SimulatedOperation
from delta3_pacdrive.simulation.robot import Robot
from delta3_pacdrive.simulation.scoped import ScopedRobot

Planner = Callable[[Program, Floats, Parameters], program_planner.Planned]


def placed(parameters: Parameters, program: Program) -> Parameters:
    """Return the parameters of a robot that stands where the program starts.

    Parameters
    ----------
    parameters
        Of the robot.
    program
        Its ``start_m`` and ``start_turn_rad``, if it has them, become the home of the robot and of its tool.

    """
    places: dict[str, Any] = {}
    if program.start_m is not None:
        places['motion__home_m'] = program.start_m
    if program.start_turn_rad is not None and parameters.rotary.present:
        places['rotary__home_deg'] = math.degrees(program.start_turn_rad)
    return parameters.replace(**places) if places else parameters


def plan_of(
    program: Program, parameters: Parameters, machine: Parameters | None = None
) -> program_planner.Planned:
    """Return the plan of a program as ``run`` makes it; raises ProgramError.

    Parameters
    ----------
    program
        What is driven.
    parameters
        Of the robot, as ``placed`` returns them.
    machine
        Of the robot, where the controller takes it for another one: its encoders say where it stands.

    """
    robot = Robot(parameters if machine is None else machine)
    return program_planner.plan(
        program, Transformation(parameters).locate(robot.encoder_positions()), parameters
    )


def run(
    program: Program,
    parameters: Parameters,
    acquisition: Acquisition | None = None,
    signals: Sequence[str] = (),
    learned: Learned | None = None,
    machine: Parameters | None = None,
    planner: Planner = program_planner.plan,
    cell: Cell | None = None,
) -> Trace:
    """Run a program from the start of cyclic operation to the settled end; the robot stands where it starts.

    Parameters
    ----------
    program
        What is driven, with its faults.
    parameters
        Of the robot.
    acquisition
        Takes what oscilloscopes in the drives show, if any have some; the signals are the same.
    signals
        Held on request, beside the usual ones, which are the same: ``payload``, ``outputs``, ``lost_telegrams``, and
        ``drive_`` with the name of a channel of the drives.
    learned
        Torques that the controller commands beside those of its model; for another plan they are none.
    machine
        Of the robot, where the controller takes it for another one.
    planner
        Plans the program from where the robot stands; one that knows many plans saves the time to make them again.
    cell
        What stands around the robot: its gripper takes real parts then, and the payload of the program is what the
        controller believes. Signals ``cell_...`` are held on request.

    Returns
    -------
    Trace
        All signals cycle by cycle, shapes (cycles, 3), and figures of the run in ``meta``.

    Raises
    ------
    ProgramError
        The program is refused.
    ParameterError
        What the program grips is too heavy for arms that are decoupled.
    RunError
        The drives are not enabled when the program should start, or one trips.

    """
    parameters = placed(parameters, program)
    built = parameters if machine is None else placed(machine, program)
    robot = Robot(built) if acquisition is None else ScopedRobot(built, acquisition)
    task = Transformation(parameters, learned)
    tcp = task.locate(robot.encoder_positions())
    planned = planner(program, tcp, parameters)
    gripped = [change['payload_kg'] for change in plan_times.output_changes(planned.plan)]
    if cell is not None:
        gripped += [part.mass_kg for part in cell.parts.values()]
    require_stable(parameters, max([planned.plan.move(0).payload_kg, *filter(None, gripped)]))
    task.load(planned.plan)
    motion = parameters.motion
    if motion.enable_cycle < 0 or motion.start_cycle < 0:
        raise RunError('motion.enable_cycle and motion.start_cycle must not be negative in a simulation')
    task.enable(motion.enable_cycle)
    task.start(motion.start_cycle)
    world = None if cell is None else World(cell, parameters.bus.cycle_time_s, motion.start_cycle)
    operation = SimulatedOperation(robot, task, program.faults, parameters, signals, world)
    try:
        found = operation.run()
    finally:
        if isinstance(robot, ScopedRobot):
            robot.finish()
    note_currents(robot, task)
    driven = {
        'program': planned.name,
        'notices': list(planned.notices),
        'program_s': planned.plan.duration_s,
        'repeat': planned.repeat,
        'moves': plan_times.driven_moves(planned.plan),
        'outputs': plan_times.output_changes(planned.plan),
        'start_cycle': parameters.motion.start_cycle,
        'end_cycle': task.end_cycle,
        'planned_end_m': planned.plan.end_m().tolist(),
        'figures': task.figures().to_dict() | ({} if robot.tool is None else robot.tool.to_dict()),
        'faults': [fault.to_document() | {'text': fault.text} for fault in program.faults],
        'unlearned': task.learned.reason,
    }
    return trace_of(found, driven, operation, parameters, world)


def note_currents(robot: Robot, task: Transformation) -> None:
    """Let the task know the currents of the motors in its program, as the drives have formed them of all samples."""
    for axis, drive in enumerate(robot.drives):
        task.current_peak[axis], task.current_rms[axis] = drive.program_current()


def trace_of(
    found: dict[str, Floats],
    driven: dict[str, Any],
    operation: SimulatedOperation,
    parameters: Parameters,
    world: World | None,
) -> Trace:
    """Return the trace of a simulation.

    Parameters
    ----------
    found
        Its signals, torques [N m] in place of currents.
    driven
        What was driven, for the ``meta``.
    operation
        Its bus cycles.
    parameters
        Of the robot.
    world
        The cell around it, if there is one.

    """
    found['current'] /= parameters.motor.torque_constant_n_m_a
    meta = {
        'stopped': operation.stopped,
        'stop_source': operation.stop_source,
        'stop_cycle': operation.stop_cycle if operation.stopped else None,
        'lost_telegrams': operation.lost,
        'drive_status': operation.drive_status,
        'checksum': parameters.checksum,
        'parameters': flat_document(parameters),
        'controller': parameters.controller,
        'gear_ratio': parameters.dynamics.gear_ratio,
        'rich': parameters.rich.enabled,
        'cycle_time_s': parameters.bus.cycle_time_s,
        'exchange_period_s': parameters.bus.exchange_period_s,
        **driven,
    }
    if world is not None:
        world.finish()
        meta['cell'], meta['cell_scene'] = world.report(), world.scene
    times_s = np.arange(len(found['current']), dtype=np.float64) * parameters.bus.cycle_time_s
    return Trace(times_s, found, meta)
