"""Tests of belt picking on a bus: stop, disable, change of control and invalid requests by operators."""

import json
import math

import numpy as np
import pytest

from belts import QUICK, around, gets_on, pick, speed_of
from delta3_pacdrive import parameters, scripting
from delta3_pacdrive.belts.knowledge import TrackOrder
from delta3_pacdrive.belts.synchronization import TrackLimits, TrackWindow
from delta3_pacdrive.belts.tracking import BeltReading
from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.control.operation.control import Operator
from delta3_pacdrive.control.operation.script_gate import GateEvent
from delta3_pacdrive.control.operation.script_operations import CANCEL, TRACK, TRACK_AGAIN
from delta3_pacdrive.errors import Code, FaultCode, Reason, RefusedError
from delta3_pacdrive.robot.sercos.bus_time import NEVER
from delta3_pacdrive.scripting.belt_robot import BeltRobot
from delta3_pacdrive.scripting.connected_link import ConnectedLink
from script_bus import ServedNode
from thoroughness import some

SLOW = [speed_of(0.4)]
IN_TRAY_M = (0.0, -0.2, -0.85)
ORDER = TrackOrder(0, -0.1, 0.7, TrackWindow(0.4, 1.1), TrackLimits(4.0, 40.0, 4000.0), 0.3)


@pytest.fixture(scope='module')
def robot():
    return parameters.load(parameters.MODEL_CONTROLLER)


def largest_step(node):
    """Return by how much a motor was commanded to turn in one bus cycle at most [rad]."""
    return np.abs(np.diff(np.array(node.bus.commands), axis=0)).max()


def another_picks(node, robot):
    """Let another script take control and pick a part; return the position of the robot afterwards."""
    node.controller.control.take(Operator(node.identity, 'another script'), False, 2.0)
    another = BeltRobot(ConnectedLink(node, robot), 'another')
    pick(another)
    another.wait()
    another.wait_time(0.1)
    return another.position()


def test_operator_stops_a_robot_on_a_belt_and_the_script_continues(node, called):
    gets_on(called)
    called.dwell(0.8)
    called.wait_time(0.1)
    assert isinstance(node.controller.scripts.hold(), str)
    with pytest.raises(scripting.ScriptError, match='an operator has stopped the robot on its path'):
        called.wait()
    called.wait_time(0.3)
    assert node.controller.state.motion is MotionState.STOPPED
    assert node.stands()
    there = called.position()
    called.resume()
    called.wait_time(0.2)
    assert called.position()[0] - there[0] > 0.1  # the belt has gone on meanwhile
    assert not node.stands()


@pytest.mark.parametrize('ask', ['hold', 'abort'])
def test_robot_that_follows_a_belt_without_moves_is_stopped_too(node, called, ask):
    gets_on(called)
    called.wait_time(0.1)
    assert node.controller.state.motion is MotionState.IDLE
    assert not node.stands()
    located = node.controller.state.located
    answer = getattr(node.controller.scripts, ask)()
    assert answer.startswith('no longer follows its belt, at rest in bus cycle ')
    node.controller.gate.handle(GateEvent.END)
    node.goes_on()
    assert node.stands()
    assert node.controller.task.tracking.free
    assert node.controller.state.located == located + 1  # whoever plans knows from where


def test_script_lost_on_a_belt_leaves_the_robot_next_to_it(robot, node, called):
    gets_on(called)
    called.wait_time(0.1)
    node.controller.control.release(node.identity)
    node.controller.poll(1.0)
    node.goes_on()
    assert node.stands()
    assert another_picks(node, robot) == pytest.approx(IN_TRAY_M, abs=1e-4)


def test_a_script_does_not_begin_on_a_robot_that_still_leaves_a_belt(node, called):
    pick(called)
    called.wait_until(0.0)
    while node.controller.state.motion is not MotionState.IDLE:
        called.wait_time(0.01)
    gets_on(called).__exit__(None, None, None)
    while node.controller.state.motion is not MotionState.IDLE or node.controller.task.tracking.free:
        called.wait_time(0.001)
    node.ask('leave')
    node.controller.gate.handle(GateEvent.END)
    reason, _ = node.ask('attach')
    assert (reason.code, str(reason)) == (
        Code.LATE, 'the robot still follows a belt: try again once it has left it'
    )  # fmt: skip


