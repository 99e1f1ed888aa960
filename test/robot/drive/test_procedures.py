"""Tests of the procedure commands of a drive, on axes that are wired and mounted in different ways."""

import math

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.robot.drive.arrays import DriveState
from delta3_pacdrive.robot.drive.diagnostics import PROCEDURE_MESSAGES, DriveFault
from delta3_pacdrive.robot.drive.procedures import DONE, ERROR, INACTIVE, INTERRUPTED, STEP_TEXTS, Procedure
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, CONTROL_OFF, CONTROL_ON, Status, in_torque
from delta3_pacdrive.simulation.robot import Robot

POLE_PAIRS = 3
GEAR = 32.0
COMMUTATION_RAD = 1e-3  # electrical: 5e-7 of the torque
SWITCH_RAD = 5e-4  # motor: half a cycle of the slow approach and friction
STOP_RAD = 0.03  # motor: friction and weight over the stiffness of the end stop
LONGEST = 60_000  # bus cycles
REST = 300  # bus cycles in which an arm comes to rest under its brake


def mounted(robot, **mounting):
    """Return a robot with unknown offsets."""
    given = {
        'commissioned': False,
        'encoder_offset_rad': (137.4, -68.9, 1021.6),
        'rotor_offset_rad': (1.9, -0.7, 2.8),
    } | mounting
    return robot.replace(**{f'mounting__{name}': value for name, value in given.items()})


class Site:
    """A robot on a bus whose master switches the power on, without enabling the drives."""

    def __init__(self, given):
        self.parameters, self.robot = given, Robot(given)
        self.commands = np.zeros(len(given.axes))
        self.run(50)

    def run(self, cycles, control=CONTROL_ON):
        """Run some bus cycles."""
        for _ in range(cycles):
            self.robot.cycle(self.commands, control)
        return self

    def drive(self, axis=0):
        """Return the drive of an axis."""
        return self.robot.drives[axis]

    def value(self, name, axis=0):
        """Return a field of the state of a drive."""
        return self.drive(axis).state[name][0].item()

    def start(self, procedure, axis=0):
        """Start a procedure that the drive permits."""
        assert self.drive(axis).start_procedure(procedure)
        return self

    def execute(self, procedure, axis=0):
        """Execute a procedure to its end; return acknowledgement and message number."""
        self.start(procedure, axis)
        cycles = 0
        while self.drive(axis).drive_state is DriveState.PROCEDURE:
            self.run(1)
            cycles += 1
            assert cycles < LONGEST
        acknowledged = self.value('acknowledgement', axis), self.value('procedure_error', axis)
        self.run(REST)
        return acknowledged

    def error_rad(self, axis=0):
        """Return the error of the position that a drive reports."""
        return self.robot.answers[0, axis] - self.robot.shafts()[axis][0]

    def commutation_error_rad(self, axis=0):
        """Return the error of the commutation offset; electrical."""
        mounting = self.parameters.mounting
        truth = mounting.rotor_offset_rad[axis] - POLE_PAIRS * mounting.encoder_offset_rad[axis]
        return math.remainder(self.value('commutation_offset', axis) - truth, math.tau)


def site(robot, **mounting):
    return Site(mounted(robot, **mounting))


@pytest.mark.parametrize('axis', [0, 1, 2])
def test_an_axis_with_unknown_offsets_is_aligned_and_homed(axis, robot):
    bench = site(robot)
    assert not bench.value('homed', axis)
    assert not bench.value('commutated', axis)
    assert bench.execute(Procedure.ALIGNMENT, axis) == (DONE, 0)
    assert abs(bench.commutation_error_rad(axis)) < COMMUTATION_RAD
    before = bench.robot.shafts()[axis][0]
    assert bench.execute(Procedure.HOMING, axis) == (DONE, 0)
    assert bench.value('homed', axis)
    assert abs(bench.error_rad(axis)) < SWITCH_RAD
    # it returns, up to the sag under the brake
    assert bench.robot.shafts()[axis][0] == pytest.approx(before, abs=0.05)
    assert bench.drive(axis).fault == DriveFault.NONE


@pytest.mark.parametrize('name', ['built', 'model+built', 'model+sercos2'])
def test_every_controller_and_machine_is_aligned_and_homed_in_the_same_way(name):
    bench = site(parameters.load(name))
    assert bench.execute(Procedure.ALIGNMENT) == (DONE, 0)
    assert abs(bench.commutation_error_rad()) < COMMUTATION_RAD
    assert bench.execute(Procedure.HOMING) == (DONE, 0)
    assert abs(bench.error_rad()) < SWITCH_RAD


