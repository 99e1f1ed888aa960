"""Tests of the limits, the equivalent torque and the life of the gears."""

import math

import numpy as np
import pytest

from built_plant import with_only
from delta3_pacdrive import dynamics, simulation
from delta3_pacdrive.dynamics import rotor_inertia
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.parameters import Gear, config_directory, load
from delta3_pacdrive.planning.limits.gear_load import LIFE_MAX_H, GearFigures, sampled_gear_load
from delta3_pacdrive.planning.program import file_reader
from delta3_pacdrive.studies.places.planning import evaluation
from delta3_pacdrive.studies.runs.derived_signals import added
from delta3_pacdrive.studies.runs.run_signals import gears_of_round
from planned import dwell, parse, to

GEAR = Gear()
NOMINAL_RAD_S = GEAR.nominal_input_speed_rpm * 2.0 * np.pi / 60.0
KEPT = 1.003  # the planner checks a move every 2.5 mm
LEFT, RIGHT = [-0.2, 0.0, -0.85], [0.2, 0.1, -0.85]


@pytest.fixture(scope='module')
def robot():
    """Return the packaged robot, whose gears limit its moves."""
    return load()


def even(torque, speed, duration_s=2.0):
    """Load of a constant torque and speed on all gears."""
    rows = np.ones((5, 3))
    return sampled_gear_load(np.linspace(0.0, duration_s, 5), speed * rows, torque * rows, GEAR)


@pytest.mark.parametrize(
    ('torque', 'speed', 'life'), [(1.0, 1.0, 1.0), (-0.5, 1.0, 2.0 ** (10.0 / 3.0)), (1.0, -0.25, 4.0)]
)
def test_life_of_a_constant_load(torque, speed, life):
    found = even(torque * GEAR.nominal_torque_n_m, speed * NOMINAL_RAD_S).figures(GEAR)
    assert found.life_h == pytest.approx([life * GEAR.nominal_life_h] * 3)
    assert found.equivalent_torque_n_m == pytest.approx([abs(torque) * GEAR.nominal_torque_n_m] * 3)
    assert found.mean_input_speed_rpm == pytest.approx([abs(speed) * GEAR.nominal_input_speed_rpm] * 3)


def test_two_loads_in_sequence_follow_the_formula_of_catalogues():
    found = (even(120.0, 200.0, 1.0) + even(40.0, 50.0, 3.0)).figures(GEAR)
    p, travel = GEAR.life_exponent, 200.0 * 1.0 + 50.0 * 3.0
    equivalent = ((200.0 * 120.0**p + 150.0 * 40.0**p) / travel) ** (1.0 / p)
    assert found.equivalent_torque_n_m == pytest.approx([equivalent] * 3)
    mean = travel / 4.0
    assert found.mean_input_speed_rpm == pytest.approx([mean * 60.0 / (2.0 * np.pi)] * 3)
    life = GEAR.nominal_life_h * NOMINAL_RAD_S / mean * (GEAR.nominal_torque_n_m / equivalent) ** p
    assert found.life_h == pytest.approx([life] * 3)
    assert found.torque_max_n_m == (120.0, 120.0, 120.0)


def test_a_round_and_its_repetition_have_the_same_figures():
    one = even(80.0, 150.0)
    assert one.times(10.0).figures(GEAR).life_h == pytest.approx(one.figures(GEAR).life_h)


def test_a_gear_at_rest_does_not_wear():
    found = even(150.0, 0.0).figures(GEAR)
    assert found.life_h == (LIFE_MAX_H,) * 3
    assert found.equivalent_torque_n_m == (0.0, 0.0, 0.0)
    assert found.lines(GEAR)[1].endswith('life more than 1,000,000 h')


@pytest.mark.parametrize(
    ('torque', 'expected'),
    [
        (160.0, ''),
        (163.2, ''),
        (163.21, 'gear 2 transmits 163.2 N m, 102 % of its acceleration torque (160 N m)'),
        (255.0, 'gear 2 transmits 255 N m, 159 % of its acceleration torque (160 N m)'),
        (255.1, 'gear 2 transmits 255.1 N m, 102 % of its emergency-stop torque (250 N m)'),
    ],
)
def test_overloads_above_two_per_cent_are_warned_of(torque, expected):
    found = GearFigures((1.0, torque, 1.0), (1.0,) * 3, (1.0,) * 3, (LIFE_MAX_H,) * 3)
    assert found.warnings(GEAR) == ([expected] if expected else [])


