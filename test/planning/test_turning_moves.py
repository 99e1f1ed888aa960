"""Tests of moves with tool rotation: the turn over the path, and the limits of the rotary axis."""

import math
from itertools import pairwise

import numpy as np
import pytest

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.adapted_program import rest_of
from delta3_pacdrive.planning.paths.move import VERSION, Move, MoveKind
from delta3_pacdrive.planning.paths.rotations import sample_turn, turn_at
from delta3_pacdrive.planning.paths.virtual_master import sample_master
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.rotating_move import TurnLimits, check_turn, turn_motion

START = [0.15, 0.0, -0.80]
THERE, ABOVE = [-0.15, 0.0, -0.80], [0.0, 0.1, -0.75]
JUMP = 1e-6  # relative to the largest value


@pytest.fixture(scope='module')
def machine(robot):
    return robot.replace(rotary__present=True)


def plan(moves, machine, **head):
    program = programs.parse({'start_m': START, **head, 'moves': moves}, machine.motion)
    return program_planner.plan(program, START, machine)


def turned_deg(planned):
    """Where the tool is at the begin and at the end of each move that is driven."""
    moves = [planned.plan.move(n) for n in range(len(planned.plan))]
    ends = [(move.start_turns_rad[0], move.end_turns_rad[0]) for move in moves]
    return [tuple(round(math.degrees(angle), 6) + 0.0 for angle in pair) for pair in ends]


def over_time(move, count=2001):
    """Master, and angle, speed, acceleration and jerk of the tool."""
    return turn_motion(np.linspace(0.0, move.duration_s * (1.0 - 1e-9), count), move.master, move.turns[0])


def refusal(moves, machine, **head):
    with pytest.raises(ProgramError) as refused:
        plan(moves, machine, **head)
    return str(refused.value)


# the turn over the path


@pytest.mark.parametrize(
    'move',
    [
        {'move_l': {'to_m': THERE}},
        {'move_c': {'via_m': [0.0, 0.1, -0.8], 'to_m': THERE}},
        {'move_sb': {'through_m': [ABOVE, THERE]}},
        {'arch': {'to_m': THERE, 'up_m': 0.01, 'down_m': 0.01}},
        {'move_l': {'to_m': THERE, 'time_optimal': True}},
    ],
)
def test_the_tool_turns_with_every_move_along_a_path_from_its_begin_to_its_end(move, machine):
    ((kind, keys),) = move.items()
    planned = plan([{kind: keys | {'turn_deg': 90}}], machine)
    assert turned_deg(planned) == [(0.0, 90.0)]
    (one,) = planned.plan.moves
    master, turn = over_time(one)
    assert turn[:, 0] == pytest.approx(math.radians(90) * master[:, 0] / one.length_m, abs=1e-9)
    assert (turn[0, 1], turn[-1, 1]) == pytest.approx((0.0, 0.0), abs=1e-3)


def test_turn_within_the_limits_of_its_axis_does_not_lengthen_the_move(machine):
    asked = {'move_l': {'to_m': THERE}}
    alone = plan([asked], machine)
    turning = plan([{'move_l': {'to_m': THERE, 'turn_deg': 90}}], machine)
    assert np.array_equal(turning.plan.moves[0].master, alone.plan.moves[0].master)
    assert turning.notices == ()
    assert alone.plan.turns == ()


def test_angles_are_absolute_or_steps_in_degrees_or_radians(machine):
    moves = [
        {'move_l': {'to_m': THERE, 'turn_deg': 90}},
        {'move_l': {'to_m': START, 'turn_rad': math.radians(45)}},
        {'move_l': {'to_m': THERE, 'turn_deg': {'by_deg': 15}}},
        {'dwell': {'time_s': 0.1}},
        {'move_l': {'to_m': START}},
        {'turn': {'to_rad': 0}},
        {'turn': {'to_deg': {'by_deg': -30}}},
    ]
    angles = [
        (-10.0, 90.0),
        (90.0, 45.0),
        (45.0, 60.0),
        (60.0, 60.0),
        (60.0, 60.0),
        (60.0, 0.0),
        (0.0, -30.0),
    ]
    assert turned_deg(plan(moves, machine, start_turn_deg=-10)) == angles


