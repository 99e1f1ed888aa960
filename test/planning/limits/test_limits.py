"""Tests of active limits: the planner reaches the allowed values and does not exceed them.

Nothing here takes the planner's own word: speed, acceleration and jerk of the TCP are differences of its sampled
positions, the motors are differences of inverse kinematics, (4.26), friction and the winding's equation.
"""

import math

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.limits.limits import check_speed, phase_voltage_max
from delta3_pacdrive.planning.plan import Plan, sample_plan
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.resume import resume

STEP_S = 0.25e-3
CYCLE_S = 1e-3
HOME = (0.0, 0.0, -0.8)
# a move is checked at places 2.5 mm apart, and may take a thousandth less time than it needs
TCP = (1.001, 1.003, 1.005)
USED = 0.98  # of a limit that binds
MOTOR = 1.02  # over a motor's limit, between the places that are checked
MOTOR_USED = (
    0.85  # below it a motor would be wasted; the planner's caps take friction and resistance at their largest
)
REST = {'dwell': {'time_s': 300.0}}  # so long that the rms current does not matter


def to(x, y, z, **options):
    return {'move_l': {'to_m': [x, y, z], **options}}


def circle(radius, **options):
    return {'move_c': {'via_m': [radius, radius, -0.8], 'to_m': [2.0 * radius, 0.0, -0.8], **options}}


def limits(speed, acceleration, jerk):
    return {'speed_m_s': speed, 'acceleration_m_s2': acceleration, 'jerk_m_s3': jerk}


def plan(robot, moves, **fields):
    return program_planner.plan(programs.parse({'moves': moves, **fields}, robot.motion), HOME, robot)


def first(planned):
    """Return the plan of the first move alone."""
    return Plan.of([planned.plan.move(0)])


def path(one, rate=1.0):
    times = np.arange(0.0, one.duration_s + STEP_S * rate, STEP_S * rate)
    return sample_plan(one, times)[0]


def tcp(p):
    """Largest speed, acceleration and jerk of positions."""
    return np.array([np.linalg.norm(np.diff(p, n, axis=0), axis=1).max() / STEP_S**n for n in (1, 2, 3)])


def motors(robot, p):
    """Return speeds [rad/s], currents [A] and phase voltages [V rms] of the motors on positions, (n, 3) each."""
    theta = kinematics.inverse(p, robot.kinematics)
    rate = (theta[2:] - theta[:-2]) / (2.0 * STEP_S)
    bend = (theta[2:] + theta[:-2] - 2.0 * theta[1:-1]) / STEP_S**2
    gear, m = robot.dynamics.gear_ratio, robot.motor
    speed = gear * rate
    torque = dynamics.inverse(theta[1:-1], rate, bend, robot) / gear
    torque += m.static_friction_n_m * np.tanh(speed / m.friction_smoothing_rad_s)
    torque += m.viscous_friction_n_m_s_rad * speed
    current = torque / m.torque_constant_n_m_a
    voltage = m.winding_resistance_ohm / 2.0 * current + m.torque_constant_n_m_a / 3.0 * speed
    return speed, current, voltage


def shares(robot, p):
    """Largest speed, current, voltage over their limits."""
    speed, current, voltage = (np.abs(values).max() for values in motors(robot, p))
    highest = robot.drive.dc_link_voltage_v / math.sqrt(6.0)
    return {
        'speed': speed / (robot.motor.max_speed_rpm * math.tau / 60.0),
        'current': current / robot.motor.peak_current_a,
        'voltage': voltage / highest,
    }


# the TCP


ASKED_OF_BENDS = [
    (0.5, 20.0, 100.0),
    (1.0, 40.0, 300.0),
    (2.0, 100.0, 600.0),
    (1.0, 200.0, 3000.0),
    (3.0, 15.0, 600.0),
    (0.6, 5.0, 1e5),
]


