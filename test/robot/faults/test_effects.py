"""Tests of the effects of faults on drive, plant and robot."""

import itertools

import numpy as np
import pytest

from delta3_pacdrive import simulation
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.faults import effects
from delta3_pacdrive.robot.faults.fault import KINDS, NAMES, parse
from delta3_pacdrive.robot.faults.schedule import Schedule, Scheduled
from delta3_pacdrive.robot.plant.dc_link import DcLink
from delta3_pacdrive.robot.plant.plant import Plant
from delta3_pacdrive.robot.plant.temperatures import Temperatures
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from injected_faults import LINE, example, run


class Machine:
    """Drive of axis 2 and plant, to which faults happen."""

    def __init__(self, robot):
        self.drive, self.plant, self.link = MC4(robot), Plant(robot), DcLink(robot)
        self.temperatures = Temperatures(robot)
        self.schedule = Schedule()
        self.nominal = [record.copy() for record in self._records()]

    def add(self, document):
        self.schedule.add(Scheduled.of(parse(document, 'fault'), 0, 1e-3))

    def go_to(self, cycle):
        changes, active = self.schedule.due(cycle), self.schedule.active
        effects.apply_to_drive(self.drive.state[0], 'axis2', changes, active)
        effects.apply_to_plant(self.plant.state[0], changes, active)
        effects.apply_to_link(self.link.state[0], active)
        effects.apply_to_temperatures(self.temperatures.bodies, active, DRIVES)

    @property
    def is_as_new(self):
        return self._records() == self.nominal

    def _records(self):
        bodies = self.temperatures.bodies['state']
        return [self.drive.state, self.plant.state, self.link.state, *bodies]

    def of_plant(self, name):
        return self.plant.state[name][0].tolist()

    def of_drive(self, name):
        return float(self.drive.state[name][0])


def test_clear_removes_every_fault_of_drive_and_plant(robot):
    machine = Machine(robot)
    for kind in KINDS.keys() - {
        'clear',
        'payload_lost',
    }:  # what has fallen off stays there until it is gripped again
        machine.add({key: value for key, value in example(kind).items() if key != 'for_s'})
    machine.go_to(250)
    assert not machine.is_as_new
    machine.add({'fault': 'clear', 'after_s': 0.3})
    machine.go_to(300)
    assert machine.is_as_new
    assert machine.schedule.active == []


@pytest.mark.parametrize(
    'kind', [name for name in NAMES if not KINDS[name].once and not KINDS[name].telegram]
)
def test_a_fault_that_ends_leaves_the_fields_as_they_were(kind, robot):
    machine = Machine(robot)
    machine.add(example(kind))
    machine.go_to(249)
    assert machine.is_as_new
    machine.go_to(250)
    assert not machine.is_as_new
    machine.go_to(750)
    assert machine.is_as_new


def of(kind, after_s, for_s, **value):
    return {'fault': kind, 'axis': 'axis2', 'after_s': after_s, 'for_s': for_s, **value}


def test_faults_of_one_kind_that_overlap_add_up_and_each_ends_at_its_time(robot):
    machine = Machine(robot)
    machine.add(of('overload', 0.1, 0.5, torque_n_m=3.0))
    machine.add(of('overload', 0.2, 0.1, torque_n_m=2.0))
    machine.add(of('brake_worn', 0.1, 0.5, lost_share=0.5))
    machine.add(of('brake_worn', 0.2, 0.1, lost_share=0.5))
    machine.add(of('encoder_jump', 0.1, 0.5, jump_rad=0.5))
    machine.add(of('encoder_jump', 0.2, 0.1, jump_rad=0.25))
    machine.add(of('encoder_drift', 0.1, 0.5, drift_rad_s=0.5))
    machine.add(of('encoder_drift', 0.2, 0.1, drift_rad_s=0.25))
    machine.add(of('encoder_noise', 0.1, 0.5, noise_rad=0.5))
    machine.add(of('encoder_noise', 0.2, 0.1, noise_rad=0.25))
    machine.add(of('dc_link', 0.1, 0.5, voltage_v=400.0))
    machine.add(of('dc_link', 0.2, 0.1, voltage_v=300.0))
    seen = {}
    for cycle in (150, 250, 350, 650):
        machine.go_to(cycle)
        seen[cycle] = (
            machine.of_plant('load_torque')[1],
            machine.of_plant('brake_share')[1],
            machine.of_drive('encoder_offset'),
            machine.of_drive('encoder_drift'),
            machine.of_drive('encoder_noise'),
            machine.of_drive('dc_link'),
        )
    assert seen[150] == (3.0, 0.5, 0.5, 0.5, 0.5, 400.0)
    assert seen[250] == (5.0, 0.25, 0.75, 0.75, 0.75, 300.0)
    assert seen[350] == seen[150]
    assert machine.is_as_new


