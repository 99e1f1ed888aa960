"""Options of a bring-up and their validation."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive import parameters as core
from delta3_pacdrive import simulation
from delta3_pacdrive.bringup.processes import ManagedProcess
from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.control.operation.script_gate import first_decision
from delta3_pacdrive.errors import ParameterError, RunError
from delta3_pacdrive.planning import learned_torques as learned
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.adapted_program import rest_of
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.planning.program.output_names import OWN
from delta3_pacdrive.robot.plant.decoupled import require_stable
from delta3_pacdrive.ros.wire import domain, frames


@dataclass(frozen=True)
class Options:
    """Options of a bring-up; without a program the robot stays up until it is interrupted."""

    program: Path | None
    parameters: Path | None = None
    namespace: str = '/'
    real_time_factor: float = 1.0
    bag: Path | None = None
    single_process: bool = False
    exchange_period_s: float | None = None
    real_time_priority: bool = True
    crowded: str | None = None  # reason against real-time scheduling, empty if possible; None: check
    markers: bool = False  # also start the markers for RViz and Foxglove
    joint_motion: bool = False  # publish joint motion through the Jacobian
    logs: Path | None = None  # folder for the processes' logs; None: temporary
    learned: Path | None = None  # file of learned torques
    memory: Path | None = None  # folder of the data stored by the drives; None: they are lost with the robot
    first: int = 0  # first statement of the program
    script: bool = False  # a script moves the robot, from a known bus cycle
    cell: Path | None = None  # cell file
    shared_clock: str = ''  # bus clock shared with other robots; empty: a separate one
    clock_member: int = 0  # number of the robot on that clock
    frame_prefix: str = ''  # of the frames of all messages and links
    patience_s: float = 30.0  # timeout for cyclic operation
    view: ManagedProcess | None = None  # the page, as started by ``page.started``


def check_options(
    options: Options,
) -> tuple[core.Parameters, Program | None, program_planner.Planned | None]:
    """Read and validate everything before the first process starts."""
    robot = core.load(options.parameters)
    if options.exchange_period_s is not None:
        robot = robot.replace(bus__exchange_period_s=options.exchange_period_s)
    if robot.motion.enable_cycle < 0 or robot.motion.start_cycle < 0:
        raise ParameterError('a bring-up needs motion.enable_cycle and motion.start_cycle of at least 0')
    domain.namespace(options.namespace)
    frames.checked_prefix(options.frame_prefix)
    if options.bag is not None and options.bag.exists():
        raise RunError(f'cannot record into {options.bag}: it exists already')
    outputs = OWN
    if options.cell is not None:
        around = cell_file.load(options.cell)
        outputs = around.output_names
        require_stable(robot, max((part.mass_kg for part in around.parts.values()), default=0.0))
    torques = learned.load(options.learned) if options.learned is not None else None
    if torques is not None:
        torques.require_robot(robot, str(options.learned))
    if options.script:
        first_decision(robot)
    if options.program is None:
        return robot, None, None
    program = rest_of(programs.load(options.program, robot.motion, outputs), options.first, robot)
    robot = simulation.placed(robot, program)
    if torques is not None:
        torques.require(simulation.plan_of(program, robot).plan, robot, str(options.learned))
    return robot, program, program_planner.plan(program, robot.motion.home_m, robot)
