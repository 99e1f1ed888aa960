"""Tests of parts on a rotary axis: rotation with the tool about the TCP, and angle after placing."""

import math

import numpy as np
import pytest

import delta3_pacdrive as d3
from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.cell.cell import turned
from delta3_pacdrive.cell.part_places import angle_rad, place_m
from delta3_pacdrive.cell.parts import How, Outcome
from delta3_pacdrive.cell.world import World
from delta3_pacdrive.planning.program import file_reader as program_file

CYCLE_S, ON, OFF = 1e-3, 1, 0
PICK, UP, PLACE = (-0.1, 0.0, -0.85), (-0.1, 0.0, -0.8), (0.1, 0.0, -0.85)
ROUNDED_M, ROUNDED_RAD = 2e-7, 2e-7  # stays are rounded
DOCUMENT = {
    'cup': {'output': 'gripper', 'diameter_mm': 40, 'vacuum_pa': 60000},
    'parts': {'bar': {'mass_kg': 0.5, 'size_mm': [60, 40, 20], 'friction': 0.5}},
    'supplies': {'infeed': {'part': 'bar', 'at_mm': [-100, 0, -870], 'angle_rad': 0.3, 'count': 1}},
    'boxes': {'tray': {'at_mm': [100, 0, -870]}},
}
BELT = {
    'origin_m': [-0.3, 0.0, -0.87], 'direction_rad': 0.4, 'length_m': 0.8,
    'encoder': {'bits': 16, 'circumference_m': 0.3},
    'speed': [{'after_s': 0, 'speed_m_s': 0.1, 'acceleration_m_s2': 100}],
}  # fmt: skip


class Turner:
    """A TCP and a tool with prescribed poses."""

    def __init__(self, document=None):
        self.world = World(cell_file.parse(document or DOCUMENT), CYCLE_S)
        self.cycle, self.at, self.turn, self.seen = 0, PICK, 0.0, []

    def go(self, place, turn, output, cycles):
        """Move and turn from rest to rest; note where the first part is in truth."""
        begin, before = self.at, self.turn
        for n in range(1, cycles + 1):
            share = n / cycles - math.sin(math.tau * n / cycles) / math.tau
            self.at = tuple(a + share * (b - a) for a, b in zip(begin, place, strict=True))
            self.turn = before + share * (turn - before)
            self.world.step(self.cycle, self.at, output, self.turn)
            stay = self.part.stays[-1]
            self.seen.append((stay, place_m(stay, self.at, turn_rad=self.turn), angle_rad(stay, self.turn)))
            self.cycle += 1

    @property
    def part(self):
        return self.world.records[0]

    def carry(self, beside=(0.0, 0.0), begin=0.0, end=math.pi / 2):
        """Pick up the part off centre with the tool at one angle; put it down with it at another."""
        self.at, self.turn = (PICK[0] + beside[0], PICK[1] + beside[1], PICK[2]), begin
        self.go(self.at, begin, ON, 60)
        self.go(UP, begin, ON, 400)
        self.go((0.1, 0.0, -0.8), end, ON, 600)
        self.go(PLACE, end, ON, 400)
        self.go(PLACE, end, OFF, 40)


@pytest.mark.parametrize(('begin', 'end'), [(0.0, math.pi / 2), (1.0, -2.0), (-0.5, -0.5)])
def test_a_part_lies_turned_by_as_much_as_the_tool_was(begin, end):
    hand = Turner()
    hand.carry(begin=begin, end=end)
    assert hand.part.outcome is Outcome.PLACED
    lay, in_hand, lies = hand.part.stays
    assert (lay.how, in_hand.how, lies.how) == (How.LYING, How.IN_HAND, How.LYING)
    assert lay.angle_rad == 0.3
    assert in_hand.angle_rad == pytest.approx(0.3 - begin, abs=ROUNDED_RAD)
    assert lies.angle_rad == pytest.approx(0.3 + end - begin, abs=ROUNDED_RAD)
    lying = [(stay, place, angle) for stay, place, angle in hand.seen if stay.how is How.LYING]
    assert lying[-1][0] is lies
    assert all(place == stay.at_m and angle == stay.angle_rad for stay, place, angle in lying)


