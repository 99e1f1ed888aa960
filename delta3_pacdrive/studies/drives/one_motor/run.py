"""Single-motor study: runs one motor; writes figures 8.2 to 8.4, table and trace.

The motor follows the motion of one arm, with the drive code of the robot and a load instead of the arms. The whole
robot runs first. The motor follows its command and receives a share of its coupling torque d.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive import simulation
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.errors import ProgramError, RunError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, Parameters
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.robot import motor as motors
from delta3_pacdrive.robot.plant.single_motors import SingleMotors, alone
from delta3_pacdrive.simulation.robot import Robot
from delta3_pacdrive.studies.drives.one_motor import figures, report
from delta3_pacdrive.studies.drives.one_motor.study import Settings, SingleRun
from delta3_pacdrive.studies.framework import study as studies
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.framework.study import OnProgress
from delta3_pacdrive.studies.runs import oscilloscope as oscilloscope_run
from delta3_pacdrive.studies.runs.oscilloscope import Oscilloscope

LEFT = ('reference', 'speed_reference', 'current_reference', 'motor_current', 'coupling')
PROGRESS_EVERY = 50  # cycles


def run_motor(program: Program, parameters: Parameters, axis: int, on_progress: OnProgress) -> SingleRun:
    """Run the robot, then the single motor of an axis.

    Raises
    ------
    ParameterError
        The robot has effects that a single motor does not support.
    ProgramError
        The program is rejected.
    RunError
        A drive has no torque at or after the program start.

    """
    placed = simulation.placed(oscilloscope_run.finest(parameters), program)
    simulation.require_homed(placed)
    single = alone(placed)
    robot = oscilloscope_run.run(program, parameters, on_progress, 'robot', LEFT)
    machine, task = Robot(single), Transformation(single)
    per_exchange = robot.scope.per_exchange
    machine.plant = SingleMotors(single, robot.scope.left['coupling'][::per_exchange])
    task.load(program_planner.plan(program, task.locate(machine.encoder_positions()), single).plan)
    task.enable(single.motion.enable_cycle)
    task.start(single.motion.start_cycle)
    cycles = task.last_cycle + 1
    scope = Oscilloscope(machine, cycles * robot.steps, LEFT)
    commands = np.empty((cycles, 3))
    for cycle in range(cycles):
        command = task.command(cycle)
        commands[cycle] = command.motors[:ARMS]
        status = scope.begin_cycle(commands[cycle], command.control, command.torques)
        for _ in range(robot.steps // per_exchange):
            scope.exchange()
        if cycle >= single.motion.start_cycle and not machine.drives[axis - 1].powered:
            raise RunError(f'the drive has no torque in bus cycle {cycle}, status {status[axis - 1]}')
        if cycle % PROGRESS_EVERY == 0:
            on_progress('single motor', cycle, cycles)
    return _results(robot, scope, commands, single, axis)


def _results(
    robot: oscilloscope_run.Recorded, scope: Oscilloscope, commands: Floats, single: Parameters, axis: int
) -> SingleRun:
    i, period_s = axis - 1, single.drive.current_period_s
    found = {name: values[:, i] for name, values in scope.found.items()}
    left = {name: values[:, i] for name, values in scope.left.items()}
    m = motors.motor(single)[0]
    ratio = single.dynamics.gear_ratio
    current, speed = left['motor_current'], found['speed']
    before = np.concatenate([current[:1], current[:-1]])
    phases = [motors.phase_currents(*at, m) for at in zip(current, found['position'], strict=True)]
    load = single.motor.load_torque_n_m / ratio
    # the true speed of the shaft is known at the start of an exchange only
    per_exchange = scope.per_exchange
    rises = np.diff(speed[::per_exchange], append=speed[-1])
    return SingleRun(
        program=robot.meta['program'],
        axis=axis,
        robot=single,
        inertia_kg_m2=single.drive.observer_arm_inertia_kg_m2 / ratio**2,
        time_s=np.asarray(
            np.arange(len(speed)) * period_s - single.motion.start_cycle * single.bus.cycle_time_s,
            dtype=np.float64,
        ),
        command=np.repeat(commands[:, i], robot.steps),
        reference=left['reference'],
        position=found['position'],
        speed=speed,
        acceleration=np.repeat(rises, per_exchange) / (per_exchange * period_s),
        speed_reference=left['speed_reference'],
        current_reference=left['current_reference'],
        current=current,
        voltage=found['voltage'],
        phase_currents=np.array(phases),
        torque=m['torque_constant'] * 0.5 * (before + current),
        friction=np.array([motors.friction_torque(one, m) for one in speed]),
        load=np.full(len(speed), load),
        coupling=left['coupling'] - load,
        position_error=left['reference'] - found['position'],
        in_robot=robot.scope.found['position'][:, i],
        meta=robot.meta,
    )


@dataclass
class Study(studies.Study):
    """Single-motor study; ``inputs`` are its files with the digests of their bytes."""

    settings: Settings
    program: Program
    inputs: Sequence[str]
    robot: core.Parameters = field(init=False)

    def __post_init__(self) -> None:
        """Read the parameters; raises Delta3Error."""
        chosen = self.settings
        given = {
            'motor__load_inertia_kg_m2': chosen.load_inertia_kg_m2,
            'motor__load_torque_n_m': chosen.load_torque_n_m,
            'motor__coupling_effect': chosen.coupling_effect,
        }
        self.robot = core.load(chosen.parameters).replace(
            **{name: value for name, value in given.items() if value is not None}
        )
        if self.program.faults:
            raise ProgramError(f'{self.program.name} injects faults, which a single motor does not support')

    def run(self) -> dict[str, Any]:
        """Run the motor, write all results and return the report; raises Delta3Error."""
        chosen = self.settings
        found = run_motor(self.program, self.robot, chosen.axis, self.on_progress)
        origin = Provenance.of(self.command, self.robot, chosen.parameters, self.inputs)
        folder = ReportFolder(self.folder, origin)
        folder.clear([report.TABLE, 'figure_8_*.png'])
        document = report.summary(found)
        if chosen.trace:
            trace = report.trace(found)
            trace.meta['provenance'] = origin.lines()
            trace_file.save(trace, chosen.trace)
        self.on_progress('table and figures', 0, 0)
        return folder.results(
            'One motor', document, report.text(document), report.tables(found), figures.by_name(found)
        )