@pytest.mark.parametrize('radius', [0.03, 0.05, 0.1, 0.15])
@pytest.mark.parametrize('asked', ASKED_OF_BENDS)
def test_on_a_circle_one_limit_of_the_tcp_is_reached_and_none_exceeded(radius, asked, robot):
    used = tcp(path(first(plan(robot, [circle(radius, **limits(*asked)), REST])))) / asked
    assert (used <= TCP).all()
    assert used.max() > USED


THROUGH = [[0.05, 0.05, -0.8], [0.1, 0.02, -0.82], [0.2, 0.1, -0.8], [0.15, 0.15, -0.78]]
BENDS = {
    'spline': lambda asked: [{'move_sb': {'through_m': THROUGH, **asked}}],
    'corner': lambda asked: [to(0.15, 0.0, -0.8, blend_m=0.04, **asked), to(0.15, 0.15, -0.8, **asked)],
    'sharp corner': lambda asked: [to(0.15, 0.0, -0.8, blend_m=0.02, **asked), to(0.05, 0.1, -0.8, **asked)],
}


@pytest.mark.parametrize('kind', BENDS)
@pytest.mark.parametrize('asked', ASKED_OF_BENDS)
def test_where_curvature_changes_one_limit_of_the_tcp_is_reached_and_none_exceeded(kind, asked, robot):
    used = tcp(path(first(plan(robot, [*BENDS[kind](limits(*asked)), REST])))) / asked
    assert (used <= TCP).all()
    assert used.max() > 0.9  # bends of all sizes in one move: its jerk is one number for all of them


def corner(slow, fast, slow_first):
    """Plan a right angle of a slow and a fast leg; return the positions within its rounded corner."""
    legs = (slow, fast) if slow_first else (fast, slow)
    return [
        to(0.15, 0.0, -0.8, blend_m=0.05, **limits(*legs[0])),
        to(0.15, 0.15, -0.8, **limits(*legs[1])),
    ]


@pytest.mark.parametrize('slow_first', [True, False])
@pytest.mark.parametrize(
    ('slow', 'fast', 'n'), [((0.2, 20.0, 2e3), (0.5, 20.0, 2e3), 0), ((1.0, 2.0, 1e3), (1.0, 30.0, 1e3), 1)]
)
def test_a_corner_keeps_the_lower_limits_of_its_two_legs(slow, fast, n, slow_first, robot):
    p = path(first(plan(robot, [*corner(slow, fast, slow_first), REST])))
    inside = (p[:, 0] > 0.1001) & (p[:, 1] < 0.0499)
    assert inside.sum() > 100
    used = tcp(p[inside])[n] / slow[n]
    assert used <= TCP[n]
    assert used > 0.9
    assert tcp(p)[n] / fast[n] > 0.9


@pytest.mark.parametrize(
    ('fast', 'slow', 'blend_m'),
    [
        ((2.5, 66.0, 4e4), (0.28, 66.0, 4e4), 0.03),
        ((1.5, 290.0, 3e4), (0.15, 290.0, 3e4), 0.03),
        ((2.8, 120.0, 1e4), (0.166, 120.0, 1e4), 0.02),
    ],
)
def test_a_slow_leg_between_fast_ones_keeps_its_speed_where_motors_slow_the_move_down(
    fast, slow, blend_m, robot
):
    weak = robot.replace(motor__peak_current_a=3.0, motor__nominal_current_a=2.9)
    legs = [
        to(0.15, 0.0, -0.8, blend_m=blend_m, **limits(*fast)),
        to(0.15, 0.2, -0.8, blend_m=blend_m, **limits(*slow)),
        to(-0.05, 0.2, -0.8, **limits(*fast)),
    ]
    planned = plan(weak, [*legs, REST])
    assert 'current of motor' in planned.notices[0]
    p = path(first(planned))
    speed = np.linalg.norm(np.diff(p, axis=0), axis=1) / STEP_S
    between = p[:-1, 0] > 0.15 - blend_m + 1e-4  # the slow leg with both of its corners
    assert 0.98 < speed[between].max() / slow[0] <= TCP[0]
    assert 0.98 < speed.max() / fast[0] <= TCP[0]


# motors


