"""Tests of plan execution: path and limits during start, hold, resume and override."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.execution import MotionProfile, Timeline
from delta3_pacdrive.planning.paths.move import MoveKind
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.paths.virtual_master import (
    master_at_distances,
    phases_to_rest,
    sample_master,
    slowest,
)
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.resume import resume
from delta3_pacdrive.robot.sercos.bus_time import NEVER
from thoroughness import examples

CYCLE_S = 1e-3
START = (0.0, 0.0, -0.75)
MOVES = [
    {'move_l': {'to_m': [0.2, 0.0, -0.75]}},
    {'dwell': {'time_s': 0.0503}},
    {'move_c': {'via_m': [0.1, 0.12, -0.78], 'to_m': [0.0, 0.0, -0.8]}},
    {'move_l': {'to_m': [0.0, 0.0, -0.75], 'blend_m': 0.02}},
    {'move_l': {'to_m': [-0.2, 0.0, -0.75], 'blend_m': 0.03}},
    {'move_sb': {'through_m': [[-0.2, 0.1, -0.78], [-0.1, 0.2, -0.8], [0.0, 0.1, -0.78]]}},
]
LIMITS = {'speed_m_s': 1.0, 'acceleration_m_s2': 12.0, 'jerk_m_s3': 500.0}
ROUNDING = 1e-9
CONNECTION = 1.0 + 1e-3  # what a way back to the plan may exceed the plan by


def planned(robot, jerk=500.0):
    document = {'moves': MOVES, 'limits': {**LIMITS, 'jerk_m_s3': jerk}}
    return program_planner.plan(programs.parse(document, robot.motion), START, robot).plan


@pytest.fixture(scope='module')
def plan(robot):
    return planned(robot)


def started(plan, cycle=0, override=1.0):
    timeline = Timeline(plan, CYCLE_S)
    timeline.start(cycle, override)
    return timeline


def states(timeline, first, last):
    """Number, distance, speed and acceleration in bus cycles, shape (n, 4)."""
    return np.array(
        [
            (s.number, s.distance_m, s.speed_m_s, s.acceleration_m_s2)
            for s in map(timeline.at, range(first, last))
        ]
    ).reshape(-1, 4)


def place(plan, number, distance):
    return sample_path([distance], plan.move(int(number)).segments)[0, 0]


def assert_continuous(rows, plan, room=1.0):
    """Distance and speed go on from cycle to cycle within the limits of acceleration and jerk."""
    for number in np.unique(rows[:, 0]):
        move = plan.move(int(number))
        if move.kind == MoveKind.DWELL:
            continue
        s, v, a = rows[rows[:, 0] == number][:, 1:].T
        limit, jerk = move.stop_acceleration * room**2 * CONNECTION, move.stop_jerk * room**3 * CONNECTION
        assert (np.diff(s) >= -ROUNDING).all()
        assert s.max() <= move.length_m + ROUNDING
        assert np.abs(a).max() <= limit + ROUNDING
        assert np.abs(np.diff(v)).max() <= limit * CYCLE_S + ROUNDING
        assert np.abs(np.diff(a)).max() <= jerk * CYCLE_S + 1e-6
        # distance is the integral of the speed
        assert np.abs(np.diff(s) - 0.5 * CYCLE_S * (v[1:] + v[:-1])).max() <= jerk * CYCLE_S**3


def test_before_its_start_a_timeline_has_no_motion_profile_and_no_end(plan):
    timeline = Timeline(plan, CYCLE_S)
    assert timeline.end_cycle == NEVER
    with pytest.raises(ProgramError, match='no program runs'):
        timeline.at(0)


@pytest.mark.parametrize('override', [0.01, 0.37, 1.0, 1.5])
def test_duration_of_a_plan_at_a_rate_is_divided_by_the_rate_and_includes_every_move(override, plan):
    timeline = started(plan, 7, override)
    assert timeline.end_cycle == 7 + math.ceil(plan.duration_s / override / CYCLE_S - 1e-9)
    step = max(1, round(1.0 / override))
    rows = states(timeline, 7, timeline.end_cycle + 2)[::step]
    assert rows[0].tolist() == [0.0, 0.0, 0.0, rows[0, 3]]
    assert set(rows[:, 0]) == set(range(len(plan)))
    assert timeline.at(timeline.end_cycle).distance_m == plan.move(len(plan) - 1).length_m
    assert timeline.at(timeline.end_cycle).speed_m_s == 0.0
    if override == 1.0:
        assert_continuous(rows, plan)


cycles = st.floats(0.0, 1.0)  # share of the way


@given(share=cycles)
@settings(max_examples=examples(60))
def test_a_hold_anywhere_stops_on_the_path_within_the_limits_of_the_move(share, plan):
    timeline = started(plan)
    cycle = int(share * timeline.end_cycle)
    before = timeline.at(cycle)
    whole_end = timeline.end_cycle
    timeline.change(timeline.stop(cycle))
    assert timeline.end_cycle <= max(whole_end, cycle)
    rows = states(timeline, cycle, timeline.end_cycle + 3)
    assert (rows[:, 0] == before.number).all()
    assert_continuous(rows, plan)
    assert rows[0, 1] == pytest.approx(before.distance_m, abs=ROUNDING)
    assert rows[-1, 2:].tolist() == [0.0, 0.0]
    # no slower than it must be: braking with the move's limits takes at most v/a + a/j, and a/j more to turn round
    move = plan.move(before.number)
    if move.kind != MoveKind.DWELL:
        ramp = move.stop_acceleration / move.stop_jerk
        quickest = before.speed_m_s / move.stop_acceleration + 2.5 * ramp
        assert (timeline.end_cycle - cycle) * CYCLE_S <= quickest + CYCLE_S


@given(share=cycles, wait=st.integers(0, 500), override=st.sampled_from([0.1, 0.5, 1.0, 1.2]))
@settings(max_examples=examples(60))
def test_held_program_continues_to_the_same_end(share, wait, override, plan):
    timeline = started(plan)
    timeline.change(timeline.stop(int(share * (timeline.end_cycle - 1))))
    standing = timeline.at(timeline.end_cycle)
    cycle = timeline.end_cycle + wait
    profile = resume(timeline, cycle, override)
    timeline.change(profile)
    rows = states(timeline, cycle, timeline.end_cycle + 2)
    # it begins where it stood; who stands closer to the end of a move than 0.1 um is taken to have arrived
    assert np.abs(place(plan, *rows[0, :2]) - place(plan, standing.number, standing.distance_m)).max() < 1e-7
    assert_continuous(rows, plan, max(1.0, override))
    assert rows[-1].tolist() == [len(plan) - 1, plan.move(len(plan) - 1).length_m, 0.0, 0.0]
    assert (np.diff(rows[:, 0]) >= 0).all()


@given(
    share=cycles, changes=st.lists(st.sampled_from([0.05, 0.3, 0.8, 1.0, 1.3, 1.5]), min_size=1, max_size=4)
)
@settings(max_examples=examples(60))
def test_override_during_motion_keeps_path_and_limits(share, changes, plan):
    timeline = started(plan)
    rows = []
    cycle = int(share * (timeline.end_cycle - 1))
    begun = 0
    for override in changes:
        if cycle >= timeline.end_cycle:
            break
        profile = resume(timeline, cycle, override)
        rows.append(states(timeline, begun, cycle))
        timeline.change(profile)
        begun, cycle = cycle, cycle + 180
    rows.append(states(timeline, begun, timeline.end_cycle + 2))
    table = np.concatenate(rows)
    assert_continuous(table, plan, 1.5)
    assert table[-1].tolist() == [len(plan) - 1, plan.move(len(plan) - 1).length_m, 0.0, 0.0]


def test_a_change_of_override_counts_soon_unless_the_move_ends_before(plan):
    """A tenth of a second after the request, or from the next move on."""
    soon, asked = 0, 0
    for cycle in range(5, started(plan).end_cycle - 5, 23):
        for override in (0.5, 1.4):
            timeline = started(plan)
            number = timeline.at(cycle).number
            left = plan.tables.starts[number + 1] - cycle * CYCLE_S
            timeline.change(resume(timeline, cycle, override))
            if plan.move(number).kind == MoveKind.DWELL or left < 0.25:
                continue
            asked += 1
            later = timeline.at(cycle + 220)
            if later.number != number:
                continue
            # at the same place of the plan, the speed is that of the plan times the override
            times = np.linspace(0.0, plan.move(number).duration_s, 20_001)
            s, v, _, _ = sample_master(times, plan.move(number).master).T
            soon += later.speed_m_s == pytest.approx(override * np.interp(later.distance_m, s, v), rel=1e-2)
    print(f'{soon} of {asked} changes were in force after 0.22 s')
    assert asked > 40
    assert soon >= 0.9 * asked


def test_an_override_is_reached_within_the_time_that_the_limits_need(robot):
    document = {'moves': [{'move_l': {'to_m': [0.4, 0.0, -0.75], 'speed_m_s': 0.4}}]}
    line = program_planner.plan(programs.parse(document, robot.motion), START, robot).plan
    timeline = started(line)
    timeline.change(resume(timeline, 300, 0.5))
    rows = states(timeline, 300, timeline.end_cycle)
    reached = int(np.flatnonzero(np.abs(rows[:, 2] - 0.2) < 1e-9)[0])
    # 0.2 m/s at 15 m/s2 and 600 m/s3: v/a < a/j, so 2 sqrt(v/j); places to join are half a per cent of the way apart
    needed = 2.0 * math.sqrt(0.2 / 600.0)
    assert needed <= reached * CYCLE_S + 1e-9 <= needed + 0.02


@pytest.mark.parametrize('rest', [0.0, 0.3, 0.9])
def test_hold_in_a_dwell_keeps_the_remaining_time(rest, plan):
    dwell = 1
    first = math.ceil(plan.tables.starts[dwell] / CYCLE_S)
    cycle = first + int(rest * 50)
    timeline = started(plan)
    left = plan.tables.starts[dwell + 1] - cycle * CYCLE_S
    timeline.change(timeline.stop(cycle))
    assert timeline.end_cycle == cycle
    timeline.change(resume(timeline, cycle + 1000, 1.0))
    rows = states(timeline, cycle + 1000, cycle + 1100)
    assert int((rows[:, 0] == dwell).sum()) == pytest.approx(left / CYCLE_S, abs=1.0)
    again = timeline.end_cycle - (cycle + 1000)
    assert again == pytest.approx(plan.duration_s / CYCLE_S - cycle, abs=1.0)


def test_duration_of_a_dwell_at_a_rate_is_its_time_divided_by_the_rate(plan):
    timeline = started(plan)
    cycle = math.ceil(plan.tables.starts[1] / CYCLE_S) + 10
    timeline.change(resume(timeline, cycle, 0.5))
    left = 2.0 * (plan.tables.starts[2] - cycle * CYCLE_S)
    rows = states(timeline, cycle, cycle + 200)
    assert int((rows[:, 0] == 1).sum()) == pytest.approx(left / CYCLE_S, abs=1.0)


def test_place_is_on_the_path_for_any_motion_profile(plan):
    timeline = started(plan)
    timeline.change(resume(timeline, 400, 1.4))
    timeline.change(timeline.stop(700))
    timeline.change(resume(timeline, timeline.end_cycle + 5, 0.6))
    table = states(timeline, timeline.start_cycle, timeline.end_cycle)
    for number in np.unique(table[:, 0]).astype(int):
        move = plan.move(number)
        rows = table[table[:, 0] == number]
        places = sample_path(rows[:, 1], move.segments)[:, 0]
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        if move.kind != MoveKind.DWELL:
            assert steps == pytest.approx(np.diff(rows[:, 1]), rel=2e-3, abs=1e-9)


@pytest.mark.parametrize(
    ('speed', 'acceleration', 'jerk'),
    [(1.0, 0.0, 500.0), (1.0, 12.0, 500.0), (0.3, -12.0, 500.0), (0.01, 3.0, 500.0), (1.0, 0.0, math.inf)],
)
def test_a_stop_ends_at_rest_and_never_turns_back(speed, acceleration, jerk):
    table = phases_to_rest(0.5, speed, acceleration, 12.0, jerk)
    assert table[-1, 2:].tolist() == [0.0, 0.0, 0.0]
    assert table[0, :3].tolist() == pytest.approx([0.0, 0.5, speed])
    assert (np.diff(table[:, 1]) >= -ROUNDING).all()
    assert np.abs(table[:, 3]).max() <= 12.0 * CONNECTION
    if math.isfinite(jerk):
        assert np.abs(table[:, 4]).max() <= jerk * CONNECTION


# motion profiles as messages, and what is refused


def test_a_motion_profile_survives_its_message(plan):
    timeline = started(plan)
    for profile in (timeline.stop(300), resume(timeline, 300, 0.7)):
        back = MotionProfile.from_array(profile.to_array().tolist())
        assert (back.cycle, back.number, back.override, back.held) == (
            profile.cycle,
            profile.number,
            profile.override,
            profile.held,
        )
        assert back.table.tobytes() == profile.table.tobytes()


def spoilt(row, index, value):
    row = row.copy()
    row[index] = value
    return row


@pytest.mark.parametrize(
    ('spoil', 'reason'),
    [
        (lambda row: [], 'a row of finite numbers'),
        (lambda row: row[:8], 'a row of finite numbers'),
        (lambda row: spoilt(row, 5, math.nan), 'a row of finite numbers'),
        (lambda row: row[:-1], 'phases of 5 numbers'),
        (lambda row: spoilt(row, 0, 1.5), 'whole numbers'),
        (lambda row: spoilt(row, 1, -1.0), 'whole numbers'),
        (lambda row: spoilt(row, 2, 0.0), 'an override of 0'),
        (lambda row: spoilt(row, 2, 3.0), 'an override of 3'),
        (lambda row: spoilt(row, 3, 2.0), 'must be between'),
        (lambda row: spoilt(row, 4, 0.1), 'begin at time 0'),
        (lambda row: spoilt(row, -3, 0.5), 'end at rest'),
        (lambda row: spoilt(row, 6, 9.0), 'its master jumps'),
    ],
)
def test_a_malformed_motion_profile_is_rejected(spoil, reason, plan):
    row = started(plan).stop(300).to_array()
    with pytest.raises(ProgramError, match=reason):
        MotionProfile.from_array(spoil(row))


def shifted(profile, column, by):
    table = profile.table.copy()
    table[:, column] += by
    return MotionProfile(profile.cycle, profile.number, table, profile.override, profile.held)


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        (lambda c: replace(c, cycle=c.cycle + 20), 'does not continue the motion'),
        (lambda c: shifted(c, 1, 1e-3), 'does not continue the motion'),
        (lambda c: shifted(c, 2, 1e-3), 'does not continue the motion'),
        (lambda c: MotionProfile(c.cycle, c.number + 1, c.table, 1.0, True), 'does not continue the motion'),
        (lambda c: MotionProfile(c.cycle, 99, c.table, 1.0, True), 'is too late'),
        (
            lambda c: MotionProfile(c.cycle, c.number, c.table, 1.0, False),
            'does not reach the end of its move',
        ),
        (lambda c: replace(c, cycle=-5), 'is too late'),
    ],
)
def test_a_motion_profile_that_does_not_continue_the_motion_is_rejected(change, reason, plan):
    timeline = started(plan)
    profile = timeline.stop(150)
    with pytest.raises(ProgramError, match=reason):
        timeline.change(change(profile))
    timeline.change(profile)
    assert timeline.profile is profile


def test_a_motion_profile_that_leaves_its_move_is_rejected(plan):
    timeline = started(plan)
    now = timeline.at(150)
    table = np.array(
        [[0.0, now.distance_m, now.speed_m_s, now.acceleration_m_s2, 0.0], [1.0, 5.0, 0.0, 0.0, 0.0]]
    )
    with pytest.raises(ProgramError, match='leaves its move'):
        timeline.change(MotionProfile(150, now.number, table, 1.0, True))


@given(share=cycles)
@settings(max_examples=examples(25))
def test_a_plan_of_infinite_jerk_can_be_held_and_resumed(share, robot):
    timeline = started(planned(robot, math.inf))
    timeline.change(timeline.stop(int(share * (timeline.end_cycle - 1))))
    cycle = timeline.end_cycle + 10
    timeline.change(resume(timeline, cycle, 1.0))
    rows = states(timeline, cycle, timeline.end_cycle + 2)
    assert rows[-1, 0] == len(timeline.plan) - 1
    assert rows[-1, 2] == 0.0
    assert np.abs(rows[:, 3]).max() <= 12.0 * CONNECTION


# programs that are hard to hold: cubics, which run to their end at full override, and legs with limits of their own

HARD = {
    'cubics': [
        {'cubic': {'to_m': [0.1, 0.0, -0.8], 'duration_s': 0.4, 'end_velocity_m_s': [0.3, 0.2, 0.0]}},
        {'cubic': {'to_m': [0.2, 0.1, -0.8], 'duration_s': 0.5}},
        {'move_l': {'to_m': [0.0, 0.0, -0.75]}},
    ],
    'a cubic that a motor slows down': [
        {'cubic': {'to_m': [0.3, 0.0, -0.75], 'duration_s': 0.06}},
        {'dwell': {'time_s': 10.0}},
    ],
    'a quick leg and a slow one': [
        {'move_l': {'to_m': [0.2, 0.0, -0.75], 'blend_m': 0.02, 'speed_m_s': 1.5, 'acceleration_m_s2': 15.0}},
        {'move_l': {'to_m': [0.2, 0.06, -0.75], 'speed_m_s': 0.1, 'acceleration_m_s2': 1.0}},
        {'dwell': {'time_s': 0.1}},
    ],
    'bends that ask for slowness': [
        {
            'move_sb': {
                'through_m': [[0.1, 0.1, -0.8], [0.2, 0.0, -0.85], [0.1, -0.1, -0.8], [0.0, 0.0, -0.75]]
            }
        },
        {'move_c': {'via_m': [0.03, 0.03, -0.76], 'to_m': [0.06, 0.0, -0.76]}},
    ],
    'small jerk': [
        {'move_l': {'to_m': [0.15, 0.0, -0.8], 'jerk_m_s3': 20.0}},
        {'move_l': {'to_m': [0.0, 0.0, -0.75]}},
    ],
}


@pytest.fixture(scope='module')
def hard(robot):
    """Plans of the programs that are hard to hold."""
    return {
        name: program_planner.plan(programs.parse({'moves': moves}, robot.motion), START, robot).plan
        for name, moves in HARD.items()
    }


def require_on_its_way(rows, plan):
    """The master never turns back, never leaves its move, and has no jump in distance and speed."""
    for number in np.unique(rows[:, 0]):
        s, v, a = rows[rows[:, 0] == number][:, 1:].T
        assert (np.diff(s) >= -ROUNDING).all()
        assert s.max() <= plan.move(int(number)).length_m + ROUNDING
        assert s.min() >= -ROUNDING
        assert (v >= -ROUNDING).all()
        # distance is the integral of the speed, but where the acceleration turns within the cycle
        turn = np.abs(np.diff(a)) * CYCLE_S**2
        assert (np.abs(np.diff(s) - 0.5 * CYCLE_S * (v[1:] + v[:-1])) <= turn + 1e-7).all()
    assert (np.diff(rows[:, 0]) >= 0.0).all()


@pytest.mark.parametrize('name', HARD)
def test_a_hold_in_any_cycle_stops_before_the_move_ends_and_nowhere_faster_than_the_plan(name, hard):
    plan = hard[name]
    whole = started(plan).end_cycle
    moving = plan.duration_s if plan.move(1).kind != MoveKind.DWELL else plan.tables.starts[1]
    for cycle in range(0, int(moving / CYCLE_S), max(1, int(moving / CYCLE_S / 40))):
        timeline = started(plan)
        before = timeline.at(cycle)
        move = plan.move(before.number)
        timeline.change(timeline.stop(cycle))
        assert timeline.end_cycle <= whole
        rows = states(timeline, cycle, timeline.end_cycle + 3)
        require_on_its_way(rows, plan)
        assert rows[-1, 2:].tolist() == [0.0, 0.0]
        allowed = master_at_distances(np.minimum(rows[:, 1], move.length_m), move.master)[:, 2]
        assert (rows[:, 2] <= allowed * CONNECTION + 2e-3 * allowed.max()).all()
        timeline.change(resume(timeline, timeline.end_cycle + 4, 1.0))
        rows = states(timeline, timeline.start_cycle, timeline.start_cycle + 1500)
        require_on_its_way(rows, plan)


@given(data=st.data())
@settings(max_examples=examples(40))
def test_plan_with_any_holds_resumes_and_overrides_is_driven_to_its_end(data, hard, plan):
    one = data.draw(
        st.sampled_from([plan, *[hard[name] for name in HARD if name != 'a cubic that a motor slows down']])
    )
    overrides = st.sampled_from([0.3, 0.5, 1.0, 1.2, 1.5])
    timeline = started(one, 0, data.draw(overrides))
    cycle = 0
    for _ in range(data.draw(st.integers(1, 6))):
        held = timeline.profile.held
        end = timeline.end_cycle
        cycle = end + data.draw(st.integers(0, 5)) if held else cycle + data.draw(st.integers(1, 300))
        if not held and cycle >= end:
            break
        rows = states(timeline, timeline.start_cycle, cycle + 1)
        require_on_its_way(rows, one)
        before = timeline.at(cycle)
        goes_on = held or data.draw(st.booleans())
        profile = resume(timeline, cycle, data.draw(overrides)) if goes_on else timeline.stop(cycle)
        assert MotionProfile.from_array(profile.to_array()).override == profile.override
        timeline.change(profile)
        after = timeline.at(cycle)
        places = [sample_path([x.distance_m], one.move(x.number).segments)[0, 0] for x in (before, after)]
        assert np.abs(places[0] - places[1]).max() < 1e-6
        assert after.speed_m_s == pytest.approx(before.speed_m_s, abs=1e-6)
    if timeline.profile.held:
        timeline.change(resume(timeline, timeline.end_cycle, 1.0))
    rows = states(timeline, timeline.start_cycle, timeline.end_cycle + 2)
    require_on_its_way(rows, one)
    assert rows[-1, :2].tolist() == [len(one) - 1, pytest.approx(one.move(len(one) - 1).length_m, abs=1e-12)]
    assert abs(rows[-1, 2]) < ROUNDING


def test_phases_know_their_slowest_speed_also_within_a_phase():
    phases = np.array([[0.0, 0.0, 0.1, -2.0, 30.0], [0.2, 0.0, 0.3, 4.0, 0.0], [0.3, 0.0, 0.7, 0.0, 0.0]])
    times = np.linspace(0.0, 0.3, 30_001)
    assert slowest(phases) == pytest.approx(sample_master(times, phases)[:-1, 1].min(), abs=1e-6)
    assert slowest(phases) == pytest.approx(0.1 - 2.0**2 / (2.0 * 30.0))
    assert slowest(np.array([[0.0, 0.1, 0.0, 0.0, 0.0]])) == 0.0