def test_the_end_stop_gives_a_reference_within_the_compression_of_its_rubber(robot):
    bench = Site(robot.replace(mounting__encoder='single_turn'))
    assert not bench.value('homed')
    assert bench.execute(Procedure.END_STOP) == (DONE, 0)
    assert abs(bench.error_rad()) < STOP_RAD


def test_the_other_arms_rest_under_their_brakes(robot):
    bench = Site(robot)
    before = [shaft[0] for shaft in bench.robot.shafts()]
    bench.execute(Procedure.HOMING)
    after = [shaft[0] for shaft in bench.robot.shafts()]
    assert after[1:] == before[1:]
    assert not bench.robot.plant.state['brake_released'].any()


def test_homing_of_a_homed_axis_changes_its_position_by_less_than_the_switch_is_accurate(robot):
    bench = Site(robot)
    assert bench.execute(Procedure.HOMING) == (DONE, 0)
    assert abs(bench.error_rad()) < SWITCH_RAD


def test_homing_that_starts_at_an_actuated_switch_leaves_it_first(robot):
    bench = Site(robot.replace(mounting__switch_deg=(20.0, 20.0, 20.0)))
    assert bench.execute(Procedure.HOMING) == (DONE, 0)
    assert abs(bench.error_rad()) < SWITCH_RAD


def test_a_switch_that_is_never_actuated_ends_at_the_end_stop(robot):
    bench = Site(robot.replace(mounting__switch_deg=(-90.0, -90.0, -90.0)))
    assert bench.execute(Procedure.HOMING) == (ERROR, 8924)
    assert bench.drive().fault == DriveFault.NONE


def test_an_arm_in_a_gauge_gets_the_reference_distance(robot):
    bench = site(robot)
    position = bench.robot.shafts()[0][0]
    assert bench.drive().set_data('reference_distance', position - 0.25)
    assert bench.drive().set_data('reference_offset', 0.25)
    bench.start(Procedure.SET_POSITION)
    assert bench.value('acknowledgement') == DONE
    bench.run(1)
    assert abs(bench.error_rad()) <= math.tau / 2**19
    assert bench.drive().fault == DriveFault.NONE


# wiring

WIRING = [
    ({}, (DONE, 0)),
    ({'phases_exchanged': 'axis1'}, (ERROR, 8921)),
    ({'phases_exchanged': 'all'}, (ERROR, 8921)),
    ({'phases_exchanged': 'axis2'}, (DONE, 0)),
    ({'encoder_reversed': 'axis1'}, (ERROR, 8922)),
    ({'encoder_reversed': 'axis1', 'phases_exchanged': 'axis1'}, (ERROR, 8922)),
    ({'encoder_cables_exchanged': 'axis1-axis2'}, (ERROR, 8923)),
    ({'motor_cables_exchanged': 'axis1-axis3'}, (ERROR, 8923)),
]


@pytest.mark.parametrize(('mounting', 'expected'), WIRING, ids=str)
def test_each_wrong_connection_has_its_own_message(mounting, expected, robot):
    assert site(robot, **mounting).execute(Procedure.DIRECTION) == expected


@pytest.mark.parametrize(
    ('mounting', 'data'),
    [
        ({'phases_exchanged': 'axis1'}, {'field_inverted': 1.0}),
        ({'encoder_reversed': 'axis1'}, {'polarity': 4.0}),
        (
            {'phases_exchanged': 'axis1', 'encoder_reversed': 'axis1'},
            {'field_inverted': 1.0, 'polarity': 4.0},
        ),
    ],
    ids=['phases', 'encoder', 'both'],
)
def test_the_drive_compensates_exchanged_phases_and_a_reversed_encoder(mounting, data, robot):
    bench = site(robot, **mounting)
    for name, value in data.items():
        assert bench.drive().set_data(name, value)
    assert bench.execute(Procedure.ALIGNMENT) == (DONE, 0)
    assert bench.execute(Procedure.HOMING) == (DONE, 0)
    assert abs(bench.error_rad()) < SWITCH_RAD


def test_a_direction_check_keeps_the_commutation_offset(robot):
    bench = Site(robot.replace(mounting__rotor_offset_rad=(1.0, 0.0, 0.0)))
    assert bench.execute(Procedure.DIRECTION) == (DONE, 0)
    assert bench.value('commutation_offset') == 1.0


