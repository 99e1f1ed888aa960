"""Tests of the cell of a running robot from its messages, without effect of foreign ones."""

import json

import numpy as np
import pytest

from bags import CLOCK, STORE
from cell_truth import TEXT, picks_from_a_belt
from delta3_pacdrive.cell.cell_scene import Kind
from delta3_pacdrive.view.cell_state import CellNow
from delta3_pacdrive.view.values import PARTS_MAX

TCP = (0.1, 0.2, -0.8)
INCREMENT_M = 0.2 / 2**14  # of the belt of the simulation
PER_M = 1000.0
LINE = {
    'kind': 'belt', 'name': 'line', 'at_m': [0.0, 0.0, -0.9], 'angle_rad': np.pi / 2, 'size_m': [1.0, 0.3],
    'increments_per_m': PER_M,
}  # fmt: skip
SCENE = {'cell': 'one belt', 'things': [LINE]}
ABOUT = {'cell': 'one belt', 'inputs': [], 'belts': ['line']}
RECORD = {
    'type': 'bar', 'source': 'line', 'outcome': 'waiting', 'reason': '', 'picked_cycle': -1,
    'pick_error_m': [0, 0, 0], 'hold_use': 0, 'hold_needed_n': 0, 'hold_force_n': 0, 'hold_cycle': -1,
    'released_cycle': -1, 'where': '', 'place': -1, 'place_error_m': [0, 0, 0], 'size_m': [0.06, 0.04, 0.02],
}  # fmt: skip


def stay(how, at_m=(0.0, -0.3, -0.9), count=0):
    belt = 'line' if how == 'riding' else ''
    return {'cycle': 5, 'how': how, 'at_m': list(at_m), 'angle_rad': 0.1, 'belt': belt, 'count': count}


def parts(*stays, first=0, **more):
    documents = [RECORD | {'number': first + n, 'stays': [one]} | more for n, one in enumerate(stays)]
    return json.dumps({'cycle': 5, **ABOUT, 'parts': documents, 'misses': []})


def one_belt():
    """Return a cell with a belt that has gone 200 mm."""
    now = CellNow()
    now.take_scene(json.dumps(SCENE))
    now.take_counts(1.0, {'line': 200.0})
    return now


def places(now, time_s=1.0, tcp_m=TCP):
    return {part.number: part.at_m for part in now.at(time_s, tcp_m).parts}


def test_parts_lie_ride_on_belts_hang_at_the_tcp_and_disappear():
    now = one_belt()
    riding, in_hand = stay('riding', count=50), stay('in hand', (0.01, 0.0, -0.02))
    now.take_parts(parts(stay('lying'), riding, in_hand, stay('gone')))
    found = places(now)
    assert found[0] == (0.0, -0.3, -0.9)
    assert found[1] == pytest.approx((0.0, -0.3 + 0.15, -0.9), abs=1e-12)
    assert found[2] == pytest.approx((0.11, 0.2, -0.82), abs=1e-12)
    assert set(found) == {0, 1, 2}
    now.take_parts(parts(stay('gone'), stay('lying', (0.2, 0.2, -0.9))))
    found = places(now)
    assert set(found) == {1, 2}
    assert found[1] == (0.2, 0.2, -0.9)


def test_a_part_in_hand_turns_with_the_tool_and_others_stay_as_they_are():
    now = one_belt()
    now.take_parts(parts(stay('lying'), stay('in hand', (0.01, 0.0, -0.02))))
    lying, in_hand = now.at(1.0, TCP, np.pi / 2).parts
    assert (lying.at_m, lying.angle_rad) == ((0.0, -0.3, -0.9), 0.1)
    assert in_hand.at_m == pytest.approx((0.1, 0.21, -0.82), abs=1e-12)
    assert in_hand.angle_rad == pytest.approx(0.1 + np.pi / 2)