FRAMES = {
    'box': {'origin_m': [0.0, 0.0, -0.8], 'yaw_deg': 30},
    'ramp': {'origin_m': [0.0, 0.0, -0.8], 'pitch_deg': 10},
}


def test_an_angle_counts_from_the_x_axis_of_its_frame(machine):
    moves = [
        {'move_l': {'frame': 'box', 'to_m': [-0.1, 0.0, 0.0], 'turn_deg': 10}},
        {'move_l': {'frame': 'box', 'to_m': [0.1, 0.0, 0.0], 'turn_deg': {'by_deg': 5}}},
        {'turn': {'frame': 'box', 'to_deg': -30}},
        {'turn': {'to_deg': 20}},
    ]
    planned = plan(moves, machine, frames=FRAMES)
    assert [end for _, end in turned_deg(planned)] == [40.0, 45.0, 0.0, 20.0]


def test_an_angle_in_a_tilted_frame_is_rejected(machine):
    moves = [{'turn': {'frame': 'ramp', 'to_deg': 10}}]
    sentence = refusal(moves, machine, frames=FRAMES)
    assert 'an angle of the tool needs a frame whose z axis is upright, not one tilted by 10 deg' in sentence


def test_tool_off_the_axis_is_not_rotated(machine):
    tools = {'cup': {'offset_m': [0.02, 0.0, -0.06]}}
    sentence = refusal([{'move_l': {'to_m': THERE, 'turn_deg': 10}}], machine, tools=tools)
    assert "tool 'cup' works 20 mm off the axis that would turn it" in sentence
    below = {'cup': {'offset_m': [0.0, 0.0, -0.06]}}
    assert turned_deg(plan([{'turn': {'to_deg': 10}}], machine, tools=below)) == [(0.0, 10.0)]


def test_steps_add_up_over_rounds(machine):
    moves = [{'move_l': {'to_m': THERE, 'turn_deg': {'by_deg': 20}}}, {'move_l': {'to_m': START}}]
    planned = plan(moves, machine, repeat=3)
    assert [end for _, end in turned_deg(planned)] == [20.0, 20.0, 40.0, 40.0, 60.0, 60.0]


def test_rounds_that_turn_to_and_fro_share_their_moves(machine):
    moves = [{'move_l': {'to_m': THERE, 'turn_deg': 90}}, {'move_l': {'to_m': START, 'turn_deg': 0}}]
    planned = plan(moves, machine, repeat=10)
    assert (len(planned.plan.moves), len(planned.plan)) == (2, 20)


def corner(machine, **more):
    up = {'to_m': [0.15, 0.0, -0.75], 'blend_m': 0.02}
    over = {'to_m': [-0.15, 0.0, -0.75], 'blend_m': 0.02, 'turn_deg': 180}
    return plan([{'move_l': up | more}, {'move_l': over | more}, {'move_l': {'to_m': THERE} | more}], machine)


def test_speed_and_acceleration_of_a_turn_are_continuous_through_blends(machine):
    (move,) = corner(machine).plan.moves
    (rows,) = move.turns
    assert len(rows) == 5  # before, a blend, along, a blend, behind
    edges = rows[1:, 0]
    before, after = sample_turn(edges - 1e-12, rows), sample_turn(edges, rows)
    largest = np.abs(sample_turn(np.linspace(0.0, move.length_m, 2001), rows)).max(axis=0)
    assert (np.abs(before - after)[:, :3] <= JUMP * largest[:3] + 1e-6).all()
    _, turn = over_time(move)
    assert turn[0, 0] == 0.0
    assert turn[-1, 0] == pytest.approx(math.pi)
    assert (turn[:, 1] >= -1e-9).all()  # it never turns back


def test_between_blends_the_tool_is_where_it_is_without_them(machine):
    (move,) = corner(machine).plan.moves
    sharp = plan([{'move_l': {'to_m': [-0.15, 0.0, -0.8], 'turn_deg': 180}}], machine).plan.moves[0]
    middle = sample_turn([0.5 * move.length_m], move.turns[0])[0]
    assert middle[:2] == pytest.approx(sample_turn([0.15], sharp.turns[0])[0, :2])