def press(speed=8.0, acceleration=60.0, jerk=2e4):
    return [to(0.0, 0.4, -0.85, **limits(speed, acceleration, jerk)), REST]


HEAVY = {'dynamics__payload_mass_kg': 5.0}
WEAK = {'motor__peak_current_a': 6.0, 'motor__nominal_current_a': 5.0}
STICKY = {'motor__static_friction_n_m': 1.5, 'rich__break_away_torque_n_m': 2.0}
RESISTANT = {'drive__dc_link_voltage_v': 300.0, 'motor__winding_resistance_ohm': 30.0}
BINDING = {
    'speed': ('speed', {'motor__max_speed_rpm': 1500.0}, (8.0, 60.0, 2e4)),
    'current': ('current', WEAK, (8.0, 200.0, 2e4)),
    'heavy payload': ('current', WEAK | HEAVY, (8.0, 80.0, 2e4)),
    'static friction': ('current', WEAK | STICKY, (8.0, 200.0, 2e4)),
    'viscous friction': ('current', WEAK | {'motor__viscous_friction_n_m_s_rad': 8e-3}, (2.0, 200.0, 2e4)),
    'voltage': ('voltage', {'drive__dc_link_voltage_v': 150.0}, (8.0, 60.0, 2e4)),
    'resistance': ('voltage', RESISTANT, (8.0, 200.0, 2e4)),
}


@pytest.mark.parametrize('what', BINDING)
def test_one_motor_limit_is_reached_and_none_exceeded(what, robot):
    quantity, changes, asked = BINDING[what]
    built = robot.replace(**changes)
    planned = plan(built, press(*asked))
    used = shares(built, path(first(planned)))
    assert max(used.values()) <= MOTOR, used
    assert used[quantity] > MOTOR_USED, used
    (notice,) = planned.notices
    assert f'{quantity} of motor ' in notice
    # the times of the notice: what was taken, and what the wish would have taken
    taken, wished = (float(notice.split(word)[1].split(' s')[0]) for word in ('slowed down, ', 'instead of '))
    assert taken == pytest.approx(planned.plan.move(0).duration_s, rel=1e-3)  # four digits
    assert wished < taken


def test_a_payload_that_is_gripped_in_the_program_binds_as_one_of_the_robot(robot):
    weak = robot.replace(**WEAK)
    planned = plan(weak, press(8.0, 80.0, 2e4), payload_kg=5.0)
    used = shares(weak.replace(**HEAVY), path(first(planned)))
    assert MOTOR_USED < used['current'] <= MOTOR


def test_a_cubic_that_is_too_quick_ends_within_the_limits_of_the_motors(robot):
    for name in ('speed', 'current', 'voltage'):
        built = robot.replace(**BINDING[name][1])
        planned = plan(built, [{'cubic': {'to_m': [0.0, 0.4, -0.85], 'duration_s': 0.12}}, REST])
        assert planned.notices
        used = shares(built, path(first(planned)))
        # slowed down as a whole by the worst place, where weight and friction count as if they grew as well
        assert 0.6 < used[name] <= MOTOR, name


@pytest.mark.parametrize('viscous', [3e-4, 5e-3])
@pytest.mark.parametrize('dwell_s', [0.2, 1.0])
def test_the_rms_current_of_a_program_is_that_of_its_currents(dwell_s, viscous, robot):
    loaded = robot.replace(dynamics__payload_mass_kg=3.0, motor__viscous_friction_n_m_s_rad=viscous)
    moves = [to(0.3, 0.0, -0.85, **limits(4.0, 40.0, 4e3)), to(*HOME, **limits(4.0, 40.0, 4e3))]
    planned = plan(loaded, [*moves, {'dwell': {'time_s': dwell_s}}])
    assert not planned.notices
    own = np.sqrt((motors(loaded, path(planned.plan))[1] ** 2).mean(axis=0))
    assert planned.rms_current_a == pytest.approx(own.tolist(), rel=5e-3)  # a grid of places, not of times