@pytest.mark.parametrize('name', ['polarity', 'field_inverted'])
def test_another_direction_makes_the_commutation_unknown(name, robot):
    bench = Site(robot)
    assert bench.drive().set_data(name, 4.0 if name == 'polarity' else 1.0)
    assert not bench.value('commutated')
    assert bench.value('homed') == (name != 'polarity')
    bench.run(5)
    assert bench.drive().fault == DriveFault.NONE


def test_a_motor_with_exchanged_phases_trips_when_it_is_enabled(robot):
    bench = Site(robot.replace(mounting__phases_exchanged='all'))
    bench.commands = np.array([shaft[0] for shaft in bench.robot.shafts()])
    bench.run(3000, CONTROL_ENABLE)
    tripped = {DriveFault.COMMUTATION, DriveFault.FOLLOWING_ERROR, DriveFault.OVERLOAD, DriveFault.OVERTRAVEL}
    assert {drive.fault for drive in bench.robot.drives} & tripped


def test_a_drive_without_commutation_offset_is_not_enabled(robot):
    bench = site(robot).run(20, CONTROL_ENABLE)
    assert [drive.fault for drive in bench.robot.drives] == [DriveFault.COMMUTATION] * 3
    assert not bench.robot.plant.state['brake_released'].any()


# encoders


@pytest.mark.parametrize(
    ('encoder', 'homed', 'commutated'),
    [('multi_turn', 1, 1), ('single_turn', 0, 1), ('incremental', 0, 0)],
)
def test_an_encoder_knows_after_power_on_what_its_kind_can_know(encoder, homed, commutated, robot):
    offsets = (700.5, -3.0, 0.0)
    bench = Site(mounted(robot, commissioned=True, encoder=encoder, encoder_offset_rad=offsets))
    assert (bench.value('homed'), bench.value('commutated')) == (homed, commutated)
    if homed:
        assert abs(bench.error_rad()) <= math.tau / 2**19
    if commutated:
        assert abs(bench.commutation_error_rad()) < 1e-9


@pytest.mark.parametrize('encoder', ['multi_turn', 'single_turn'])
def test_stored_data_survive_a_restart_as_far_as_the_encoder_permits(encoder, robot):
    given = mounted(robot, encoder=encoder)
    bench = Site(given)
    bench.execute(Procedure.ALIGNMENT)
    bench.execute(Procedure.HOMING)
    stored = bench.drive().stored_data()
    again = Robot(given)
    again.plant.state['theta'] = bench.robot.plant.state['theta']
    again.drives[0].restore_data(stored)
    again.plant.advance(np.zeros((16, 3)), [False] * 3)
    again.cycle(np.zeros(3), CONTROL_ON)
    state = again.drives[0].state[0]
    assert state['commutated']
    assert state['homed'] == (encoder == 'multi_turn')
    if state['homed']:
        assert abs(again.answers[0, 0] - again.shafts()[0][0]) < SWITCH_RAD


# brake and travel


def test_a_brake_holds_the_test_torque(robot):
    bench = Site(robot)
    before = bench.robot.shafts()[0][0]
    assert bench.execute(Procedure.BRAKE_TEST) == (DONE, 0)
    assert bench.value('procedure_result') == pytest.approx(2.4, rel=0.01)
    assert bench.robot.shafts()[0][0] == before


@pytest.mark.parametrize('lost', [0.3, 0.6])
def test_a_worn_brake_slips_at_its_torque(lost, robot):
    bench = Site(robot)
    bench.robot.plant.state['brake_share'][0, 0] = 1.0 - lost
    assert bench.execute(Procedure.BRAKE_TEST) == (ERROR, 8926)
    # weight and friction act, too: 0.22 and 0.1 N m
    assert bench.value('procedure_result') == pytest.approx(3.0 * (1.0 - lost), abs=0.4)


def test_travel_limits_of_a_new_drive_are_its_end_stops(robot):
    bench = Site(robot.replace(dynamics__end_stop_min_deg=-51.0, dynamics__end_stop_max_deg=96.0))
    assert bench.value('travel_min') == pytest.approx(math.radians(-51.0) * GEAR)
    assert bench.value('travel_max') == pytest.approx(math.radians(96.0) * GEAR)


def test_taught_limits_are_those_of_the_overtravel(robot):
    bench = Site(robot)
    position = bench.robot.answers[0, 0]
    bench.start(Procedure.TRAVEL_MAX)
    assert (bench.value('acknowledgement'), bench.value('travel_max')) == (DONE, position)
    bench.start(Procedure.TRAVEL_MIN)
    assert (bench.value('acknowledgement'), bench.value('procedure_error')) == (
        ERROR,
        8931,
    )  # no range is left
    bench.commands = np.array([shaft[0] + 0.02 for shaft in bench.robot.shafts()])
    bench.run(300, CONTROL_ENABLE)
    assert [drive.fault for drive in bench.robot.drives] == [
        DriveFault.OVERTRAVEL,
        DriveFault.NONE,
        DriveFault.NONE,
    ]