def test_robot_accepts_moves_again_after_an_emergency_stop_on_a_belt(robot, node, called):
    gets_on(called)
    controller = node.controller
    controller.state.emergency_stop()
    controller.poll(1.0)
    node.goes_on()
    assert node.stands()
    controller.state.recover(controller.task.locate(node.bus.answers[-1]))
    assert controller.task.tracking.free
    controller.task.enable(controller.next_cycle + 2)
    node.goes_on()
    assert another_picks(node, robot) == pytest.approx(IN_TRAY_M, abs=1e-4)


def test_robot_on_a_belt_is_disabled_like_a_moving_one(node, called):
    gets_on(called)
    called.wait_time(0.1)
    controller = node.controller
    assert controller.state.motion is MotionState.IDLE
    before = largest_step(node)
    assert controller.enabling.disable().startswith('stops on its path from bus cycle ')
    assert controller.state.fault.code is FaultCode.DISABLED
    controller.poll(1.0)
    node.goes_on()
    assert node.stands()
    assert controller.task.tracking.rest_cycle < controller.next_cycle
    controller.state.recover(controller.task.locate(node.bus.answers[-1]))
    controller.enabling.enable('the operator')
    node.goes_on()
    assert controller.state.fault is None
    assert largest_step(node) == before


def test_drive_that_yields_on_a_belt_is_detected_after_the_last_move(node, called):
    gets_on(called)
    called.wait_time(0.1)
    state = node.controller.state
    assert (state.motion, state.moves, state.checked_from) == (MotionState.IDLE, True, 0)
    node.ask(CANCEL, str(node.controller.next_cycle + 18))
    assert (state.moves, state.checked_from) == (False, NEVER)


def test_robot_synchronized_again_without_resume_is_at_rest(node, called):
    gets_on(called)
    called.dwell(0.8)
    called.wait_time(0.1)
    reason, _ = node.ask(TRACK_AGAIN, '5000')
    assert str(reason) == 'the robot is moving: only one that stopped next to a belt gets on again'
    called.hold()
    called.wait_time(0.1)
    reason, answer = node.ask(TRACK_AGAIN, str(node.controller.next_cycle + 2))
    assert reason is None
    assert answer.endswith(', if the robot resumes then')
    node.controller.control.release(node.identity)
    node.controller.poll(1.0)
    node.goes_on()
    assert node.stands(300)
    assert node.controller.state.motion is MotionState.STOPPED
    node.controller.scripts.abort()
    node.goes_on(50)
    assert node.stands(300)
    assert node.controller.state.motion is MotionState.IDLE
    assert node.controller.task.tracking.free


def test_robot_next_to_its_belt_continues_only_after_synchronizing_again(node, called):
    gets_on(called)
    called.dwell(0.8)
    called.wait_time(0.1)
    called.hold()
    called.wait_time(0.1)
    node.instead[TRACK_AGAIN] = lambda _: ''
    with pytest.raises(scripting.ScriptError, match='no bus cycle is set to get on again'):
        called.resume()
    del node.instead[TRACK_AGAIN]
    called.resume()
    called.wait_time(0.1)
    assert not node.stands()


def test_unused_command_does_not_apply_to_the_next_part(node, called, robot):
    node.request(TRACK, ORDER)
    node.ask('leave')
    assert another_picks(node, robot) == pytest.approx(IN_TRAY_M, abs=1e-4)
    node.request(TRACK, ORDER)
    node.ask('leave')
    node.controller.gate.handle(GateEvent.END)
    assert another_picks(node, robot) == pytest.approx(IN_TRAY_M, abs=1e-4)


def test_plan_that_synchronizes_without_an_order_is_held(node, called, robot):
    node.instead[TRACK] = lambda _: ''
    pick(called)
    with pytest.raises(scripting.ScriptError, match='but no belt has been selected') as lost:
        called.wait()
    assert lost.value.code is Code.BELT
    assert node.controller.task.tracking.free
    del node.instead[TRACK]
    node.ask('leave')
    node.goes_on()
    assert another_picks(node, robot) == pytest.approx(IN_TRAY_M, abs=1e-4)