def test_the_rms_current_of_a_program_is_kept_where_weight_works_against_the_motion(robot):
    loaded = robot.replace(dynamics__payload_mass_kg=5.0, motor__nominal_current_a=2.0)
    moves = [to(0.0, 0.0, -0.9, **limits(4.0, 80.0, 2e4)), to(*HOME, **limits(4.0, 80.0, 2e4))]
    planned = plan(loaded, moves)
    assert 'rms current' in planned.notices[-1]
    own = np.sqrt((motors(loaded, path(planned.plan))[1] ** 2).mean(axis=0))
    assert own.max() == pytest.approx(2.0, rel=5e-3)


# overrides


def used_by(robot, planned, rate):
    p = path(planned.plan, rate)
    used = shares(robot, p)
    rms = np.sqrt((motors(robot, p)[1] ** 2).mean(axis=0)).max()
    return used | {'rms': rms / robot.motor.nominal_current_a}


@pytest.mark.parametrize('what', ['speed', 'current', 'voltage', 'rms'])
def test_largest_override_reaches_one_limit_and_exceeds_none(what, robot):
    asked = [to(0.0, 0.4, -0.85, **limits(3.0, 60.0, 6e3)), to(*HOME, **limits(3.0, 60.0, 6e3))]
    moves = asked if what == 'rms' else [*asked, {'dwell': {'time_s': 20.0}}]
    free = used_by(robot, plan(robot, moves), 1.0)
    # of a robot that has a fifth (of the square: two fifths) more than the program takes
    motor = robot.motor
    changes = {
        'speed': {'motor__max_speed_rpm': motor.max_speed_rpm * 1.2 * free['speed']},
        'current': {'motor__peak_current_a': motor.peak_current_a * 1.44 * free['current']},
        'voltage': {'drive__dc_link_voltage_v': robot.drive.dc_link_voltage_v * 1.44 * free['voltage']},
        'rms': {'motor__nominal_current_a': motor.nominal_current_a * 1.44 * free['rms']},
    }[what]
    built = robot.replace(**changes)
    planned = plan(built, moves)
    assert not planned.notices
    assert 1.1 < planned.override_max < 1.4
    used = used_by(built, planned, planned.override_max)
    assert max(used.values()) <= MOTOR
    # the voltage counts as if all of it grew with the square: resistance and back-EMF are not told apart
    assert used[what] > (0.8 if what == 'voltage' else MOTOR_USED)


def test_a_program_that_was_slowed_down_for_its_rms_current_bears_no_override(robot):
    cold = robot.replace(motor__nominal_current_a=0.45)
    moves = [to(0.3, 0.0, -0.85, **limits(4.0, 60.0, 2e4)), to(*HOME, **limits(4.0, 60.0, 2e4))]
    planned = plan(cold, moves)
    assert 'rms current' in planned.notices[-1]
    assert planned.plan.duration_s > 1.5 * plan(robot, moves).plan.duration_s  # the largest override there is
    assert planned.override_max == 1.0


# arms


@pytest.mark.parametrize(
    ('name', 'sentence'),
    [
        ('forearm_swing_max_deg', 'the forearm swing of arm'),
        ('serial_singularity_min', 'the distance from the serial singularity of arm'),
        ('parallel_singularity_min', 'the distance from the parallel singularity'),
    ],
)
def test_path_may_approach_a_limit_of_the_arms_up_to_its_margin(name, sentence, robot):
    end = (0.3, 0.3, -0.9)
    line = np.linspace(HOME, end, 2001)
    serial, parallel = kinematics.singularity(
        kinematics.inverse(line, robot.kinematics), line, robot.kinematics
    )
    swing = np.degrees(kinematics.forearm_swing(line, robot.kinematics)).max()
    own = {'forearm_swing_max_deg': swing, 'serial_singularity_min': serial.min()}.get(name, parallel.min())
    outwards = 1.0 if name.endswith('max_deg') else -1.0
    moves = [to(*end)]
    plan(robot.replace(**{f'kinematics__{name}': float(own) * (1.0 + outwards * 1e-3)}), moves)
    with pytest.raises(ProgramError, match=sentence):
        plan(robot.replace(**{f'kinematics__{name}': float(own) * (1.0 - outwards * 1e-3)}), moves)