def test_the_compiled_code_reads_the_turn_as_the_planner_does(machine):
    planned = corner(machine).plan
    (move,) = planned.moves
    places = np.linspace(0.0, move.length_m, 50)
    read = np.array([turn_at(s, 0, planned.turns[0]) for s in places.tolist()])
    assert read == pytest.approx(sample_turn(places, move.turns[0])[:, :3], rel=1e-12, abs=1e-12)


# a turn at a standing point


def test_tool_turns_at_a_fixed_point_as_fast_as_its_axis_permits(machine):
    planned = plan([{'turn': {'to_deg': 180}}], machine)
    (move,) = planned.plan.moves
    assert move.kind == MoveKind.TURN
    _, turn = over_time(move)
    limits = TurnLimits.of(machine, machine.dynamics.payload_mass_kg)[0]
    speed, acceleration, jerk = np.abs(turn[:, 1:]).max(axis=0)
    assert acceleration == pytest.approx(limits.acceleration_rad_s2, rel=1e-3)
    assert jerk == pytest.approx(limits.jerk_rad_s3, rel=1e-6)
    assert speed <= limits.speed_rad_s * (1.0 + 1e-9)
    assert move.sample([0.0, move.length_m])[:, 0].tolist() == [START, START]
    assert move.length_m == pytest.approx(math.pi)  # its master goes by the angle


# limits


FAST = {'to_m': THERE, 'speed_m_s': 4.0, 'acceleration_m_s2': 60.0, 'jerk_m_s3': 4000.0}


@pytest.mark.parametrize(
    ('limits', 'told'),
    [
        ({'speed_max_deg_s': 400.0}, 'the speed of the tool would be'),
        ({'acceleration_max_deg_s2': 9000.0}, 'the acceleration of the tool would be'),
        ({'jerk_max_deg_s3': 2e5}, 'the jerk of the tool would be'),
        (
            {'peak_current_a': 1.0, 'nominal_current_a': 1.0},
            'the current of the motor of the rotary axis would be',
        ),
    ],
)
def test_a_limit_of_the_rotary_axis_slows_the_move_down_with_a_notice_and_is_kept(limits, told, machine):
    weak = machine.replace(**{f'rotary__{name}': value for name, value in limits.items()})
    free = plan([{'move_l': FAST}], weak)
    slow = plan([{'move_l': FAST | {'turn_deg': 180}}], weak)
    (notice,) = slow.notices
    assert 'moves[0].move_l is slowed down' in notice
    assert told in notice
    assert slow.plan.duration_s > free.plan.duration_s
    kept = TurnLimits.of(weak, weak.dynamics.payload_mass_kg)[0]
    _, turn = over_time(slow.plan.moves[0])
    speed, acceleration, jerk = np.abs(turn[:, 1:]).max(axis=0)
    used = speed / kept.speed_rad_s, acceleration / kept.acceleration_rad_s2, jerk / kept.jerk_rad_s3
    assert max(used) == pytest.approx(1.0, abs=4e-3)  # one of them is used up, and all are kept


@pytest.mark.parametrize(
    'limits',
    [
        {'speed_max_deg_s': 700.0},
        {'acceleration_max_deg_s2': 9000.0},
        {'jerk_max_deg_s3': 8e5},
    ],
)
def test_blended_moves_keep_the_limits_of_the_axis_also_in_their_corners(limits, machine):
    weak = machine.replace(**{f'rotary__{name}': value for name, value in limits.items()})
    planned = corner(weak, speed_m_s=3.0, acceleration_m_s2=40.0, jerk_m_s3=3000.0)
    assert any('is slowed down' in notice for notice in planned.notices)
    (move,) = planned.plan.moves
    times = np.linspace(0.0, move.duration_s, 20001)
    angle = sample_turn(sample_master(times, move.master)[:, 0], move.turns[0])[:, 0]
    speed, acceleration = np.gradient(angle, times), np.gradient(np.gradient(angle, times), times)
    kept = TurnLimits.of(weak, weak.dynamics.payload_mass_kg)[0]
    # between two samples of the planner
    assert np.abs(speed).max() <= kept.speed_rad_s * 1.01
    assert np.abs(acceleration[2:-2]).max() <= kept.acceleration_rad_s2 * 1.02
    jerk = turn_motion(times[:-1], move.master, move.turns[0])[1][:, 3]
    assert np.abs(jerk).max() <= kept.jerk_rad_s3 * 1.05


