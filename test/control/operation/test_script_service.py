"""Tests of requests of a script to the controller: permission, replies and end of the script."""

import json

import numpy as np
import pytest

from delta3_pacdrive import scripting
from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.control.operation.control import Operator
from delta3_pacdrive.control.operation.script_gate import GateEvent, GateState
from delta3_pacdrive.control.operation.script_operations import ATTACH, END, HOLD, POLL, WAIT
from delta3_pacdrive.control.operation.wait_condition import WaitCondition
from delta3_pacdrive.errors import Code, RefusedError, ScriptError
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.robot.sercos.configuration_check import Identity
from delta3_pacdrive.scripting.connected_link import ConnectedLink, connected
from delta3_pacdrive.scripting.robot import Robot
from script_bus import ServedNode

SLOWLY = {'to_mm': [150, 0, -800], 'speed_m_s': 0.1}


@pytest.fixture
def node(robot):
    return ServedNode(robot)


@pytest.fixture
def called(node, robot):
    return Robot(ConnectedLink(node, robot), 'script')


def drive(called):
    """Moves that follow, an output, a hold, an override, a resume, and a wait for the robot."""
    called.move_l(to_mm=[100, 0, -800], blend_mm=20)
    called.wait_time(0.02)
    called.move_l(to_mm=[0, 100, -800])
    called.output('gripper', True, payload_kg=0.3)
    called.wait_time(0.1)
    called.hold()
    called.wait_time(0.3)
    called.override(50)
    called.resume()
    called.wait()
    called.move_l(to_mm=[0, 0, -780], in_position=True)


def moving(node, called):
    """Let a script move the robot, and be at a wait."""
    called.move_l(**SLOWLY)
    called.wait_time(0.1)
    assert node.controller.state.motion is MotionState.MOVING
    node.post(WAIT, WaitCondition(10**6, 10**6).to_json())
    for _ in range(20):
        node.bus.exchange()
    assert node.replies == []
    return called


def test_script_with_queries_has_the_bits_of_the_simulation(robot, node, called):
    with scripting.simulate(robot) as simulated:
        drive(simulated)
    trace = simulated.trace
    drive(called)
    called.finish()
    cycles = min(len(node.bus.commands), len(trace.time_s))
    assert cycles > len(trace.time_s) - 10
    assert np.array_equal(np.array(node.bus.commands[:cycles]), trace['motor_command'][:cycles])
    assert np.array_equal(np.array(node.bus.answers[:cycles]), trace['motor_position'][:cycles])
    assert (called.late, called.late_cycles) == (0, 0)


def test_script_without_control_makes_no_decisions(node):
    reason, _ = node.ask(ATTACH, operator='0011223344556677')
    assert (reason.code, node.controller.scripts.operator) == (Code.CONTROL, '')
    node.controller.control.release(node.identity)
    reason, _ = node.ask(ATTACH)
    assert reason.code is Code.CONTROL


@pytest.mark.parametrize('action', [POLL, WAIT, HOLD, END])
def test_client_requests_nothing_before_its_begin(node, action):
    reason, _ = node.ask(action)
    assert reason.code is Code.STATE


def test_an_action_that_there_is_not_is_rejected(node, called):
    reason, _ = node.ask('explode')
    assert str(reason) == "a script cannot request 'explode'"


@pytest.mark.parametrize(
    'text', ['', 'null', '[]', '{}', '{"first": 1}', WaitCondition(0, 10**30).to_json(),
             WaitCondition(0, 5).to_json().replace('5', '5.5'),
             WaitCondition(0, 5).to_json().replace('false', '0')],
)  # fmt: skip
def test_invalid_condition_is_rejected_and_the_bus_keeps_waiting(node, called, text):
    reason, _ = node.ask(WAIT, text)
    assert reason.code is Code.CONTENT
    assert node.controller.gate.state is GateState.WAITING


@pytest.mark.parametrize('text', ['', '-1', '1.5', 'soon', '9' * 20])
def test_a_hold_at_no_bus_cycle_is_rejected(node, called, text):
    reason, _ = node.ask(HOLD, text)
    assert (reason.code, str(reason)) == (Code.CONTENT, f'hold: a bus cycle is needed, not {text!r}')