def test_a_short_life_is_warned_of():
    found = GearFigures((1.0,) * 3, (1.0,) * 3, (1.0,) * 3, (12_345.0, 20_000.0, 19_999.0))
    assert found.warnings(GEAR) == [
        'gear 1 reaches a life of 12,300 h if this repeats, less than the nominal 20,000 h',
        'gear 3 reaches a life of 20,000 h if this repeats, less than the nominal 20,000 h',
    ]


def test_torque_at_the_gear_is_that_of_the_arm_without_the_rotor(robot):
    """Planned samples against the equation of motion (4.26), with arm accelerations by differences of the angles."""
    program = parse(robot, [to(*RIGHT, speed_m_s=3.0, acceleration_m_s2=40.0)], start_m=LEFT, payload_kg=0.5)
    s = evaluation.of_program(program, robot).samples
    keep = np.diff(s.time_s, prepend=-1.0) > 1e-6
    time, theta = s.time_s[keep], s.arm_angle_rad[keep]
    speed = np.gradient(theta, time, axis=0)
    acceleration = np.gradient(speed, time, axis=0)
    expected = dynamics.inverse(theta, speed, acceleration, robot) - rotor_inertia(robot) * acceleration
    inner = slice(5, -5)
    assert np.abs(s.gear_torque_n_m[keep] - expected)[inner].max() < 0.02 * np.abs(expected).max()


def test_executed_program_loads_the_gears_as_planned():
    robot = load('model')
    program = file_reader.load(config_directory() / 'programs' / 'packaging.yaml', robot.motion)
    planned = evaluation.of_program(program, robot).gears.figures(robot.gear)
    found = gears_of_round(added(simulation.run(program, robot)), robot)
    for name in ('torque_max_n_m', 'equivalent_torque_n_m', 'mean_input_speed_rpm'):
        # the drives smooth the peaks of the jerk-limited motion
        assert getattr(found, name) == pytest.approx(getattr(planned, name), rel=0.15)


def test_executed_program_of_a_robot_with_elastic_gears_loads_them_by_their_twist(robot):
    """The torque from current and speed of the motors against spring and damper of the gears, as means of 5 ms."""
    elastic = with_only(load('model'), 'gear')
    program = file_reader.load(config_directory() / 'programs' / 'packaging.yaml', elastic.motion)
    trace = added(simulation.run(program, elastic))
    rich = elastic.rich
    twist = trace['shaft_position'] / elastic.dynamics.gear_ratio - trace['arm_angle']
    beyond = np.sign(twist) * np.maximum(np.abs(twist) - 0.5 * rich.gear_backlash_rad, 0.0)
    rate = np.gradient(beyond, elastic.bus.cycle_time_s, axis=0)
    expected = rich.gear_stiffness_n_m_rad * beyond + rich.gear_damping_n_m_s_rad * rate

    def smoothed(values):
        return np.stack([np.convolve(column, np.full(5, 0.2), 'valid') for column in values.T], axis=1)

    # before the program the brakes hold the arms, whose torque current and speed do not show
    inner = slice(trace.meta['start_cycle'], trace.meta['end_cycle'])
    off = smoothed(trace['gear_torque'][inner]) - smoothed(expected[inner])
    assert np.sqrt(np.mean(off**2)) < 0.05 * np.abs(expected).max()
    found = gears_of_round(trace, elastic)
    planned = evaluation.of_program(program, elastic).gears.figures(elastic.gear)
    assert found.equivalent_torque_n_m == pytest.approx(planned.equivalent_torque_n_m, rel=0.15)