def test_a_turn_that_begins_in_motion_keeps_its_acceleration(machine):
    weak = machine.replace(rotary__acceleration_max_deg_s2=20000.0)
    asked = {'speed_m_s': 1.0, 'acceleration_m_s2': 20.0, 'jerk_m_s3': 2000.0}
    moves = [
        {'move_l': {'to_m': [0.05, 0.0, -0.8], 'blend_m': 0.02, **asked}},
        {'move_l': {'to_m': THERE, 'turn_deg': 180, **asked}},  # straight on
    ]
    planned = plan(moves, weak)
    (notice,) = planned.notices
    assert 'the acceleration of the tool would be' in notice
    (move,) = planned.plan.moves
    times = np.linspace(0.0, move.duration_s, 20001)
    angle = sample_turn(sample_master(times, move.master)[:, 0], move.turns[0])[:, 0]
    acceleration = np.degrees(np.gradient(np.gradient(angle, times), times))[2:-2]
    assert 15000.0 < np.abs(acceleration).max() <= 20000.0 * 1.02


def test_a_heavier_part_makes_a_turn_slower_where_the_current_is_the_limit(machine):
    weak = machine.replace(rotary__peak_current_a=1.2, rotary__nominal_current_a=1.0)
    times = [
        plan([{'move_l': FAST | {'turn_deg': 180}}], weak, payload_kg=payload).plan.duration_s
        for payload in (0.5, 5.0)
    ]
    assert times[1] > 1.2 * times[0]


def test_a_program_that_would_heat_the_motor_of_the_axis_too_much_is_slower_as_a_whole(machine):
    weak = machine.replace(rotary__nominal_current_a=0.5)
    moves = [
        {'turn': {'to_deg': 180}},
        {'move_l': {'to_m': THERE, 'turn_deg': 0}},
        {'move_l': {'to_m': START}},
    ]
    slow, free = plan(moves, weak, repeat=5), plan(moves, machine, repeat=5)
    (notice,) = slow.notices
    assert 'the rms current of the motor of the rotary axis over the program would be' in notice
    assert slow.rate < 1.0
    assert slow.plan.duration_s == pytest.approx(free.plan.duration_s / slow.rate)
    square = heat = 0.0
    for move in slow.plan.moves:
        _, turn = over_time(move)
        rotary = weak.rotary
        torque = rotary.shaft_inertia_kg_m2(0.5) * rotary.gear_ratio * turn[:, 2]
        speed = rotary.gear_ratio * turn[:, 1]
        torque += rotary.static_friction_n_m * np.sign(speed) + rotary.viscous_friction_n_m_s_rad * speed
        square = float(((torque / rotary.torque_constant_n_m_a) ** 2).mean())
        heat += square * move.duration_s
    rms = math.sqrt(heat / (slow.plan.duration_s / 5))
    assert rms == pytest.approx(0.5, rel=0.01)
    sentence = refusal([{'move_l': {'to_m': ABOVE, 'strict': True}}, *moves], weak)
    assert 'the rms current of the motor of the rotary axis would be' in sentence


def test_a_strict_move_is_rejected_instead_of_slowed_down(machine):
    weak = machine.replace(rotary__speed_max_deg_s=400.0)
    sentence = refusal([{'move_l': FAST | {'turn_deg': 180, 'strict': True}}], weak)
    assert 'the speed of the tool would be' in sentence
    assert '(strict)' in sentence