def test_waiting_script_receives_signs_of_life(node, called):
    moving(node, called)
    node.controller.control.receive_heartbeat(node.identity, 1, 1.0)
    node.controller.poll(1.0)
    assert node.replies == [(None, '', False)]


def test_a_script_that_has_lost_control_leaves_the_robot_in_a_stop_on_its_path(node, called):
    moving(node, called)
    node.controller.control.take(Operator('0011223344556677', 'somebody else'), True, 1.0)
    node.controller.poll(1.0)
    assert node.controller.state.motion is MotionState.STOPPING
    assert node.controller.gate.state is GateState.FREE
    assert node.replies[-1][0].code is Code.CONTROL
    for _ in range(2000):
        node.bus.exchange()
    assert node.controller.state.motion is MotionState.STOPPED
    assert node.bus.commands[-1] == node.bus.commands[-2]


def test_script_lost_during_its_turn_lets_the_bus_continue_to_the_stop(node, called):
    called.move_l(**SLOWLY)
    called.wait_time(0.1)
    assert node.controller.gate.closed
    node.controller.control.release(node.identity)
    node.controller.poll(1.0)
    for _ in range(2000):
        node.bus.exchange()
    assert node.controller.state.motion is MotionState.STOPPED


def test_a_hold_from_outside_ends_the_wait_and_the_script_may_resume(node, called):
    called.move_l(**SLOWLY)
    called.wait_time(0.1)
    held_at = node.bus.commands
    node.post(WAIT, WaitCondition(10**6, 10**6).to_json())
    assert isinstance(node.controller.scripts.hold(), str)
    reason, _, _ = node.replies[-1]
    assert (reason.code, str(reason)) == (
        Code.STATE, 'an operator has stopped the robot on its path: resume() continues',
    )  # fmt: skip
    assert len(held_at) > 0


def test_external_hold_during_a_decision_ends_the_next_wait_immediately(node, called):
    called.move_l(**SLOWLY)
    called.wait_time(0.1)
    assert isinstance(node.controller.scripts.hold(), str)
    with pytest.raises(ScriptError, match='an operator has stopped the robot on its path'):
        called.wait()
    called.resume()
    called.wait()
    assert called.position()[0] == pytest.approx(0.15, abs=1e-4)


def test_script_held_by_another_client_during_a_wait_follows_and_resumes(robot, node, called):
    called.move_l(**SLOWLY)
    called.wait_time(0.1)

    def held(condition):
        del node.instead[WAIT]
        node.post(WAIT, condition.to_json())
        node.controller.scripts.hold()
        raise RefusedError(node.replies[-1][0])

    node.instead[WAIT] = held
    with pytest.raises(ScriptError, match='an operator has stopped the robot on its path'):
        called.wait()
    called.resume()
    called.wait()
    assert called.position()[0] == pytest.approx(0.15, abs=1e-4)


def test_an_abort_from_outside_ends_the_script(node, called):
    moving(node, called)
    node.controller.scripts.abort()
    assert node.replies[-1][0].code is Code.WITHDRAWN
    with pytest.raises(ScriptError) as refused:
        called.wait_time(0.1)
    assert refused.value.code is Code.STATE


def test_abort_rejected_at_rest_leaves_the_script_waiting(node, called):
    called.wait_time(0.1)
    node.post(WAIT, WaitCondition(10**6, 10**6).to_json())
    assert node.controller.scripts.abort().code is Code.STATE
    assert node.controller.scripts.operator == node.identity
    assert node.replies == []


def test_fault_ends_a_wait_with_its_message(node, called):
    moving(node, called)
    node.controller.state.emergency_stop()
    node.controller.poll(1.0)
    reason, _, done = node.replies[-1]
    assert (reason.code, done) == (Code.FAULT, True)
    with pytest.raises(ScriptError, match='emergency stop') as refused:
        called.wait_time(0.1)
    assert refused.value.code is Code.FAULT


def test_script_that_repeats_a_request_waits_for_the_newest_only(node, called):
    moving(node, called)
    cycle = node.bus.controller.gate.cycle
    reason, _ = node.ask(WAIT, WaitCondition(0, cycle + 200).to_json())
    assert reason is None


