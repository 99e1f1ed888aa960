"""Tests of a cell around a moving TCP: states of parts and values of inputs."""

import math

import pytest

from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.cell.parts import Outcome
from delta3_pacdrive.cell.world import World
from delta3_pacdrive.errors import RunError

CYCLE_S = 1e-3
PICK, PLACE = (-0.1, 0.0, -0.85), (0.1, 0.0, -0.85)
ON, OFF = 1, 0
DOCUMENT = {
    'cup': {
        'output': 'gripper', 'diameter_mm': 40, 'vacuum_pa': 60000, 'build_up_s': 0.01, 'decay_s': 0.002,
        'valve': {'on_s': 0.005, 'off_s': 0.003},
        'switch': {'input': 'vacuum', 'on_pa': 40000, 'off_pa': 30000, 'delays': {'on_s': 0.001}},
    },
    'parts': {'bar': {'mass_kg': 0.5, 'size_mm': [60, 40, 20], 'friction': 0.5}},
    'supplies': {'infeed': {'part': 'bar', 'at_mm': [-100, 0, -870], 'count': 3, 'refill_s': 0.02}},
    'boxes': {'tray': {'at_mm': [100, 0, -870], 'columns': 2, 'rows': 1, 'pitch_mm': [80, 0]}},
    'inputs': {'there': {'sensor': {'at_mm': [-100, 0, 0], 'radius_mm': 10}}},
}  # fmt: skip


class Hand:
    """The TCP of a robot with prescribed positions."""

    def __init__(self, document=None, start_cycle=0):
        self.world = World(cell_file.parse(DOCUMENT if document is None else document), CYCLE_S, start_cycle)
        self.cycle, self.at = 0, PICK

    def stay(self, output, cycles):
        """Rest for a time; return the value of the vacuum switch."""
        return [self.step(self.at, output) for _ in range(cycles)]

    def step(self, place, output):
        self.at = place
        inputs = self.world.step(self.cycle, place, output)
        self.cycle += 1
        return inputs.get('vacuum')

    def go(self, place, output, seconds=0.5):
        """Move along a line, its acceleration half a sine each way."""
        begin, count = self.at, round(seconds / CYCLE_S)
        for n in range(1, count + 1):
            share = n / count - math.sin(math.tau * n / count) / math.tau
            self.step(tuple(a + share * (b - a) for a, b in zip(begin, place, strict=True)), output)

    def pick_and_place(self, place=PLACE, seconds=0.5):
        self.stay(ON, 60)
        self.go((self.at[0], self.at[1], -0.8), ON)
        self.go((place[0], place[1], -0.8), ON, seconds)
        self.go(place, ON)
        self.stay(OFF, 30)
        self.go((place[0], place[1], -0.8), OFF)
        self.go((PICK[0], PICK[1], -0.8), OFF)
        self.go(PICK, OFF)

    @property
    def parts(self):
        return self.world.records


def changed(**more):
    """Return the cell with another cup."""
    return DOCUMENT | {'cup': DOCUMENT['cup'] | more}


def test_part_is_picked_carried_and_placed_and_its_record_has_the_errors():
    hand = Hand()
    hand.at = (-0.102, 0.001, -0.8495)
    hand.pick_and_place((0.101, 0.002, -0.849))
    part = hand.parts[0]
    assert (part.type, part.source, part.outcome) == ('bar', 'infeed', Outcome.PLACED)
    assert (part.where, part.place, part.reason) == ('tray', 0, '')
    assert part.pick_error_m == pytest.approx((-0.002, 0.001, 0.0005))
    # where the cup was beside its middle it still is
    assert part.place_error_m == pytest.approx((0.003, 0.001, 0.0005))
    assert part.picked_cycle < 60 < part.hold_cycle < part.released_cycle
    # half a sine of 0.203 m, and of 1 mm across, in 0.5 s
    most = math.hypot(0.203, 0.001) * math.tau / 0.5**2
    assert part.hold_needed_n == pytest.approx(0.5 * 9.80665 + 0.5 * most / 0.5, rel=2e-3)
    assert part.hold_force_n == pytest.approx(6e4 * math.pi * 0.02**2, rel=1e-6)
    assert part.hold_use == part.hold_needed_n / part.hold_force_n