@pytest.mark.parametrize('left_cycles', some([75, 50, 45, 42, 38, 30, 26, 22], [22]))
def test_a_script_gives_up_in_the_moment_in_which_the_belt_is_lost(robot, left_cycles):
    there = around(SLOW, 3)

    def works(called, until=None):
        """Stay above a part; return the first bus cycle of the stay and the next observation."""
        seen = []
        try:
            with called.track('line', timeout_s=5.0, **QUICK):
                called.move_l(to_mm=[0, 0, 60], **QUICK)
                called.wait()
                seen.append(called.state().cycle)
                called.wait_time(5.0 if until is None else 1e-3 * (until - seen[0]))
                raise ValueError
        except (ValueError, scripting.ScriptError) as error:
            seen.append(type(error))
        seen.append((called.state().cycle, called.state().motion))
        called.move_l(to_mm=[50, 0, -800])
        called.wait()
        return [*seen, called.position()]

    with scripting.simulate(robot, cell=there) as simulated:
        lost = works(simulated)[2][0]
    with scripting.simulate(robot, cell=there) as simulated:
        seen = works(simulated, lost - left_cycles)
    node = ServedNode(robot, there)
    assert works(BeltRobot(ConnectedLink(node, robot), 'script'), lost - left_cycles) == seen
    commanded = np.array(node.bus.commands[: len(simulated.trace.time_s)])
    assert np.array_equal(commanded, simulated.trace['motor_command'][: len(commanded)])
    assert node.controller.gate.hold_cycle == NEVER


@pytest.mark.parametrize('later_cycles', some([2, 38, 74, 86], [86]))
def test_script_that_holds_after_its_moves_continues_with_the_belt(robot, later_cycles):
    there = around(SLOW, 3)

    def works(called):
        seen = []
        with called.track('line', timeout_s=5.0, **QUICK):
            called.move_l(to_mm=[0, 0, 60], **QUICK)
            called.wait(left_s=0.001)
            called.wait_time(1e-3 * later_cycles)
            try:
                called.hold()
            except scripting.ScriptError as error:
                seen.append(str(error).partition(': ')[2])
            seen.append(called.state())
            called.wait_time(0.1)
            seen.append(called.position())
            if len(seen) == 2:  # it was held
                called.resume()
            called.move_l(to_mm=[0, 0, 40], **QUICK)
        return seen

    with scripting.simulate(robot, cell=there) as simulated:
        seen = works(simulated)
    node = ServedNode(robot, there)
    assert works(BeltRobot(ConnectedLink(node, robot), 'script')) == seen
    commanded = np.array(node.bus.commands[: len(simulated.trace.time_s)])
    assert np.array_equal(commanded, simulated.trace['motor_command'][: len(commanded)])


def test_command_in_transit_does_not_undo_the_stop_of_an_operator(node, called):
    block = gets_on(called)
    called.wait_time(0.1)
    order, refused = node.order, []

    def stopped_meanwhile(*what):
        assert isinstance(node.controller.scripts.hold(), str)
        try:
            return order(*what)
        except RefusedError as error:
            refused.append(error.reason.code)
            raise

    node.order = stopped_meanwhile
    called.move_l(to_mm=[0, 100, 60], **QUICK)
    called.dwell(0.5)
    with pytest.raises(
        scripting.ScriptError, match='an operator has stopped the robot, which no longer follows its belt'
    ) as stopped:
        called.wait()
    assert refused == [Code.BELT]
    assert block.__exit__(type(stopped.value), stopped.value, None) is False
    node.ask('leave')
    node.goes_on()
    assert node.stands(300)
    assert node.controller.task.tracking.free


def test_script_that_catches_the_stop_of_an_operator_takes_no_more_actions_on_the_belt(node, called):
    block = gets_on(called)
    called.wait_time(0.1)
    assert isinstance(node.controller.scripts.hold(), str)
    with pytest.raises(scripting.ScriptError, match='no longer follows its belt') as stopped:
        called.wait_time(0.1)
    assert stopped.value.code is Code.BELT
    with pytest.raises(scripting.ScriptError, match='the robot is not held'):
        called.resume()
    called.wait_time(0.2)
    assert node.stands(50)
    called.move_l(to_mm=[0, 0, 20], **QUICK)
    with pytest.raises(scripting.ScriptError, match='no longer moves with its belt') as refused:
        called.wait()
    assert block.__exit__(type(refused.value), refused.value, None) is False
    called.move_l(to_mm=[0, 0, -800])  # beside the belt it works
    called.wait()
    assert called.position() == pytest.approx((0.0, 0.0, -0.8), abs=1e-4)


def test_script_without_control_raises_an_error_in_its_block(node, called):
    block = gets_on(called)
    node.controller.control.release(node.identity)
    node.controller.poll(1.0)
    with pytest.raises(scripting.ScriptError, match='the script no longer has control of the robot') as lost:
        called.wait_time(0.1)
    assert block.__exit__(type(lost.value), lost.value, None) is False
    assert lost.value.code is Code.CONTROL