def fast(robot, **fields):
    limits = {'speed_m_s': 6.0, 'acceleration_m_s2': 200.0, 'jerk_m_s3': 3e4}
    moves = [to(*RIGHT), dwell(0.05), to(*LEFT)]
    return evaluation.of_program(parse(robot, moves, start_m=LEFT, limits=limits, **fields), robot)


@pytest.mark.parametrize('time_optimal', [False, True], ids=['jerk-limited', 'time-optimal'])
def test_moves_respect_the_acceleration_torque(time_optimal, robot):
    small = robot.replace(gear__nominal_torque_n_m=40.0, gear__acceleration_torque_n_m=60.0)
    free = fast(small.replace(gear__limit_moves=False), time_optimal=time_optimal)
    found = fast(small, time_optimal=time_optimal)
    assert np.abs(free.samples.gear_torque_n_m).max() > 90.0
    assert 57.0 < np.abs(found.samples.gear_torque_n_m).max() < 60.0 * KEPT
    assert found.planned.plan.duration_s > free.planned.plan.duration_s
    # slowing down the whole motion would cost more
    slowed = math.sqrt(np.abs(free.samples.gear_torque_n_m).max() / 60.0) * free.planned.plan.duration_s
    assert found.planned.plan.duration_s < 0.85 * slowed
    assert {row.limited_by.quantity.value for row in found.rows if row.kind == 'line'} == {'gear torque'}


@pytest.mark.parametrize('time_optimal', [False, True], ids=['jerk-limited', 'time-optimal'])
def test_a_limit_that_is_not_reached_changes_no_bit(time_optimal, robot):
    strong = robot.replace(gear__acceleration_torque_n_m=1e4, gear__emergency_torque_n_m=1e4)
    free, found = (
        fast(one, time_optimal=time_optimal) for one in (robot.replace(gear__limit_moves=False), strong)
    )
    assert free.samples.position_m.tobytes() == found.samples.position_m.tobytes()
    assert free.planned.override_max == found.planned.override_max


def test_moves_respect_the_input_speed(robot):
    slow = robot.replace(gear__input_speed_max_rpm=1500.0, gear__nominal_input_speed_rpm=1000.0)
    found = np.abs(fast(slow).samples.motor_speed_rad_s).max() * 60.0 / (2.0 * np.pi)
    assert 1450.0 < found < 1500.0 * KEPT


def test_the_override_keeps_the_acceleration_torque(robot):
    """At the largest override, the part of the torque due to the motion uses up what the weight leaves."""
    small = robot.replace(gear__nominal_torque_n_m=40.0, gear__acceleration_torque_n_m=60.0)
    program = parse(small, [to(*RIGHT, speed_m_s=3.0, acceleration_m_s2=60.0)], start_m=LEFT)
    found = evaluation.of_program(program, small)
    largest = np.abs(found.samples.gear_torque_n_m).max()
    assert found.planned.override_max >= 1.0
    assert found.planned.override_max**2 * largest < 60.0 * 1.05 + 10.0


def test_a_file_without_the_group_does_not_limit_moves(tmp_path):
    text = (config_directory() / 'delta3.yaml').read_text(encoding='utf-8')
    start, end = text.index('    gear:'), text.index('    motor:')
    old = tmp_path / 'old.yaml'
    old.write_text(text[:start] + text[end:], encoding='utf-8')
    robot = load(old)
    assert not robot.gear.limit_moves
    assert not robot.joints.limit_moves
    assert robot.gear_torque_max_n_m == np.inf
    assert load().gear.limit_moves


@pytest.mark.parametrize(
    ('name', 'value', 'rule'),
    [
        ('acceleration_torque_n_m', 99.0, 'must not be less than gear.nominal_torque_n_m (100.0)'),
        ('emergency_torque_n_m', 159.0, 'must not be less than gear.acceleration_torque_n_m (160.0)'),
        ('input_speed_max_rpm', 2999.0, 'must not be less than gear.nominal_input_speed_rpm (3000.0)'),
    ],
)
def test_contradictory_data_are_rejected(name, value, rule, robot):
    with pytest.raises(ParameterError, match=f'gear.{name}') as caught:
        robot.replace(**{f'gear__{name}': value})
    assert rule in str(caught.value)