def test_an_axis_that_is_not_homed_has_no_limits_to_teach(robot):
    bench = site(robot).start(Procedure.TRAVEL_MIN)
    assert (bench.value('acknowledgement'), bench.value('procedure_error')) == (ERROR, 8929)


# start and end


@pytest.mark.parametrize('procedure', [Procedure.HOMING, Procedure.END_STOP, Procedure.BRAKE_TEST])
def test_procedures_with_torque_need_the_commutation(procedure, robot):
    bench = site(robot).start(procedure)
    assert (bench.value('acknowledgement'), bench.value('procedure_error')) == (ERROR, 8927)
    assert bench.drive().drive_state is DriveState.READY


@pytest.mark.parametrize('control', [CONTROL_OFF, CONTROL_ENABLE])
def test_no_procedure_starts_without_drive_on_or_with_enable(control, robot):
    assert not Site(robot).run(200, control).drive().start_procedure(Procedure.HOMING)


def test_no_procedure_starts_during_another_one(robot):
    bench = Site(robot).start(Procedure.HOMING).run(10)
    assert not bench.drive().start_procedure(Procedure.BRAKE_TEST)
    assert bench.value('procedure') == Procedure.HOMING


def test_generator_and_procedure_exclude_each_other(robot):
    bench = Site(robot).start(Procedure.HOMING).run(700)
    assert not bench.drive().start_excitation(robot)
    bench.drive().cancel_procedure()
    bench.commands = np.array([shaft[0] for shaft in bench.robot.shafts()])
    bench.run(REST, CONTROL_ENABLE)
    assert bench.drive().start_excitation(robot)
    assert not bench.drive().start_procedure(Procedure.BRAKE_TEST)


@pytest.mark.parametrize('procedure', [Procedure.HOMING, Procedure.ALIGNMENT, Procedure.BRAKE_TEST])
@pytest.mark.parametrize('cycles', [1, 700, 1500])
def test_a_cancelled_procedure_leaves_the_arm_at_rest_under_its_brake(procedure, cycles, robot):
    bench = Site(robot).start(procedure).run(cycles)
    bench.drive().cancel_procedure()
    assert bench.value('acknowledgement') == INTERRUPTED
    assert not bench.value('brake_release')
    bench.run(REST)
    assert bench.drive().drive_state is DriveState.READY
    assert bench.robot.shafts()[0][1] == 0.0
    bench.drive().cancel_procedure()
    assert bench.value('acknowledgement') == INACTIVE


@pytest.mark.parametrize('control', [CONTROL_OFF, CONTROL_ENABLE])
def test_a_control_word_ends_a_procedure(control, robot):
    bench = Site(robot).start(Procedure.HOMING).run(1000).run(1, control)
    bench.run(REST)
    assert (bench.value('acknowledgement'), bench.value('procedure_error')) == (ERROR, 8930)
    assert bench.robot.shafts()[0][1] == 0.0


def test_a_fault_of_the_drive_ends_a_procedure(robot):
    bench = Site(robot).start(Procedure.HOMING).run(1000)
    bench.drive().state['encoder_broken'] = 1
    bench.run(REST)
    assert bench.drive().fault == DriveFault.ENCODER
    assert (bench.value('acknowledgement'), bench.value('procedure_error')) == (ERROR, 8930)
    assert not bench.value('brake_release')


def test_a_drive_reports_torque_in_a_procedure_only_while_it_has_some(robot):
    bench = Site(robot).start(Procedure.DIRECTION).run(30)
    assert STEP_TEXTS[bench.value('procedure_step')] == 'the arm sinks without torque'
    assert not in_torque(bench.robot.status[0])
    bench.run(1000)
    assert in_torque(bench.robot.status[0])
    assert not bench.robot.status[0] & Status.FOLLOWS_COMMAND


def test_stored_data_are_set_without_torque_only(robot):
    bench = Site(robot).start(Procedure.HOMING).run(100)
    assert not bench.drive().set_data('reference_distance', 0.0)


def test_every_message_of_a_procedure_has_its_own_number():
    assert len(PROCEDURE_MESSAGES) == len(set(PROCEDURE_MESSAGES.values())) == 11
    assert len(STEP_TEXTS) == 20
