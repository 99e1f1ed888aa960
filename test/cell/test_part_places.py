"""Tests of the history of part positions: consecutive stays without gaps."""

import math

import pytest

from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.cell.part_places import place_m
from delta3_pacdrive.cell.parts import STAYS_MAX, How, Outcome
from delta3_pacdrive.cell.world import World

CYCLE_S, ON, OFF = 1e-3, 1, 0
UP = (0.0, 0.0, -0.8)
DOCUMENT = {
    'cup': {'output': 'gripper', 'diameter_mm': 40, 'vacuum_pa': 60000},
    'parts': {'bar': {'mass_kg': 0.5, 'size_mm': [60, 40, 20], 'friction': 0.5}},
    'supplies': {'infeed': {'part': 'bar', 'at_mm': [-100, 0, -870], 'angle_rad': 0.3, 'count': 1}},
    'boxes': {'tray': {'at_mm': [100, 0, -870], 'clears_s': 0.05}},
}  # fmt: skip
BELT = {
    'origin_m': [-0.4, 0.1, -0.87], 'direction_rad': 0.4, 'length_m': 0.8,
    'encoder': {'bits': 16, 'circumference_m': 0.3},
    'speed': [{'after_s': 0, 'speed_m_s': 0.7, 'acceleration_m_s2': 100}],
}  # fmt: skip
STREAM = {'part': 'bar', 'count': 1, 'spacing_m': 0.2, 'spread_m': [0.02, 0.01], 'spread_rad': 0.5}


def world_of(**sections):
    return World(cell_file.parse(DOCUMENT | sections), CYCLE_S)


def carried(world, ways):
    """Carry the TCP along lines of some cycles, at rest in between, each with an output; return its places."""
    places = []
    for begin, end, output, cycles in ways:
        for n in range(cycles):
            share = (n + 1) / cycles
            share -= math.sin(math.tau * share) / math.tau
            places.append(tuple(a + share * (b - a) for a, b in zip(begin, end, strict=True)))
            world.step(len(places) - 1, places[-1], output)
    return places


def over(x, z=-0.85, y=0.0):
    return (x, y, z)


def test_part_follows_the_tcp_and_stays_at_its_release_until_removal():
    world = world_of()
    there, beside = over(-0.1), over(0.103)
    ways = [(there, there, ON, 60), (there, over(0.103, -0.849, 0.002), ON, 900)]
    ways += [(over(0.103, -0.849, 0.002), beside, OFF, 60), (beside, beside, OFF, 60)]
    tcp = carried(world, ways)
    (part,) = world.records
    lying, hand, placed, gone = part.stays
    assert [stay.how for stay in part.stays] == [How.LYING, How.IN_HAND, How.LYING, How.GONE]
    assert (lying.cycle, hand.cycle, placed.cycle) == (0, part.picked_cycle, part.released_cycle)
    assert gone.cycle == placed.cycle + 50
    assert lying.at_m == (-0.1, 0.0, -0.87)
    assert {stay.angle_rad for stay in part.stays} == {0.3}
    assert place_m(hand, tcp[hand.cycle]) == pytest.approx(lying.at_m, abs=1e-7)
    x, y, _ = place_m(hand, tcp[placed.cycle])
    assert placed.at_m == pytest.approx((x, y, -0.87), abs=1e-7)
    assert place_m(placed, UP) == placed.at_m
    assert place_m(gone, UP) is None
    assert part.size_m == (0.06, 0.04, 0.02)


def test_removal_of_a_part_is_reported_when_it_happens():
    world = world_of(boxes={'tray': {'at_mm': [-100, 0, -870], 'clears_s': 0.05}})
    told = []
    for cycle in range(200):
        world.step(cycle, over(-0.1), ON if cycle < 60 else OFF)
        told += [(cycle, part.stays[-1].how) for part in world.changed]
    (part,) = world.records
    assert told[-1] == (part.released_cycle + 50, How.GONE)
    assert part.outcome is Outcome.PLACED  # it was well


@pytest.mark.parametrize('slip', [0.0, 0.1])
def test_a_part_rides_with_the_surface_of_its_belt_until_that_ends(slip):
    world = world_of(belts={'line': BELT | {'stream': STREAM, 'slip': slip}})
    line, far = world.belts['line'], []
    begin, way, count = 0, 0.0, 0
    for cycle in range(1500):
        world.step(cycle, UP, OFF)
        for on_belt in line.parts:
            (part,) = (one for one in world.records if one.source == 'line')
            (stay,) = part.stays
            if not far:
                begin, way, count = cycle, line.way_m, line.count
            found = place_m(stay, UP, line.way_m - way, line.belt.direction_rad)
            far.append(math.dist(found, line.place_m(on_belt)))
            assert stay.angle_rad == pytest.approx(0.4 + on_belt.angle_rad, abs=1e-7)
    assert len(far) == pytest.approx(0.8 / (0.7 * (1.0 - slip)) / CYCLE_S, abs=20)
    assert max(far) < 1e-6
    riding, gone = part.stays
    assert (riding.how, riding.belt, riding.cycle, riding.count) == (How.RIDING, 'line', begin, count)
    assert (gone.how, gone.cycle, part.outcome) == (How.GONE, begin + len(far), Outcome.PASSED)


def test_a_part_that_is_put_on_a_belt_rides_on_it():
    world = world_of(belts={'line': BELT | {'origin_m': [0.0, 0.0, -0.87]}})
    there, on_belt = over(-0.1), over(0.2, y=0.1)
    carried(world, [(there, there, ON, 60), (there, on_belt, ON, 900), (on_belt, on_belt, OFF, 100)])
    line = world.belts['line']
    (part,) = world.records
    stay = part.stays[-1]
    assert (stay.how, stay.belt, stay.cycle) == (How.RIDING, 'line', part.released_cycle)
    (lies,) = line.parts
    since_m = (line.count - stay.count) / line.belt.increments_per_m
    assert place_m(stay, UP, since_m, 0.4) == pytest.approx(line.place_m(lies), abs=5e-6)


@pytest.mark.parametrize('how', ['lost', 'above nothing', 'too fast'])
def test_fallen_part_is_removed(how):
    world = world_of()
    there, nothing = over(-0.1), over(-0.1, y=0.3)
    ways = [(there, there, ON, 60), (there, nothing, ON, 5 if how == 'too fast' else 900)]
    carried(world, ways)
    last = sum(cycles for *_, cycles in ways)
    if how == 'lost':
        world.drop_part(last)
    for cycle in range(last, last + 60):
        world.step(cycle, nothing, OFF)
    (part,) = world.records
    assert part.outcome is (Outcome.DROPPED if how == 'above nothing' else Outcome.LOST)
    assert (part.stays[-1].how, part.stays[-1].cycle) == (How.GONE, part.released_cycle)


def test_of_a_part_that_is_carried_to_and_fro_the_newest_stays_are_kept():
    world = world_of(boxes={'tray': {'at_mm': [-100, 0, -870]}})
    for cycle in range(300 * 40):
        world.step(cycle, over(-0.1), ON if cycle % 40 < 20 else OFF)
    (part,) = world.records
    assert len(part.stays) == STAYS_MAX
    cycles = [stay.cycle for stay in part.stays]
    assert cycles == sorted(set(cycles))
    assert cycles[-1] == part.released_cycle
