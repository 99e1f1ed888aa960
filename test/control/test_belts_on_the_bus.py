"""Tests of belt picking on a bus: a script has the bits and the reports of its simulation."""

import json

import numpy as np
import pytest

from belts import QUICK, around, pick, speed_of
from delta3_pacdrive import parameters, scripting
from delta3_pacdrive.belts.image import belts_text, read_belts
from delta3_pacdrive.belts.knowledge import TrackOrder
from delta3_pacdrive.belts.synchronization import TrackLimits, TrackWindow
from delta3_pacdrive.belts.tracking import BeltReading
from delta3_pacdrive.control.operation.script_operations import TRACK
from delta3_pacdrive.errors import Code
from delta3_pacdrive.scripting.belt_robot import BeltRobot
from delta3_pacdrive.scripting.connected_link import ConnectedLink
from delta3_pacdrive.simulation.belts import axes_of
from script_bus import ANSWERS_LATE, BELTS_FIRST, ServedNode
from thoroughness import some

CAMERA = {
    'at_mm': 200,
    'length_mm': 200,
    'every_mm': 120,
    'latency_s': 0.03,
    'noise_mm': 0.05,
    'doubled_share': 0.3,
}
SLOW = [speed_of(0.4)]


@pytest.fixture(scope='module')
def robot():
    return parameters.load(parameters.MODEL_CONTROLLER)


def picks(called):
    pick(called)
    pick(called)
    called.output('gripper', False)


def holds(called):
    """Stop on the belt and after it, and continue."""
    with called.track('line', timeout_s=5.0, **QUICK):
        called.move_l(to_mm=[0, 0, 40], **QUICK)
        called.wait()
        called.hold()
        called.wait_time(0.1)
        called.resume()
        called.move_l(to_mm=[0, 0, 30], **QUICK)
    called.wait(left_s=0.02)
    called.hold()
    called.resume()
    called.move_l(to_mm=[0, 0, -800])


def overrides(called):
    """Work on the belt at another speed, and look at it meanwhile."""
    with called.track('line', timeout_s=5.0, **QUICK):
        called.move_l(to_mm=[0, 0, 60], **QUICK)
        called.wait()
        called.override(60)
        called.move_l(to_mm=[0, 0, 40], **QUICK)
        called.wait()
        if called.belt('line').way_m > 0.1:
            called.override(100)
        called.dwell(0.05)


def waits(called):
    """Stay on the belt without moves, decide, and go on there."""
    with called.track('line', timeout_s=5.0, **QUICK):
        called.move_l(to_mm=[0, 0, 60], **QUICK)
        called.wait_time(0.6)
        if called.state().motion == 'idle':
            called.move_l(to_mm=[0, 20, 50], **QUICK)
        called.wait()
    called.move_l(to_mm=[0, 0, -800], **QUICK)


def stays(called):
    """Stay above a part that the belt carries away, and go on when that is lost."""
    refused = []
    try:
        with called.track('line', timeout_s=5.0, **QUICK):
            called.move_l(to_mm=[0, 0, 60], **QUICK)
            called.wait_time(5.0)
    except scripting.ScriptError as error:
        refused.append(error.code)
    assert refused == [Code.BELT]
    called.move_l(to_mm=[50, 0, -800])


def gives_up(called):
    """Cancel the work for an own reason."""
    try:
        with called.track('line', timeout_s=5.0, **QUICK):
            called.move_l(to_mm=[0, 0, 60], **QUICK)
            called.wait_time(0.6)
            called.move_l(to_mm=[0, 30, 60])
            raise ValueError
    except ValueError:
        called.move_l(to_mm=[50, 0, -800])


def polls(called):
    """Look at robot and belt in every bus cycle, while it works and while the part is lost."""
    seen = []
    try:
        with called.track('line', timeout_s=5.0, **QUICK):
            called.move_l(to_mm=[0, 0, 60], **QUICK)
            called.wait()
            called.dwell(0.9)
            called.wait_time(0.6)
            called.dwell(0.9)
            for _ in range(1400):
                called.wait_time(0.001)
                seen.append((called.state(), called.belt('line')))
    except scripting.ScriptError as error:
        seen.append(str(error))
    assert 'the window ends at' in seen[-1]
    called.move_l(to_mm=[50, 0, -800])
    return seen


def puts(called):
    """Put something down on free places."""
    for _ in range(2):
        with called.track('line', called.slot('line', 0.1), timeout_s=5.0, **QUICK):
            called.move_l(to_mm=[0, 0, 60], **QUICK)
            called.dwell(0.02)
        called.move_l(to_mm=[0, 0, -800], **QUICK)