def test_payload_acts_on_the_robot_from_grip_to_release():
    hand = Hand()
    masses = []
    for output in (ON, OFF):
        for _ in range(40):
            hand.step(PICK, output)
            masses.append(hand.world.carried_kg)
    part = hand.parts[0]
    assert masses == [0.5 if part.picked_cycle <= cycle < part.released_cycle else 0.0 for cycle in range(80)]
    # 5 ms of the valve, then until the vacuum bears the weight; 3 ms of the valve, then until it does no longer
    assert part.picked_cycle == 5
    assert 43 < part.released_cycle < 53


def test_a_part_that_is_put_back_lies_there():
    hand = Hand(DOCUMENT | {'supplies': {'infeed': DOCUMENT['supplies']['infeed'] | {'refill_s': 9.0}}})
    hand.stay(ON, 40)
    hand.stay(OFF, 40)
    part = hand.parts[0]
    assert (part.outcome, part.where) == (Outcome.PLACED, 'infeed')
    hand.stay(ON, 40)
    assert part.outcome is Outcome.IN_HAND


def test_the_vacuum_switch_closes_on_a_part_only():
    hand = Hand()
    on_part = hand.stay(ON, 60)
    # 40 of 60 kPa after 1.1 time constants, the valve before it and the switch behind it
    assert on_part.index(True) == pytest.approx(5 + 11 + 1, abs=1)
    assert all(on_part[on_part.index(True) :])
    empty = Hand()
    empty.at = (-0.1, 0.0, -0.84)
    assert not any(empty.stay(ON, 200))
    assert empty.world.carried_kg == 0.0


def test_the_switch_falls_back_below_its_lower_threshold():
    hand = Hand(changed(decay_s=0.02))
    hand.stay(ON, 100)
    told = hand.stay(OFF, 60)
    # from 60 kPa to 30 kPa in 0.69 time constants, 3 ms after the output
    assert told.index(False) == pytest.approx(3 + 14, abs=1)


@pytest.mark.parametrize(
    ('place', 'told'),
    [
        ((-0.1, 0.0, -0.84), '0.0 mm from the axis of the cup, its top 10.0 mm below the cup'),
        ((-0.108, 0.006, -0.85), '10.0 mm from the axis of the cup'),
    ],
)
def test_distant_cup_misses_its_part_and_reports_the_distance(place, told):
    hand = Hand()
    hand.at = place
    hand.stay(ON, 50)
    hand.stay(OFF, 20)
    (miss,) = hand.world.report()['misses']
    assert told in miss['reason']
    assert (miss['opened_cycle'], miss['closed_cycle']) == (5, 53)
    assert hand.parts[0].outcome is Outcome.WAITING


def test_a_cup_that_leaves_before_the_vacuum_holds_misses_the_part():
    hand = Hand(changed(build_up_s=1.0))
    hand.stay(ON, 20)
    hand.go((-0.1, 0.0, -0.8), ON, 0.1)
    hand.stay(OFF, 20)
    assert 'did not hold the part' in hand.world.report()['misses'][0]['reason']


def test_a_part_that_is_moved_too_fast_slides_off_and_is_lost():
    hand = Hand()
    hand.pick_and_place(seconds=0.12)
    part = hand.parts[0]
    assert part.outcome is Outcome.LOST
    assert part.reason.startswith('it slid off: it needed ')
    assert part.hold_use > 1.0
    assert hand.world.report()['outcomes']['lost'] == 1


def test_a_part_that_is_lifted_too_fast_is_pulled_off():
    hand = Hand()
    hand.stay(ON, 60)
    hand.go((-0.1, 0.0, -0.7), ON, 0.06)
    assert hand.parts[0].reason.startswith('it was pulled off: it needed ')


def test_vacuum_that_fails_in_the_air_loses_the_part():
    document = DOCUMENT | {'faults': [{'fault': 'vacuum_failure', 'after_s': 0.7}]}
    hand = Hand(document)
    hand.pick_and_place()
    part = hand.parts[0]
    assert part.reason.startswith('the vacuum failed: it needed ')
    assert 700 <= part.released_cycle < 715
    # until it ends, nothing is gripped
    short = Hand(DOCUMENT | {'faults': [{'fault': 'vacuum_failure', 'after_s': 0.0, 'for_s': 0.05}]})
    short.stay(ON, 80)
    assert short.parts[0].picked_cycle == 50