def test_a_script_does_not_begin_on_a_robot_that_is_held(node, called):
    called.move_l(**SLOWLY)
    called.wait_time(0.1)
    called.abort()
    node.ask(END)
    reason, _ = node.ask(ATTACH)
    assert reason.code is Code.STATE
    assert str(reason).endswith(': delta3 move abort ends its program')


def test_held_program_of_the_planner_can_be_resumed_before_a_script_begins(robot, node, called):
    called.move_l(**SLOWLY)
    called.wait_time(0.1)
    called.abort()
    node.ask(END)
    node.controller.planners.receive_announcement(node.identity, Identity.of(robot))  # it was the planner's
    node.controller.orders.receive_heartbeat(node.identity, node.bus.session, 1, 0.0)
    reason, _ = node.ask(ATTACH)
    assert str(reason).endswith('delta3 move abort ends its program, delta3 move resume continues it')


def test_an_order_of_a_script_does_not_look_like_one_of_the_planner(node, called):
    called.move_l(**SLOWLY)
    called.wait_time(0.1)
    assert node.controller.orders.status('CP4', 0).order == 0


def test_an_order_of_a_script_that_has_left_does_not_look_like_one_of_the_planner_either(node, called):
    called.move_l(to_mm=[0, 0, -790])
    called.finish()
    node.ask(END)
    assert node.controller.orders.status('CP4', 0).order == 0


class InterruptedNode(ServedNode):
    """A client that is interrupted while it waits for the verdict on its first order."""

    progress = MotionProgress()
    stopped = False

    def wait_until(self, condition, what):
        assert condition(), what

    def parameters(self):
        return self.bus.parameters

    def take_control(self, name, take_over):
        """Have it."""

    def stop_robot(self):
        self.controller.control.release(self.identity)
        self.controller.poll(1.0)

    def end(self):
        self.ask(END)
        self.stop_robot()

    def order(self, *order):
        super().order(*order)
        raise KeyboardInterrupt


def test_script_interrupted_before_its_reply_leaves_the_robot_held(robot):
    node = InterruptedNode(robot)

    def main():
        with connected(node, 'test') as called:
            called.move_l(**SLOWLY)
            called.wait()

    with pytest.raises(KeyboardInterrupt):
        main()
    for _ in range(2000):
        node.bus.exchange()
    assert node.controller.state.motion is MotionState.STOPPED


def test_a_script_that_is_announced_begins_in_its_bus_cycle(robot):
    node = ServedNode(robot)
    gate = node.controller.gate
    gate.handle(GateEvent.END)
    gate.begins = node.controller.answered + 50
    first = gate.begins
    reason, _ = node.ask(ATTACH)
    assert reason.code is Code.LATE
    for _ in range(100):
        node.bus.exchange()
    facts = json.loads(node.request(ATTACH))
    assert facts['seen']['cycle'] == first
    assert gate.begins > 10**15


def test_planner_first_received_during_a_script_changes_nothing(robot, node, called):
    called.move_l(**SLOWLY)
    called.wait_time(0.1)
    orders, planners = node.controller.orders, node.controller.planners
    planners.receive_announcement('a-planner', Identity.of(robot))
    assert orders.receive_heartbeat('a-planner', node.bus.session, 1, 0.0)
    called.move_l(to_mm=[150, 50, -800])
    called.wait_time(0.1)
    assert node.controller.state.motion is MotionState.MOVING


def answered_while_the_bus_waits(node, called):
    """Let a script begin while as many cycles are outstanding as may be, and the drives answer all of them."""
    node.ask(END)
    for _ in range(20):
        node.bus.exchange()
    node.controller.cycles.start_due()
    node.post(ATTACH)
    while node.bus.exchange():
        pass
    assert node.controller.next_cycle - node.controller.answered == node.bus.most_outstanding
    return node.controller.answered


def test_ended_script_lets_the_bus_continue_with_later_replies(node, called):
    before = answered_while_the_bus_waits(node, called)
    node.ask(END)
    for _ in range(50):
        node.bus.exchange()
    assert node.controller.answered > before + 40


def test_lost_script_lets_the_bus_continue_with_later_replies(node, called):
    before = answered_while_the_bus_waits(node, called)
    node.controller.control.release(node.identity)
    node.controller.poll(1.0)
    for _ in range(50):
        node.bus.exchange()
    assert node.controller.answered > before + 40