def test_external_move_is_checked_at_its_executed_rate(robot):
    move = plan(robot, [to(0.0, 0.4, -0.85, **limits(3.0, 60.0, 6e3)), REST]).plan.move(0)
    share = shares(robot, path(Plan.of([move])))['speed']
    slow = robot.replace(motor__max_speed_rpm=robot.motor.max_speed_rpm * 1.25 * share)
    check_speed(move, 1.0, slow)
    check_speed(move, 1.2, slow)
    with pytest.raises(ProgramError, match='the speed of motor'):
        check_speed(move, 1.3, slow)


# stops and other overrides on the way

ASKED = limits(1.0, 4.0, 500.0)


def running(robot, rate):
    planned = plan(robot, [to(0.5, 0.0, -0.8, **ASKED)])
    timeline = Timeline(planned.plan, CYCLE_S)
    timeline.start(0, rate)
    return timeline, round(0.5 * planned.plan.duration_s / rate / CYCLE_S)  # in the middle of the cruise


@pytest.mark.parametrize('rate', [0.3, 1.0, 1.2, 1.5])
def test_stop_uses_at_most_the_acceleration_and_jerk_of_its_override(rate, robot):
    timeline, cycle = running(robot, rate)
    table = timeline.stop(cycle).table
    room = max(1.0, rate)
    assert table[0, 2] == pytest.approx(rate, rel=1e-9)
    assert np.abs(table[:, 4]).max() == pytest.approx(500.0 * room**3, rel=1e-9)
    # at 30 % the stop is over before it brakes as hard as it may
    highest = min(4.0 * room**2, math.sqrt(rate * 500.0 * room**3))
    assert np.abs(table[:, 3]).max() == pytest.approx(highest, rel=1e-6)


def test_the_stop_for_a_lost_axis_brakes_as_hard_as_the_robot_can(robot):
    timeline, cycle = running(robot, 1.0)
    hard = robot.motion.fault_stop_acceleration_m_s2
    table = timeline.stop(cycle, hard).table
    assert np.abs(table[:, 3]).max() == pytest.approx(hard, rel=1e-6)
    # 1 m/s at 100 m/s2, the deceleration rising and falling in 2 ms each
    assert table[-1, 0] == pytest.approx(1.0 / hard + 2e-3, rel=1e-6)


@pytest.mark.parametrize(('before', 'after'), [(1.0, 1.5), (1.5, 1.0), (1.5, 0.5), (0.5, 1.0)])
def test_transition_to_another_override_uses_the_limits_of_the_larger_one(before, after, robot):
    timeline, cycle = running(robot, before)
    table = resume(timeline, cycle - round(0.1 / CYCLE_S), after).table
    room = max(1.0, before, after)
    a, j = np.abs(table[:, 3]).max(), np.abs(table[:-1, 4]).max()
    assert a <= 4.0 * room**2 * 1.001  # what a way back to the plan may exceed it by
    assert j <= 500.0 * room**3 * 1.001
    assert j > 500.0 * room**3 * 0.999


def test_the_voltage_of_weak_mains_limits_moves(robot):
    nominal_v = robot.drive.dc_link_voltage_v
    assert phase_voltage_max(robot) == pytest.approx(nominal_v / math.sqrt(6.0))
    strong, weak = (
        robot.replace(supply__enabled=True, supply__mains_voltage_v=volts) for volts in (400.0, 340.0)
    )
    assert phase_voltage_max(strong) == phase_voltage_max(robot)  # the mains reach 566 V
    assert phase_voltage_max(weak) == pytest.approx(340.0 / math.sqrt(3.0))
    # both limits are equal where the mains reach exactly the nominal voltage
    equal = strong.replace(supply__mains_voltage_v=nominal_v / math.sqrt(2.0))
    assert phase_voltage_max(equal) == pytest.approx(phase_voltage_max(robot), rel=1e-15)