def test_faults_of_other_axes_leave_a_drive_alone(robot):
    machine = Machine(robot)
    for kind in ('encoder_failure', 'encoder_jump', 'encoder_noise', 'winding_short', 'dc_link'):
        machine.add(example(kind) | {'axis': 'axis3'})
    machine.go_to(300)
    assert machine.is_as_new


def test_bridged_losses_cost_micrometres(robot):
    telegrams = itertools.product(('drop_mdt', 'drop_at'), DRIVES)
    faults = [
        {'fault': kind, 'axis': axis, 'after_s': 0.2 + 0.03 * n} for n, (kind, axis) in enumerate(telegrams)
    ]
    trace = run(robot, *faults)
    assert trace.meta['stopped'] == ''
    assert trace['tcp_actual'][-1] == pytest.approx([0.2, 0.0, -0.78], abs=1e-5)
    undisturbed = run(robot)
    away = np.linalg.norm(trace['shaft_position'] - undisturbed['shaft_position'], axis=1).max()
    assert 0.0 < away < 2e-3  # motor shaft; 25 um at the elbow


@pytest.mark.parametrize(
    ('fault', 'number'),
    [
        ({'fault': 'drop_mdt', 'axis': 'axis2', 'cycles': 2}, '8112'),
        ({'fault': 'corrupt_at', 'axis': 'axis2', 'cycles': 2}, '8506'),
        ({'fault': 'encoder_failure', 'axis': 'axis2'}, '8171'),
        ({'fault': 'winding_short', 'axis': 'axis2'}, '8905'),
        ({'fault': 'dc_link', 'axis': 'axis2', 'voltage_v': 200.0}, '8909'),
        ({'fault': 'emergency_stop'}, 'emergency stop'),
    ],
)
def test_a_fault_stops_the_robot_which_stays_where_it_can_be(fault, number, robot):
    trace = run(robot, fault | {'after_s': 0.3})
    assert number in trace.meta['stopped']
    start = robot.motion.start_cycle
    assert int(trace.meta['stopped'].partition('bus cycle ')[2].split(':')[0].split()[0]) - start in range(
        300, 304
    )
    # it stands, short of the end, and inside the workspace
    assert np.abs(trace['shaft_speed'][-1]).max() == 0.0
    assert np.abs(trace['current'][-1]).max() == 0.0
    assert 0.03 < trace['tcp_actual'][-1, 0] < 0.17
    radius = np.hypot(trace['tcp_actual'][:, 0], trace['tcp_actual'][:, 1])
    assert radius.max() < robot.kinematics.workspace_diameter_m / 2


def test_two_runs_with_noise_are_the_same_to_the_bit(robot):
    noise = {'fault': 'encoder_noise', 'axis': 'axis3', 'noise_rad': 1e-3, 'after_s': 0.1}
    first, second = run(robot, noise), run(robot, noise)
    for name, values in first.signals.items():
        np.testing.assert_array_equal(second[name], values, err_msg=name)
    assert np.ptp(first['current'][400:500, 2]) > 5 * np.ptp(run(robot)['current'][400:500, 2])


def test_a_lost_payload_is_felt_in_the_current_of_the_acceleration(robot):
    lost = run(robot, {'fault': 'payload_lost', 'after_s': 0.0})
    carried = run(robot)
    lighter = np.abs(lost['current'][150:220]).max() / np.abs(carried['current'][150:220]).max()
    assert 0.5 < lighter < 0.95


def test_a_simulation_has_no_processes(robot):
    with pytest.raises(RunError, match='a simulation has no processes'):
        run(robot, {'fault': 'kill', 'node': 'plant'})


def test_a_simulation_counts_the_at_that_are_lost(robot):
    def lost(*faults):
        return simulation.run(programs.parse(LINE | {'faults': list(faults)}, robot.motion), robot).meta

    one = {'fault': 'drop_at', 'axis': 'axis1', 'after_s': 0.1}
    assert lost()['lost_telegrams'] == 0
    assert lost(one, one | {'axis': 'axis3', 'after_s': 0.2})['lost_telegrams'] == 2
    assert lost({'fault': 'drop_mdt', 'axis': 'axis1', 'after_s': 0.1})['lost_telegrams'] == 0


def test_a_fault_that_is_due_after_the_end_of_the_program_is_noticed(robot):
    late = {'fault': 'drop_at', 'axis': 'axis1', 'after_s': 5.0}
    (notice,) = simulation.run(programs.parse(LINE | {'faults': [late]}, robot.motion), robot).meta['notices']
    assert notice.startswith('drop_at axis1 is due 5 s after the start, the program takes 0.')
    in_time = late | {'after_s': 0.1}
    assert (
        simulation.run(programs.parse(LINE | {'faults': [in_time]}, robot.motion), robot).meta['notices']
        == []
    )
