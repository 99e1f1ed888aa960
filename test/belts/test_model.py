"""Tests of the belt model: motion, encoder, light barrier and positions of parts."""

import math

import numpy as np
import pytest

from delta3_pacdrive.belts.model import Belt, BeltMotion, BeltState, Jitter, LightBarrier, SpeedChange, Stream
from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.cell.world import World
from delta3_pacdrive.errors import CellError

CYCLE_S = 1e-3
PER_M = 2.0**14 / 0.2
SPEED = (SpeedChange(0.1, 0.5, 2.0), SpeedChange(0.6, 0.0, 4.0), SpeedChange(0.65, 0.3, 1.0))


def belt(**more):
    """Return a belt along x that begins at 0.3 m before the origin."""
    facts = {'speed': SPEED, 'stream': Stream('bar', 3, 0.1), 'barrier': LightBarrier(0.05, 0.0025)} | more
    return Belt('line', (-0.3, 0.1, -0.87), 0.0, 0.4, PER_M, **facts)


def ran(of, cycles, seed=1, start=0):
    """Return the state of a belt after so many bus cycles."""
    state = BeltState(of, CYCLE_S, start, np.random.default_rng(seed))
    for cycle in range(cycles):
        state.step(cycle)
    return state


def test_belt_follows_its_speed_steps_with_its_accelerations_even_if_they_overlap():
    motion = BeltMotion(belt())
    times = np.arange(0.0, 1.2, 1e-5)
    ways = np.array([motion.shaft_m(time) for time in times])
    speeds = np.gradient(ways, times)
    at = lambda time: speeds[round(time / 1e-5)]  # noqa: E731
    assert at(0.05) == 0.0
    assert at(0.2) == pytest.approx(0.2, abs=1e-4)
    assert at(0.5) == pytest.approx(0.5, abs=1e-4)
    # 0.05 s of braking at 4 m/s2, then over to 0.3 m/s, which is where it is
    assert at(0.64) == pytest.approx(0.34, abs=1e-4)
    assert at(1.1) == pytest.approx(0.3, abs=1e-4)
    assert np.abs(np.diff(speeds)).max() < 1e-4
    assert motion.shaft_m(0.35) == pytest.approx(0.5 * 2.0 * 0.25**2)
    turned = BeltMotion(belt(speed=(SpeedChange(0.1, 0.5, 2.0), SpeedChange(0.2, 0.1, 2.0))))
    # up to 0.2 m/s in 0.1 s, down to 0.1 m/s in 0.05 s, and on
    assert turned.shaft_m(0.3) == pytest.approx(0.01 + 0.0075 + 0.005)


def test_the_speed_swings_about_its_profile():
    motion = BeltMotion(belt(speed=(SpeedChange(0.0, 0.5, 100.0),), jitter=Jitter(0.02, 5.0)))
    times = np.arange(0.2, 0.6, 1e-4)
    speeds = np.gradient([motion.shaft_m(time) for time in times], times)
    assert (speeds.min(), speeds.max()) == pytest.approx((0.48, 0.52), abs=1e-4)


def test_the_encoder_counts_whole_increments_of_the_shaft_and_the_surface_slips_on_it():
    motion = BeltMotion(belt(slip=0.01))
    way = motion.shaft_m(0.5)
    assert motion.count(0.5) == math.floor(way * PER_M)
    assert motion.surface_m(0.5) == pytest.approx(0.99 * way)
    backwards = BeltMotion(belt(speed=(SpeedChange(0.0, -0.5, 10.0),)))
    assert backwards.count(0.5) == math.floor(backwards.shaft_m(0.5) * PER_M) < 0


def test_parts_enter_at_the_begin_follow_the_surface_and_leave_at_the_end():
    state = ran(belt(), 601)
    way = state.way_m
    assert [part.number for part in state.parts] == [0, 1]
    assert [state.along_m(part) for part in state.parts] == pytest.approx([way, way - 0.1])
    assert state.place_m(state.parts[0]) == pytest.approx((-0.3 + way, 0.1, -0.87))
    gone = []
    for cycle in range(601, 1900):
        state.step(cycle)
        gone += state.leave()
    assert [part.number for part in gone] == [0, 1]
    assert all(state.along_m(part) > 0.4 for part in gone)


def test_a_belt_runs_in_its_direction_with_across_to_the_left():
    turned = Belt('line', (1.0, 2.0, 3.0), math.pi / 2, 1.0, PER_M)
    assert turned.place_m(0.5, 0.1) == pytest.approx((0.9, 2.5, 3.0))


def test_positions_of_parts_depend_on_the_seed_within_the_spread():
    spread = belt(stream=Stream('bar', 50, 0.1, (0.02, 0.03), 0.4))
    one, same, other = (ran(spread, 1, seed) for seed in (1, 1, 2))
    for state in (one, same, other):
        for cycle in range(1, 30000):
            state.step(cycle)
    lie = [
        [(part.along_m, part.across_m, part.angle_rad) for part in state.parts]
        for state in (one, same, other)
    ]
    assert lie[0] == lie[1] != lie[2]
    along, across, angle = np.array(lie[0]).T
    assert np.abs(along + 0.1 * np.array([part.number for part in one.parts])).max() <= 0.02
    assert 0.02 < np.abs(across).max() <= 0.03
    assert 0.2 < np.abs(angle).max() <= 0.4