def test_a_faster_override_than_the_axis_bears_is_not_offered(machine):
    free = plan([{'move_l': {'to_m': THERE}}], machine)
    weak = machine.replace(rotary__speed_max_deg_s=950.0)
    turning = plan([{'move_l': {'to_m': THERE, 'turn_deg': 180}}], weak)
    (move,) = turning.plan.moves
    speed = np.degrees(np.abs(over_time(move)[1][:, 1]).max())
    assert turning.notices == ()
    assert 1.0 < turning.override_max < free.override_max
    assert turning.override_max <= 950.0 / speed * 1.01


def test_the_tool_stays_between_its_limits(machine):
    sentence = refusal([{'move_l': {'to_m': THERE, 'turn_deg': 400}}], machine)
    assert 'the tool would turn to 400 deg, the limits are -360 and 360 deg' in sentence
    sentence = refusal([{'turn': {'to_deg': -361}}], machine)
    assert 'the tool would turn to -361 deg, the limits are -360 and 360 deg' in sentence
    assert 'the tool is already at 0 deg' in refusal([{'turn': {'to_rad': 1e-7}}], machine)
    sentence = refusal([{'turn': {'to_deg': 0}}], machine, start_turn_deg=500)
    assert 'starts with the tool at 500 deg, the limits are -360 and 360 deg' in sentence
    assert 'the tool is already at 0 deg' in refusal([{'turn': {'to_deg': 0}}], machine)


def test_a_robot_without_a_rotary_axis_rejects_to_turn_by_name(robot):
    no_axis = 'the robot has no rotary axis (rotary.present is false)'
    for moves, head in (
        ([{'move_l': {'to_m': THERE, 'turn_deg': 90}}], {}),
        ([{'turn': {'to_deg': 90}}], {}),
        ([{'move_l': {'to_m': THERE}}], {'start_turn_deg': 10}),
    ):
        assert no_axis in refusal(moves, robot, **head)


def test_a_program_that_starts_with_the_tool_elsewhere_is_rejected(machine):
    document = {'start_m': START, 'start_turn_deg': 30, 'moves': [{'turn': {'to_deg': 0}}]}
    program = programs.parse(document, machine.motion)
    with pytest.raises(ProgramError, match='starts with the tool at 30 deg, but its angle is 90 deg'):
        program_planner.plan(program, START, machine, turns_rad=(math.radians(90.0),))


def test_program_that_starts_in_the_middle_starts_with_the_tool_angle_of_that_place(machine):
    moves = [
        {'move_l': {'to_m': THERE, 'turn_deg': 30}},
        {'turn': {'to_deg': {'by_deg': 15}}},
        {'move_l': {'to_m': START, 'turn_deg': {'by_deg': 10}}},
    ]
    program = programs.parse({'start_m': START, 'moves': moves}, machine.motion)
    rest = rest_of(program, 2, machine)
    assert math.degrees(rest.start_turns_rad[0]) == pytest.approx(45.0)
    assert turned_deg(program_planner.plan(rest, THERE, machine)) == [(45.0, 55.0)]
    steps = programs.parse({'start_m': START, 'moves': [moves[0], moves[1]][1:] + moves}, machine.motion)
    assert math.degrees(rest_of(steps, 2, machine).start_turns_rad[0]) == pytest.approx(30.0)
    with pytest.raises(ProgramError, match='give start_turn_deg in the head'):
        rest_of(steps, 1, machine)


# plans


def test_move_with_rotation_has_its_own_row_version_and_is_restored(machine):
    (move,) = corner(machine).plan.moves
    row = move.to_array(0, 1)
    assert (VERSION, row[0]) == (2, 3.0)
    back, _, _ = Move.from_array(row)
    assert np.array_equal(back.turns[0], move.turns[0])
    assert np.array_equal(back.to_array(0, 1), row)
    (plain,) = plan([{'move_l': {'to_m': THERE}}], machine).plan.moves
    assert plain.to_array(0, 1)[0] == VERSION


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        (lambda row: row.__setitem__(10, 0), 'has 0 pieces of a turn'),
        (lambda row: row.__setitem__(10, 4), 'does not fit its header'),
        (lambda row: row.__setitem__(-6, 7.0), 'the tool jumps by'),
        (lambda row: row.__setitem__(-35, 0.01), 'its turn does not start at 0'),
    ],
)
def test_a_spoilt_turn_is_rejected(change, reason, machine):
    row = corner(machine).plan.moves[0].to_array(0, 1)
    change(row)
    with pytest.raises(ProgramError, match=reason):
        Move.from_array(row)