def test_a_script_that_gives_up_while_an_operator_holds_gives_up_again(node, called):
    block = gets_on(called)
    called.dwell(0.8)
    called.wait_time(0.1)
    asked = []

    def held_meanwhile(cycle):
        asked.append(cycle)
        if len(asked) == 1:
            node.post(CANCEL, str(cycle))
            assert isinstance(node.controller.scripts.hold(), str)
            assert node.controller.gate.hold_cycle == NEVER
            raise RefusedError(node.replies[-1][0])
        del node.instead[CANCEL]
        return node.request(CANCEL, cycle)

    node.instead[CANCEL] = held_meanwhile
    assert block.__exit__(ValueError, ValueError('enough'), None) is False
    assert len(asked) == 2
    assert node.stands()
    assert node.controller.task.tracking.free
    called.move_l(to_mm=[0, 0, -800])
    called.wait()
    assert called.position() == pytest.approx((0.0, 0.0, -0.8), abs=1e-4)


def test_late_command_leaves_no_state(node, called, monkeypatch):
    monkeypatch.setattr(ConnectedLink, 'extra_cycles', 30)  # as with a clock
    order = node.order

    def too_late(*_, **__):
        raise RefusedError(Reason(Code.LATE, 'too late'))

    with called.track('line', timeout_s=5.0, **QUICK):
        called.move_l(to_mm=[0, 0, 60], **QUICK)
        node.order = too_late
        with pytest.raises(scripting.ScriptError, match='too late'):
            called.wait()
        node.order = order
        called.move_l(to_mm=[0, 0, 40], **QUICK)
        called.wait()
        assert not node.stands()


def test_belt_events_before_a_script_do_not_affect_it(node, called, robot):
    tracking = node.controller.task.tracking
    tracking.observe(tracking.observed.cycle + 1, [BeltReading(10**6)])
    pick(called)
    called.finish()
    node.ask('leave')
    node.goes_on(4000)
    assert len(tracking.parts[0]) == 2
    node.controller.control.take(Operator(node.identity, 'another script'), False, 2.0)
    another = BeltRobot(ConnectedLink(node, robot), 'another')
    assert tracking.observed.jumps[0] > 0
    assert another.belt('line').jumps == 0
    assert another.belt('line').waiting == 0


def test_silent_belts_are_named(node, called):
    gets_on(called)
    node.ask('leave')
    cycles = node.controller.cycles
    cycles.take_belts = lambda *_: None
    node.goes_on(20)
    for n in range(50):
        node.controller.poll(0.2 * n)
    assert str(node.controller.state.fault).startswith('no AT of the belts for')
    assert not node.controller.bus.cyclic
    assert node.controller.task.tracking.free


def changed(**values):
    return json.dumps(ORDER.to_document() | values)


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('null', 'get on: an order is needed'),
        ('{}', 'get on: an order is needed'),
        (changed(part_m='far'), 'get on: an order is needed'),
        (changed(part_m=math.nan), 'get on: an order is needed'),
        (changed(window_m=[0.1]), 'get on: an order is needed'),
        (changed(limits=[4.0, -40.0, 4000.0, 2.0]), 'get on: an order is needed'),
        (changed(belt=math.inf), 'get on: an order is needed'),
        (changed(belt=0.5), 'get on: an order is needed'),
        (changed(belt=10**400), 'the robot cannot work on belt number 1000'),
        (changed(part_m=10**400), 'get on: an order is needed'),
        (changed(limits=[4.0, 1e300, 4000.0, 2.0]), 'get on: an order is needed'),
        (changed(limits=[4.0, 40.0, 1e-12, 2.0]), 'get on: an order is needed'),
        (changed(more=1), 'get on: an order is needed'),
        (changed(belt=1), 'the robot cannot work on belt number 1, of 1'),
        (changed(belt=-1), 'the robot cannot work on belt number -1, of 1'),
    ],
)
def test_invalid_command_is_rejected(node, called, text, sentence):
    reason, _ = node.ask(TRACK, text)
    assert reason.code is Code.CONTENT
    assert sentence in str(reason)


def test_robot_without_a_belt_does_not_synchronize_again(node, called):
    reason, _ = node.ask(TRACK_AGAIN, '5000')
    assert (reason.code, str(reason)) == (Code.STATE, 'the robot is on no belt')
