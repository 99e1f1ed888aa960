"""A simulated robot for the commissioning: the generator and the oscilloscopes of its drives, without ROS."""

import json

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader
from delta3_pacdrive.recording.acquisition import Acquisition, setting
from delta3_pacdrive.robot.drive.operation_data import TABLE
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.service_channel import parse_idn
from delta3_pacdrive.simulation.cycle import SimulatedOperation
from delta3_pacdrive.simulation.scoped import ScopedRobot
from delta3_pacdrive.studies.drives.commissioning.robot import AxisRecord, ProgramRun, RestRecord

AT_REST_S = 0.3  # recorded after the motion
CHANNELS = (
    'current_added',
    'current_asked',
    'current_reference',
    'current',
    'speed_filtered',
    'encoder_position',
)


class ExcitedRobot(ScopedRobot):
    """A robot whose generator starts at a bus cycle, and whose client is always present."""

    def __init__(self, parameters, acquisition, axis, start_cycle):
        super().__init__(parameters, acquisition)
        self.own, self.axis, self.start_cycle, self.cycles = parameters, axis, start_cycle, 0

    def cycle(self, *arguments, **more):
        drive = self.drives[self.axis]
        if self.cycles == self.start_cycle:
            assert drive.start_excitation(self.own)
        drive.attend_excitation()
        self.cycles += 1
        super().cycle(*arguments, **more)


class SimulatedRobot:
    """A robot at its home position, whose drives have the gains that were written to them."""

    def __init__(self, parameters, plant=None):
        self.parameters = parameters  # of the controller
        self.plant = {} if plant is None else plant  # differences of the machine
        self.values = dict.fromkeys(DRIVES, parameters)
        self.written = []
        self.fails_after_writes = None  # number of writes after which a motion fails
        self.channel = self

    def read(self, axis, idn):
        group, _, name = TABLE[parse_idn(idn)].sources[0].partition('.')
        return getattr(getattr(self.values[axis], group), name)

    def write(self, axis, idn, value):
        name = TABLE[parse_idn(idn)].sources[0].replace('.', '__')
        self.values[axis] = self.values[axis].replace(**{name: value})
        self.written.append((axis, idn, value))

    def angles_rad(self):
        return kinematics.inverse(self.parameters.motion.home_m, self.parameters.kinematics).tolist()

    def record(self, strokes, excited):
        if self.fails_after_writes is not None and len(self.written) >= self.fails_after_writes:
            raise ProgramError('axis2: 8111: following error')
        axis = DRIVES[strokes.axis]
        machine = self.values[axis].replace(**self.plant, drive__excitation_time_s=60.0)
        names = [f'{axis}.{name}' for name in CHANNELS]
        names += [f'{other}.encoder_position' for other in DRIVES if other != axis]
        records = []
        start_s = machine.motion.start_cycle * machine.bus.cycle_time_s
        acquisition = Acquisition(
            setting(machine, names, 16_000.0, start_s + strokes.duration_s + AT_REST_S), records.append
        )
        text = strokes.program(self.angles_rad(), machine.dynamics.gear_ratio)
        program = file_reader.parse(json.loads(text), machine.motion, 'strokes')
        start = machine.motion.start_cycle if excited else -1
        robot = ExcitedRobot(machine, acquisition, strokes.axis, start)
        task = Transformation(machine)
        planned = program_planner.plan(program, task.locate(robot.encoder_positions()), machine)
        task.load(planned.plan)
        task.enable(machine.motion.enable_cycle)
        task.start(machine.motion.start_cycle)
        SimulatedOperation(robot, task, (), machine).run()
        robot.finish()
        (record,) = records
        columns = dict(zip(record.names, record.values.T, strict=True))
        return AxisRecord(strokes.axis, record.first, record.setting.sample_time_s, columns)


class AcceptedRobot(SimulatedRobot):
    """A simulated robot with the results of its test program, of its brakes and of its bus."""

    def __init__(self, parameters, **results):
        super().__init__(parameters)
        self.tcp_error_m, self.moved_rad, self.lost = 0.1e-3, 1e-5, 0.0
        self.temperature_degc = 40.0
        vars(self).update(results)

    def read(self, axis, idn):
        known = {'S-0-0390': 0.0, 'S-0-0029': 0.0, 'S-0-0383': self.temperature_degc, 'S-0-0384': 30.0}
        return known[idn] if idn in known else super().read(axis, idn)

    def run_program(self, program):
        figures = {
            'tcp_error_max_m': self.tcp_error_m,
            'current_peak_a': [5.0, 5.5, 6.0],
            'current_rms_a': [2.0, 2.5, 3.0],
        }
        time_s = np.arange(100) * 1e-3
        return ProgramRun(figures, time_s, 0.01 * np.sin(time_s[:, None] * [10.0, 20.0, 30.0]))

    def rest(self):
        return RestRecord(np.zeros((100, 3)), [self.moved_rad, 0.0, 0.0])

    def bus(self):
        return {'lost_telegrams': self.lost, 'lateness_s': 1e-3}