def test_part_held_off_centre_rotates_around_the_tcp():
    hand = Turner()
    hand.carry(beside=(0.003, -0.002))
    error = hand.part.place_error_m
    assert error[:2] == pytest.approx(
        (-0.002, -0.003), abs=ROUNDED_M
    )  # (-0.003, 0.002), a quarter of a turn on
    lies = hand.part.stays[-1]
    assert lies.at_m[:2] == pytest.approx((PLACE[0] - 0.002, PLACE[1] - 0.003), abs=ROUNDED_M)


def test_offset_cup_rotates_around_the_tcp_with_its_part():
    hand = Turner(DOCUMENT | {'cup': DOCUMENT['cup'] | {'offset_mm': [10, 0, 0]}})
    hand.carry(beside=(-0.010, 0.0))
    assert hand.part.outcome is Outcome.PLACED
    assert hand.part.pick_error_m == pytest.approx((0.0, 0.0, 0.0), abs=ROUNDED_M)
    assert hand.part.place_error_m[:2] == pytest.approx((0.0, 0.010), abs=ROUNDED_M)


def test_dwell_records_give_position_and_rotation_of_a_gripped_part_in_every_cycle():
    hand = Turner()
    hand.carry(beside=(0.003, 0.0), begin=0.2, end=1.7)
    carried = [(place, angle) for stay, place, angle in hand.seen if stay.how is How.IN_HAND]
    places, angles = np.array([place for place, _ in carried]), np.array([angle for _, angle in carried])
    assert angles[0] == pytest.approx(0.3, abs=ROUNDED_RAD)
    assert angles[-1] == pytest.approx(0.3 + 1.5, abs=ROUNDED_RAD)
    last = hand.part.stays[-1]
    assert places[-1] == pytest.approx(last.at_m, abs=1e-6)
    assert angles[-1] == pytest.approx(last.angle_rad, abs=1e-6)
    assert np.abs(np.diff(places, axis=0)).max() < 1e-3  # it jumps nowhere


def test_part_placed_on_a_belt_keeps_its_angle():
    document = {name: DOCUMENT[name] for name in ('cup', 'parts', 'supplies')} | {'belts': {'line': BELT}}
    hand = Turner(document)
    hand.carry()
    riding = hand.part.stays[-1]
    assert (hand.part.outcome, riding.how, riding.belt) == (Outcome.PLACED, How.RIDING, 'line')
    assert riding.angle_rad == pytest.approx(0.3 + math.pi / 2, abs=ROUNDED_RAD)


def test_no_turn_changes_no_bit_of_a_place():
    for place in ((-0.0, 0.1, -0.0), (0.3, -0.2, 0.7)):
        assert turned(place, 0.0) is place
        assert turned(turned(place, 0.7), -0.7) == pytest.approx(place)


def test_a_robot_with_a_rotary_axis_puts_parts_down_as_far_turned_as_its_tool_really_is(robot, tmp_path):
    (tmp_path / 'p.yaml').write_text("""
        start_m: [-0.1525, 0.0, -0.85]
        payload_kg: 0.0
        moves:
        - output: {name: gripper, value: true, payload_kg: 0.5}
        - dwell: {time_s: 0.05}
        - move_l: {to_m: {by_m: [0, 0, 0.05]}}
        - move_l: {to_m: {by_m: [0.305, 0, 0]}, turn_deg: 120}
        - move_l: {to_m: {by_m: [0, 0, -0.05]}}
        - output: {name: gripper, value: false, payload_kg: 0.0}
        - dwell: {time_s: 0.1}
    """)
    turning = robot.replace(rotary__present=True)
    run = d3.simulate(program_file.load(tmp_path / 'p.yaml', turning.motion), turning, cell='cell')
    part = run.meta['cell']['parts'][0]
    assert part['outcome'] == 'placed'
    lies = next(stay for stay in part['stays'] if stay['how'] == 'lying' and stay['cycle'] > 0)
    true = run['turn_true'][:, 0]
    assert math.degrees(lies['angle_rad']) == pytest.approx(120.0, abs=0.2)
    turn = true[part['released_cycle']] - true[part['picked_cycle']]
    assert lies['angle_rad'] == pytest.approx(turn, abs=ROUNDED_RAD)