def test_belts_and_their_parts_are_drawn_at_their_positions_of_the_displayed_time():
    now = one_belt()
    now.take_parts(parts(stay('riding')))
    now.take_counts(1.1, {'line': 300.0})
    for time_s, way_m in ((0.9, 0.2), (1.0, 0.2), (1.05, 0.25), (1.1, 0.3), (1.2, 0.3)):
        assert now.at(time_s, TCP).ways_m['line'] == pytest.approx(way_m)
        assert places(now, time_s)[0][1] == pytest.approx(-0.3 + way_m)
    now.take_counts(0.0, {'line': 7.0})  # bus time begins anew
    assert now.at(0.0, TCP).ways_m['line'] == pytest.approx(0.007)


def test_every_part_of_a_simulation_is_where_it_truly_is():
    _, truth = picks_from_a_belt()
    now, seen = CellNow(), 0
    now.take_scene(json.dumps(truth.scene))
    for topic, data in truth.arrivals:
        if topic == 'cell/parts':
            now.take_parts(STORE.deserialize_cdr(data, TEXT).data)
            continue
        message = STORE.deserialize_cdr(data, 'sensor_msgs/msg/JointState')
        stamp = message.header.stamp
        now.take_counts(
            stamp.sec + 1e-9 * stamp.nanosec, dict(zip(message.name, message.position, strict=True))
        )
        tcp, true = truth.cycles[CLOCK.count(stamp.sec, stamp.nanosec)]
        for number, place in places(now, stamp.sec + 1e-9 * stamp.nanosec, tcp).items():
            assert place == pytest.approx(true[number][0], abs=2 * INCREMENT_M)
            seen += 1
    assert seen > 2000


@pytest.mark.parametrize(
    'text',
    [
        *('', '{', '[]', 'null', '1e999', '"x"', '[' * 100_000, '{"parts": 3}', '{"things": [], "cell": 3}'),
        *(json.dumps(SCENE | {'things': [LINE | wrong]}) for wrong in ({'kind': 'moon'}, {'at_m': [0, 0]})),
        *(
            json.dumps(SCENE | {'things': [LINE | {name: 1e999}]})
            for name in ('angle_rad', 'increments_per_m')
        ),
        *(parts(stay(how)) for how in ('flying', None)),
        *(parts(stay('lying'), size_m=size) for size in ([0, 0, 0], [1e9, 1, 1], [-1, 1, 1])),
        parts(stay('lying', (1e9, 0, 0))),
        parts(stay('lying'), stays=[]),
    ],
)
def test_invalid_cell_message_changes_nothing(text):
    now = one_belt()
    now.take_parts(parts(stay('lying'), first=7))
    now.take_scene(text)
    now.take_parts(text)
    assert places(now) == {7: (0.0, -0.3, -0.9)}
    assert [(thing.kind, thing.name) for thing in now.things] == [(Kind.BELT, 'line')]
    assert now.changes == 1


def test_the_newest_parts_are_shown():
    now = one_belt()
    for first in range(0, 2 * PARTS_MAX, 200):
        now.take_parts(parts(*[stay('lying')] * 200, first=first))
    assert list(places(now)) == list(range(PARTS_MAX, 2 * PARTS_MAX))


def test_parts_of_the_previous_robot_disappear_and_new_ones_appear_in_any_order():
    now = one_belt()
    now.take_parts(parts(stay('lying')), sent_ns=10)
    now.take_parts(parts(stay('lying'), first=1), sent_ns=30)  # overtook the scene
    now.take_scene(json.dumps(SCENE), sent_ns=20)
    assert set(places(now)) == {1}
    assert now.changes == 1  # it looks as before
    now.clear()
    assert (now.things, now.changes) == ((), 2)
    assert now.at(1.0, TCP).parts == ()


def test_belt_without_encoder_or_readings_is_at_rest():
    now = one_belt()
    now.take_parts(parts(stay('riding')))
    now.take_scene(json.dumps(SCENE | {'things': [LINE | {'increments_per_m': 0.0}]}))
    assert now.at(1.0, TCP).ways_m == {}
    assert places(now)[0] == (0.0, -0.3, -0.9)
    now.take_scene(json.dumps(SCENE | {'things': [LINE | {'name': 'another'}]}))
    assert now.at(1.0, TCP).ways_m == {}
    assert places(now)[0] == (0.0, -0.3, -0.9)