def test_the_light_barrier_latches_the_encoder_its_delay_after_the_middle_of_a_part_has_passed():
    state, latches = ran(belt(), 0), []
    for cycle in range(601):
        state.step(cycle)
        latches += state.latches
    motion = BeltMotion(belt())
    first, second = latches
    assert (first.part, second.part) == (0, 1)
    # 0.05 m at 2 m/s2 from 0.1 s on
    passed = 0.1 + math.sqrt(2.0 * 0.05 / 2.0)
    assert first.count == motion.count(passed + 0.0025)
    assert first.cycle == math.ceil((passed + 0.0025) / CYCLE_S)


def test_taken_part_is_removed_from_the_belt():
    state = ran(belt(), 601)
    state.take(0)
    assert [part.number for part in state.parts] == [1]


def test_times_of_a_belt_count_from_the_start_of_the_program():
    assert ran(belt(), 701, start=100).way_m == pytest.approx(ran(belt(), 601).way_m, abs=1e-12)


CELL = {
    'parts': {'bar': {'mass_kg': 0.2, 'size_mm': [60, 40, 20], 'friction': 0.5}},
    'belts': {
        'line': {
            'origin_mm': [-300, 100, -870], 'direction_deg': 90, 'length_mm': 400,
            'encoder': {'bits': 14, 'circumference_mm': 200},
            'speed': [{'after_s': 0.1, 'speed_m_s': 0.5}],
            'jitter': {'speed_m_s': 0.01, 'frequency_hz': 8}, 'slip': 0.002,
            'stream': {'part': 'bar', 'count': 2, 'spacing_mm': 150, 'spread_mm': [1, 2], 'spread_deg': 30},
            'barrier': {'at_mm': 50, 'delay_s': 0.001},
        }
    },
}  # fmt: skip


def test_a_belt_of_a_cell_file_is_there_in_si_units():
    line = cell_file.parse(CELL).belts['line']
    assert line.increments_per_m == pytest.approx(PER_M)
    assert (line.origin_m, line.length_m) == ((-0.3, 0.1, -0.87), 0.4)
    assert line.direction_rad == pytest.approx(math.pi / 2)
    assert line.speed == (SpeedChange(0.1, 0.5, 2.0),)
    assert (line.jitter, line.slip) == (Jitter(0.01, 8.0), 0.002)
    assert line.stream == Stream('bar', 2, 0.15, (0.001, 0.002), pytest.approx(math.pi / 6))
    assert line.barrier == LightBarrier(0.05, 0.001)


@pytest.mark.parametrize(
    ('key', 'value', 'expected'),
    [
        (
            'speed',
            [{'after_s': 1, 'speed_m_s': 0.5}, {'after_s': 1, 'speed_m_s': 0}],
            'the change before it is at 1',
        ),
        ('speed', [{'after_s': 1, 'speed_m_s': 50}], 'speed_m_s is 50, but must be between -10 and 10'),
        (
            'encoder',
            {'bits': 30, 'circumference_mm': 200},
            'bits is 30, but must be a whole number between 4 and 24',
        ),
        (
            'barrier',
            {'at_mm': 500},
            'barrier.at_m is 0.5, but must be between 0 and 0.4, the length of the belt',
        ),
        ('stream', {'part': 'box', 'count': 1, 'spacing_mm': 9}, "part is 'box', but must be one of bar"),
    ],
)
def test_impossible_belt_is_rejected(key, value, expected):
    with pytest.raises(CellError) as refused:
        cell_file.parse(CELL | {'belts': {'line': CELL['belts']['line'] | {key: value}}})
    assert expected in str(refused.value)


def test_a_cell_has_at_most_as_many_belts_as_a_trace_has_columns():
    with pytest.raises(CellError, match='belts holds 5 entries, but must hold at most 4'):
        cell_file.parse(CELL | {'belts': {str(n): CELL['belts']['line'] for n in range(5)}})


def test_the_parts_of_a_belt_are_in_the_log_of_the_cell_until_they_have_passed():
    world = World(cell_file.parse(CELL), CYCLE_S)
    for cycle in range(1500):
        world.step(cycle, (0.0, 0.0, -0.8), 0)
    report = world.report()
    assert report['belts'] == ['line']
    assert [part['outcome'] for part in report['parts']] == ['passed', 'passed']
    assert world.signals()['cell_belts'] == [world.belts['line'].way_m, 0.0, 0.0, 0.0]


def test_an_encoder_that_jumps_counts_too_much_while_its_fault_lasts():
    jump = {'fault': 'encoder_jump', 'belt': 'line', 'jump_mm': 30, 'after_s': 0.5, 'for_s': 0.2}
    true, false = (World(cell_file.parse(CELL | more), CYCLE_S) for more in ({}, {'faults': [jump]}))
    apart = []
    for cycle in range(900):
        for world in (true, false):
            world.step(cycle, (0.0, 0.0, -0.8), 0)
        apart.append(false.belts['line'].count - true.belts['line'].count)
    assert apart == [round(0.03 * PER_M - 0.5) if 500 <= cycle < 700 else 0 for cycle in range(900)]
