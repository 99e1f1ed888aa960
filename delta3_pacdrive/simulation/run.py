"""The whole machine in one loop, without ROS: the control and plant code of the nodes, cycle by cycle."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from delta3_pacdrive.cell.cell import Cell
from delta3_pacdrive.cell.world import World
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, Parameters, commissioned, flat_document, numbered
from delta3_pacdrive.planning import plan_times, program_planner
from delta3_pacdrive.planning.learned_torques import Learned
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.recording.acquisition import Acquisition
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.plant.decoupled import require_stable
from delta3_pacdrive.simulation.cycle import SimulatedOperation
from delta3_pacdrive.simulation.robot import Robot
from delta3_pacdrive.simulation.scoped import ScopedRobot

Planner = Callable[[Program, Floats, Parameters], program_planner.Planned]


def placed(parameters: Parameters, program: Program) -> Parameters:
    """Return the parameters of a robot that is at the start of a program.

    Parameters
    ----------
    parameters
        Parameters of the robot.
    program
        Its ``start_m`` and ``start_turns_rad``, if present, replace the home position and the home angle of the tool.

    """
    places: dict[str, Any] = {}
    if program.start_m is not None:
        places['motion__home_m'] = program.start_m
    for number, (angle, _) in enumerate(zip(program.start_turns_rad, parameters.rotary_axes, strict=False)):
        places[f'{numbered("rotary", number)}__home_deg'] = math.degrees(angle)
    return parameters.replace(**places) if places else parameters


def require_homed(machine: Parameters) -> None:
    """Raise RunError if the encoders of a simulated ``machine`` do not know the positions of its axes."""
    if not machine.mounting.homed_at_start:
        raise RunError(
            'the axes are not homed (mounting.commissioned, mounting.encoder): a simulated program needs a '
            'commissioned robot; delta3 up starts one that is not'
        )


def plan_of(
    program: Program, parameters: Parameters, machine: Parameters | None = None
) -> program_planner.Planned:
    """Return the plan of a program as made by ``run``; raises ProgramError.

    Parameters
    ----------
    program
        The program.
    parameters
        Parameters of the robot, as returned by ``placed``.
    machine
        Parameters of the plant if they differ from those of the controller; its encoders determine the position.

    """
    robot = Robot(commissioned(parameters if machine is None else machine))
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
    """Run a program from its start position, from the start of cyclic operation until the robot has settled.

    Parameters
    ----------
    program
        The program, with its faults.
    parameters
        Parameters of the robot.
    acquisition
        Receives the records of oscilloscopes in the drives, if any; the signals do not change.
    signals
        Optional signals in addition to the usual ones: ``payload``, ``outputs``, ``lost_telegrams``, ``drive_`` with
        the name of a channel of the drives, and ``cell_...`` with a cell.
    learned
        Torques commanded in addition to those of the model, only with the plan they were learned for.
    machine
        Parameters of the plant if they differ from those of the controller.
    planner
        Plans the program from the position of the robot; may return cached plans.
    cell
        The cell around the robot. Its gripper then takes simulated parts, and the payload of the program is only the
        assumption of the controller.

    Returns
    -------
    Trace
        All signals cycle by cycle, shapes (cycles, 3), and results of the run in ``meta``.

    Raises
    ------
    ProgramError
        The program is rejected.
    ParameterError
        The gripped payload is too heavy for decoupled arms.
    RunError
        The drives are not enabled at the start of the program, or one trips.

    """
    parameters = placed(parameters, program)
    built = parameters if machine is None else placed(machine, program)
    require_homed(built)
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
    operation = SimulatedOperation(robot, task, program.faults, parameters, signals, world=world)
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
        'figures': task.figures().to_dict() | robot.turn_figures(),
        'faults': [fault.to_document() | {'text': fault.text} for fault in program.faults],
        'unlearned': task.learned.reason,
    }
    return trace_of(found, driven, operation, parameters, world)


def note_currents(robot: Robot, task: Transformation) -> None:
    """Set the currents of the task to those that the drives formed of all samples of the program."""
    for axis, drive in enumerate(robot.drives[:ARMS]):
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
        Its signals, with torques [N m] instead of currents.
    driven
        Description of the program, for the ``meta``.
    operation
        Its bus cycles.
    parameters
        Parameters of the robot.
    world
        The cell around it, if any.

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