def test_part_released_too_high_or_too_low_is_dropped():
    high, low, beside = Hand(), Hand(), Hand()
    high.pick_and_place((0.1, 0.0, -0.84))
    low.pick_and_place((0.1, 0.0, -0.853))
    beside.pick_and_place((0.1, 0.1, -0.85))
    assert (high.parts[0].outcome, high.parts[0].reason) == (Outcome.DROPPED, 'it fell 10.0 mm')
    assert (low.parts[0].outcome, low.parts[0].reason) == (
        Outcome.PRESSED,
        'it was 3.0 mm below the height of its support',
    )
    assert (beside.parts[0].outcome, beside.parts[0].reason) == (
        Outcome.DROPPED,
        'there was nothing below it',
    )


def test_layers_are_stacked_and_their_number_is_counted():
    hand = Hand()
    hand.pick_and_place()
    hand.pick_and_place((0.181, 0.0, -0.85))
    hand.pick_and_place((0.1, 0.0, -0.83))
    assert [part.place for part in hand.parts] == [0, 1, 2]
    assert [part.outcome for part in hand.parts] == [Outcome.PLACED] * 3
    assert hand.parts[1].place_error_m[0] == pytest.approx(0.001)
    assert hand.parts[2].place_error_m[2] == pytest.approx(0.0, abs=1e-9)
    report = hand.world.report()
    assert (report['picked'], report['missed']) == (3, 0)
    assert report['place_error_max_m'] == pytest.approx(0.001)
    assert report['place_error_rms_m'] == pytest.approx(0.001 / math.sqrt(3))


def test_a_box_that_is_cleared_has_room_again():
    hand = Hand(DOCUMENT | {'boxes': {'tray': DOCUMENT['boxes']['tray'] | {'clears_s': 0.1}}})
    hand.pick_and_place()
    hand.pick_and_place()
    assert [part.place for part in hand.parts[:2]] == [0, 0]


def test_next_part_arrives_after_its_interval_until_the_last():
    hand = Hand()
    counts = []
    for _ in range(4):
        hand.pick_and_place((0.1, 0.0, -0.8))
        counts.append(len(hand.parts))
    assert counts == [2, 3, 3, 3]
    assert [part.outcome for part in hand.parts] == [Outcome.DROPPED] * 3
    assert hand.world.report()['missed'] == 1


def test_sensor_detects_resting_and_carried_parts():
    hand = Hand()
    seen = []
    for _ in range(3):
        hand.stay(ON, 60)
        hand.go((-0.1, 0.1, -0.85), ON, 0.5)
        seen.append(hand.world.inputs['there'])
        hand.stay(OFF, 30)
        hand.go(PICK, OFF)
    assert seen == [True, True, False]


def test_inputs_change_at_their_times_after_the_start_of_the_program():
    changes = [{'after_s': 0.01, 'value': True}, {'after_s': 0.02, 'value': False}]
    hand = Hand({'inputs': {'start': {'changes': changes, 'delays': {'on_s': 0.002}}}}, start_cycle=5)
    told = [dict(hand.world.step(cycle, PICK, OFF))['start'] for cycle in range(40)]
    assert [cycle for cycle, value in enumerate(told) if value] == list(range(17, 25))


def test_stuck_input_reports_the_same_value_for_any_true_value():
    stuck = {'fault': 'input_stuck', 'input': 'vacuum', 'value': False, 'after_s': 0.05, 'for_s': 0.02}
    told = Hand(DOCUMENT | {'faults': [stuck]}).stay(ON, 100)
    assert told[49:71] == [True, *[False] * 20, True]


def test_the_same_cell_gives_the_same_bits_and_another_seed_others():
    bounces = changed(valve={'on_s': 0.001, 'off_s': 0.001, 'bounce_s': 0.02})

    def story(seed):
        hand = Hand(bounces | {'seed': seed})
        hand.pick_and_place()
        return [part.to_document() for part in hand.parts]

    assert story(1) == story(1)
    assert story(1) != story(2)


@pytest.mark.parametrize('cycle', [3, 4, 6, -1])
def test_a_bus_cycle_that_does_not_follow_the_last_one_is_rejected(cycle):
    hand = Hand()
    hand.stay(OFF, 5)
    with pytest.raises(
        RunError, match=f'the cell is in bus cycle 4, and bus cycle {cycle} does not follow it'
    ):
        hand.world.step(cycle, PICK, OFF)


def test_an_empty_cell_does_nothing():
    hand = Hand({})
    assert hand.stay(ON, 5) == [None] * 5
    assert hand.world.carried_kg is None
    hand.world.drop_part(5)
    assert hand.world.report()['parts'] == []