SCRIPTS = {
    'picks': (picks, SLOW, {}),
    'picks what a camera sees': (picks, SLOW, {'camera': CAMERA}),
    'holds': (holds, SLOW, {}),
    'overrides': (overrides, SLOW, {}),
    'waits': (waits, SLOW, {}),
    'stays on a belt that gets faster': (stays, [speed_of(0.3), speed_of(1.2, after_s=2.0)], {}),
    'stays on a belt that runs back': (stays, [speed_of(0.3), speed_of(-0.3, after_s=2.6)], {}),
    'gives up': (gives_up, SLOW, {}),
    'puts': (puts, SLOW, {}),
    'polls': (polls, SLOW, {}),
}


CASES = [(name, order) for name in SCRIPTS for order in ('', BELTS_FIRST, ANSWERS_LATE)]
IN_EACH_RUN = [('puts', order) for order in ('', BELTS_FIRST, ANSWERS_LATE)] + [
    (name, '') for name in ('picks', 'holds', 'overrides', 'waits', 'gives up')
]


@pytest.mark.parametrize(('name', 'order'), some(CASES, IN_EACH_RUN))
def test_a_script_has_the_bits_of_its_simulation(robot, name, order):
    script, speed, of_belt = SCRIPTS[name]
    there = around(speed, 3, **of_belt)
    with scripting.simulate(robot, cell=there) as simulated:
        seen = script(simulated)
        known = simulated.belt('line')
    trace = simulated.trace
    node = ServedNode(robot, there, order)
    called = BeltRobot(ConnectedLink(node, robot), 'script')
    assert script(called) == seen
    assert called.belt('line') == known
    called.finish()
    bus = node.bus
    assert bus.most_outstanding > 0
    cycles = min(len(bus.commands), len(trace.time_s))
    assert cycles > len(trace.time_s) - 10
    assert np.array_equal(np.array(bus.commands[:cycles]), trace['motor_command'][:cycles])
    assert np.array_equal(np.array(bus.answers[:cycles]), trace['motor_position'][:cycles])
    assert np.ptp(trace['tcp_command'], axis=0).max() > 0.04


def test_an_answer_of_a_drive_that_is_lost_keeps_no_robot_with_belts_waiting(node, called):
    node.bus.lose_answer = 1200
    pick(called)
    called.wait()
    assert node.controller.cycles.answers.lost == 1
    assert called.position() == pytest.approx((0.0, -0.2, -0.85), abs=1e-4)


def test_repeated_belt_readings_count_once(robot, node, called):
    before = node.controller.task.tracking.observed
    node.controller.cycles.take_belts(before.cycle, [BeltReading(10**6, (5,))])
    pick(called)
    assert called.belt('line').jumps == 0
    assert called.belt('line').bounced == 0


ORDER = TrackOrder(0, -0.1, 0.7, TrackWindow(0.4, 1.1), TrackLimits(4.0, 40.0, 4000.0), 0.3)


def test_command_is_transferred_to_the_bit():
    assert TrackOrder.from_document(json.loads(json.dumps(ORDER.to_document()))) == ORDER


def test_a_robot_without_belts_names_none(robot):
    node = ServedNode(robot)
    called = BeltRobot(ConnectedLink(node, robot), 'script')
    with pytest.raises(scripting.ScriptError, match=r"unknown belt 'line', the belts are: none"):
        called.part('line')
    reason, _ = node.ask(TRACK, json.dumps(ORDER.to_document()))
    assert str(reason) == 'the robot cannot work on belt number 0, of 0'


def test_belts_are_announced_to_the_bit():
    axes = axes_of(around(SLOW, 3, camera=CAMERA))
    assert read_belts(belts_text(axes)) == axes


@pytest.mark.parametrize(
    'text',
    ['', 'null', '{}', '[{}]', '[1]', '[[]]', 'NaN', '[' * 10_000]
    + [
        belts_text(axes_of(around(SLOW, 3))).replace(old, new)
        for old, new in (
            ('"line"', '7'),
            ('0.45', 'NaN'),
            ('0.45', '5.0'),
            ('-0.7', '1e300'),
            ('"increments_per_m": ', '"increments_per_m": -'),
            ('"types"', '"kinds"'),
            ('-0.7', '1' + 400 * '0'),
            ('-0.7', 'Infinity'),
            ('"line"', '"\\ud800"'),
            ('"line"', '"' + 1000 * 'x' + '"'),
            ('"types": []', '"types": ["\\n"]'),
        )
    ],
)
def test_announcement_without_belts_is_ignored(text):
    with pytest.raises(ValueError):  # noqa: PT011  of json and of the reader
        read_belts(text)