def test_plan_defines_the_tool_angle_for_all_moves_or_not(machine):
    turning = plan([{'move_l': {'to_m': THERE, 'turn_deg': 90}}], machine).plan.moves[0]
    plain = plan([{'move_l': {'to_m': THERE}}], machine).plan.moves[0]
    with pytest.raises(ProgramError, match='move 1 of the plan has 0 angles of the tool'):
        Plan.of([turning, plain])


def test_tool_rests_in_the_half_of_a_longer_plan_that_does_not_define_it(machine):
    turning = plan([{'move_l': {'to_m': THERE, 'turn_deg': 90}}], machine).plan
    plain = program_planner.plan(
        programs.parse({'moves': [{'move_l': {'to_m': START}}]}, machine.motion), THERE, machine
    ).plan
    longer = turning.extended(0, 1, plain)
    assert [round(math.degrees(longer.move(n).end_turns_rad[0])) for n in (0, 1)] == [90, 90]
    first = plan([{'move_l': {'to_m': THERE}}, {'move_l': {'to_m': START}}], machine).plan
    behind = first.extended(0, 2, turning)
    assert [round(math.degrees(behind.move(n).end_turns_rad[0])) for n in (0, 1, 2)] == [0, 0, 90]
    for before, after in pairwise(behind.moves):
        assert before.end_turns_rad == after.start_turns_rad


def test_moves_that_follow_with_the_tool_elsewhere_are_rejected(machine):
    turning = plan([{'move_l': {'to_m': THERE, 'turn_deg': 90}}], machine).plan
    back = {'moves': [{'move_l': {'to_m': START, 'turn_deg': 0}}]}
    other = program_planner.plan(programs.parse(back, machine.motion), THERE, machine, turns_rad=(1.0,)).plan
    with pytest.raises(ProgramError, match=r'start with the tool 32\.7 deg away'):
        turning.extended(0, 1, other)


# several rotary axes


@pytest.fixture(scope='module')
def wrist(machine):
    """A robot with two rotary axes; the second one is slower."""
    return machine.replace(rotary_2__present=True, rotary_2__speed_max_deg_s=400.0)


def angles_deg(planned):
    """Return the end angles of each move on all rotary axes."""
    moves = [planned.plan.move(n) for n in range(len(planned.plan))]
    return [tuple(round(math.degrees(angle), 6) + 0.0 for angle in move.end_turns_rad) for move in moves]


def test_each_axis_turns_to_its_own_angle_and_an_axis_without_one_stays(wrist):
    moves = [
        {'move_l': {'to_m': THERE, 'turn_deg': [90, -10]}},
        {'move_l': {'to_m': START, 'turn_deg': 30}},
        {'turn': {'to_deg': [{'by_deg': 0}, 40]}},
        {'turn': {'frame': 'box', 'to_deg': [0, {'by_deg': 5}]}},
        {'dwell': {'time_s': 0.1}},
    ]
    planned = plan(moves, wrist, start_turn_deg=[0, 20], frames=FRAMES)
    assert planned.plan.start_turns_rad == pytest.approx((0.0, math.radians(20)))
    assert angles_deg(planned) == [(90.0, -10.0), (30.0, -10.0), (30.0, 40.0), (30.0, 45.0), (30.0, 45.0)]
    assert len(planned.plan.turns) == 2


def test_the_slower_axis_sets_the_pace_and_is_named(wrist):
    slow = plan([{'move_l': FAST | {'turn_deg': [90, 90]}}], wrist)
    (notice,) = slow.notices
    assert 'the speed of the tool on axis5 would be' in notice
    (move,) = slow.plan.moves
    fastest = [
        np.abs(turn_motion(np.linspace(0.0, move.duration_s, 2001), move.master, rows)[1][:, 1]).max()
        for rows in move.turns
    ]
    assert np.degrees(fastest) == pytest.approx([400.0, 400.0], rel=4e-3)
    (turn,) = plan([{'turn': {'to_deg': [90, 45]}}], wrist).plan.moves
    _, motion = turn_motion(np.linspace(0.0, turn.duration_s, 2001), turn.master, turn.turns[1])
    assert np.degrees(np.abs(motion[:, 1]).max()) == pytest.approx(400.0, rel=4e-3)
    assert 'axis5 would turn to 400 deg' in refusal([{'turn': {'to_deg': [0, 400]}}], wrist)


def test_thermal_limit_of_the_second_rotary_axis_slows_the_program_down(wrist):
    weak = wrist.replace(rotary_2__nominal_current_a=0.1, rotary_2__static_friction_n_m=0.0)
    moves = [{'turn': {'to_deg': [10, 180]}}, {'turn': {'to_deg': 0}}, {'turn': {'to_deg': [0, 0]}}]
    slow = plan(moves, weak, repeat=3)
    assert any('the rms current of the motor of axis5 over the program' in notice for notice in slow.notices)
    assert not plan([{'turn': {'to_deg': 180}}, {'turn': {'to_deg': 0}}], weak, repeat=3).notices


def test_a_plan_of_several_axes_is_a_row_with_the_sizes_of_all_their_tables(wrist, machine):
    (move,) = plan([{'move_l': {'to_m': THERE, 'turn_deg': [90, -10]}}], wrist).plan.moves
    row = move.to_array(0, 1)
    assert row[0] == VERSION + 2
    back, _, _ = Move.from_array(row)
    assert np.array_equal(back.to_array(0, 1), row)
    assert check_turn(move, 1.0, wrist) > 1.0
    with pytest.raises(ProgramError, match='it turns a second rotary axis'):
        check_turn(move, 1.0, machine)
    (one,) = plan([{'move_l': {'to_m': THERE, 'turn_deg': 90}}], machine).plan.moves
    with pytest.raises(ProgramError, match='it turns 1 of 2 rotary axes'):
        check_turn(one, 1.0, wrist)


def test_more_angles_than_rotary_axes_are_rejected(wrist, machine, robot):
    lacking = 'the robot has one (rotary_2.present is false)'
    assert lacking in refusal([{'turn': {'to_deg': [0, 10]}}], machine)
    assert lacking in refusal([{'turn': {'to_deg': 10}}], machine, start_turn_deg=[0, 10])
    assert 'no rotary axis' in refusal([{'turn': {'to_deg': [0, 10]}}], robot)
    sentence = refusal([{'turn': {'to_deg': 10}}], wrist, start_turn_deg=[0, 500])
    assert 'starts with the tool on axis5 at 500 deg, the limits are -360 and 360 deg' in sentence
    for angles in ([], [0, 1, 2]):
        sentence = refusal([{'turn': {'to_deg': angles}}], wrist)
        assert f'has {len(angles)} angles, but must have 1 to 2: one per rotary axis' in sentence
    limits = '[1] is 1047.2, but must be between -1000 and 1000 (in rad)'
    assert f'moves[0].turn.to_deg{limits}' in refusal([{'turn': {'to_deg': [0, 6e4]}}], wrist)
    assert f'start_turn_deg{limits}' in refusal([{'turn': {'to_deg': 10}}], wrist, start_turn_deg=[0, 6e4])


def test_program_that_starts_in_the_middle_has_defined_angles_of_all_axes(wrist):
    moves = [
        {'move_l': {'to_m': THERE, 'turn_deg': [30, -20]}},
        {'turn': {'to_deg': [{'by_deg': 15}, {'by_deg': 5}]}},
        {'move_l': {'to_m': START}},
    ]
    program = programs.parse({'start_m': START, 'moves': moves}, wrist.motion)
    assert np.degrees(rest_of(program, 2, wrist).start_turns_rad) == pytest.approx([45.0, -15.0])
    unknown = programs.parse({'start_m': START, 'start_turn_deg': 0, 'moves': moves[1:]}, wrist.motion)
    with pytest.raises(ProgramError, match='give start_turn_deg in the head'):
        rest_of(unknown, 1, wrist)
