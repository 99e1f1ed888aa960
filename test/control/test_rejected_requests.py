"""Rejected, withdrawn and lost requests and failed commands change no state."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from delta3_pacdrive.cli import move
from delta3_pacdrive.control.actions import Entered, Ordered
from delta3_pacdrive.control.messages import Request
from delta3_pacdrive.control.queue.planning_job import Job
from delta3_pacdrive.errors import Code, Reason, RefusedError, RunError
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.ros.clients import robot_client

NEAR = 'moves: [{move_l: {to_m: [0.02, 0.0, -0.76], speed_m_s: 0.2}}]'
STEP = 'moves: [{move_l: {to_m: {by_m: [0.0, 0.02, 0.0]}, speed_m_s: 0.2}}]'
FAR = 'moves: [{move_l: {to_m: [0.0, 0.0, -0.2]}}]'
PLANNER, OWN, OTHER = 'a1b2c3d4', 'operator', 'other'
TRAJECTORY = json.dumps({'stamp_s': 0.001, 'points': [{'time_s': 0.002, 'angles_rad': [0.1, 0.1, 0.1]}]})
STATES = ('disabled', 'error', 'idle', 'moving', 'stopped', 'controlled')


def put_into(rig: Any, state: str) -> None:
    """Bring a robot with a move in its queue into a state, as far as there can be one."""
    if state in ('moving', 'stopped', 'error'):
        rig.lead_to(state)
        rig.ask('override', '50')
        return
    assert rig.ask('override', '50')[0]
    if state != 'disabled':
        rig.enable()
    assert rig.ask('program', NEAR)[0]
    if state == 'controlled':
        assert rig.take_control(OTHER) is None
        rig.beating = OTHER


def known(rig: Any) -> tuple[Any, ...]:
    """Return the state that a failed request must not change: queue, override, motion, drives, control."""
    planner, state, task = rig.planner, rig.state, rig.task
    timeline = task.timeline if task.loaded else None
    holder = rig.control.operator.identity if rig.control.operator else ''
    motion = 'stopped' if state.motion == 'stopping' else str(state.motion)
    return (
        planner.queue[0],
        planner.override,
        motion,
        id(timeline),
        task.held,
        str(state.fault),
        state.enabled,
        holder,
    )


# requests -------------------------------------------------------------------------------------------------------------

REFUSED = {
    ('program', FAR): STATES,
    ('program', '][') : STATES,
    ('program', NEAR): ('moving', 'stopped', 'controlled', 'error'),
    ('move', FAR): STATES,
    ('move', NEAR): ('disabled', 'error', 'controlled'),
    ('start', FAR): STATES,
    ('start', STEP): ('disabled', 'error', 'moving', 'stopped', 'controlled'),
    ('start', ''): ('disabled', 'error', 'moving', 'stopped', 'controlled'),
    ('resume', ''): ('disabled', 'error', 'idle', 'moving', 'controlled'),
    ('override', '0'): STATES,
    ('override', 'fast'): STATES,
    ('override', '70'): ('controlled',),
    ('clear', ''): ('controlled',),
    ('trajectory', TRAJECTORY): STATES,
    ('trajectory', '{'): STATES,
    ('jump', ''): STATES,
}  # fmt: skip


@pytest.mark.parametrize('state', STATES)
def test_a_request_that_is_rejected_changes_neither_queue_nor_robot(
    state: str, new_rig: Callable[[], Any]
) -> None:
    rig = new_rig()
    put_into(rig, state)
    before, tcp = known(rig), rig.task.state['tcp'][0].copy()
    for (action, text), states in REFUSED.items():
        if state not in states:
            continue
        accepted, sentence = rig.ask(action, text, OWN)
        assert not accepted, (action, text, sentence)
        assert sentence
        if state == 'moving' and rig.state.motion != 'moving':
            break  # it came to its end meanwhile
        assert known(rig) == before, (action, text, sentence)
    if state != 'moving':
        rig.run(200)
        assert np.array_equal(rig.task.state['tcp'][0], tcp)


def test_a_program_that_cannot_start_is_not_in_the_queue_and_never_driven(new_rig: Callable[[], Any]) -> None:
    rig = new_rig()
    accepted, sentence = rig.ask('start', NEAR, OWN)
    assert (accepted, rig.planner.queue) == (False, (0, 0.0)), sentence
    rig.enable()
    assert rig.ask('start', STEP, OWN)[0]
    rig.finish()
    assert rig.task.state['tcp'][0] == pytest.approx([0.0, 0.02, -0.75], abs=1e-9)


def test_program_starts_after_the_queue(new_rig: Callable[[], Any]) -> None:
    rig = new_rig()
    rig.enable()
    assert rig.ask('program', NEAR, OWN)[0]
    accepted, sentence = rig.ask('start', STEP, OWN)
    assert accepted
    assert sentence.startswith('started "program": 2 moves')
    rig.finish()
    assert rig.task.state['tcp'][0] == pytest.approx([0.02, 0.02, -0.76], abs=1e-9)
    assert rig.planner.queue == (0, 0.0)


@pytest.mark.parametrize('override', ['100', '30'])
def test_messages_name_an_override_other_than_100_percent(override: str, new_rig: Callable[[], Any]) -> None:
    rig = new_rig()
    rig.enable()
    at = '' if override == '100' else ' at 30 %'
    assert rig.ask('override', override)[0]
    planned, started = rig.ask('program', NEAR)[1], rig.ask('start')[1]
    assert planned.endswith(f' s{at}')
    assert started.endswith(f' s{at}')
    assert planned.rpartition(': ')[2] == started.rpartition(': ')[2]  # the same time
    rig.run(30)
    assert f' s to go{at}' in rig.ask('move', STEP)[1]
    rig.do('hold')
    rig.run(400)
    assert 's to go' not in rig.ask('move', STEP)[1]  # it depends on the way to go on
    assert rig.ask('resume')[1] == f'resumed{at}'


# withdrawals ----------------------------------------------------------------------------------------------------------

STAGES = ('waiting', 'planning', 'ordered')


class Withdrawn:
    """A request that is withdrawn at a stage of its way."""

    def __init__(self, rig: Any, action: str, text: str, stage: str) -> None:
        self.rig = rig
        carry_out, stages = rig.carry_out_of_planner, [stage]

        def carried_out(step: Any) -> None:
            now = {Job: 'planning', Ordered: 'ordered'}.get(type(step))
            if stages and now == stages[0]:
                stages.clear()
                self.withdraw()
            elif stages == ['waiting'] and now == 'planning':  # another one is planned
                stages.clear()
                self.ask(action, text)
                self.withdraw()
            carry_out(step)

        rig.carry_out_of_planner = carried_out
        if stage == 'waiting':
            rig.asked += 1
            rig.planner.ask(Request(PLANNER, OWN, rig.asked, 0, 'program', STEP), rig.now_s)
            rig.settle()
        else:
            self.ask(action, text)
        rig.run(5)

    def ask(self, action: str, text: str) -> None:
        self.rig.planner.ask(Request(PLANNER, OWN, 101, 0, action, text), self.rig.now_s)
        self.rig.settle()

    def withdraw(self) -> None:
        self.rig.planner.ask(Request(PLANNER, OWN, 102, 0, 'withdraw', '101'), self.rig.now_s)

    @property
    def answers(self) -> dict[int, tuple[bool, str]]:
        return {number: (ok, text) for who, number, ok, text in self.rig.answers if who == OWN}


@pytest.mark.parametrize('stage', STAGES)
@pytest.mark.parametrize(
    ('action', 'text'), [('program', NEAR), ('move', NEAR), ('start', NEAR), ('start', '')]
)
def test_cancelled_request_leaves_no_state(
    action: str, text: str, stage: str, new_rig: Callable[[], Any]
) -> None:
    if (action, stage) == ('program', 'ordered') or (text == '' and stage == 'planning'):
        pytest.skip('there is no such stage')
    rig = new_rig()
    rig.enable()
    if not text:
        assert rig.ask('program', NEAR)[0]
    queue = rig.planner.queue[0]
    asked = Withdrawn(rig, action, text, stage)
    assert asked.answers[101] == (False, 'withdrawn by its operator')
    accepted, sentence = asked.answers[102]
    assert accepted
    assert sentence.startswith('withdrawn')
    assert rig.planner.queue[0] == queue + (stage == 'waiting')
    rig.run(100)
    assert rig.state.motion == 'idle'
    assert rig.task.state['tcp'][0] == pytest.approx(rig.robot.motion.home_m, abs=1e-9)


def withdraw(rig: Any, number: int) -> tuple[bool, str]:
    rig.asked += 1
    rig.planner.ask(Request(PLANNER, OWN, rig.asked, 0, 'withdraw', str(number)), rig.now_s)
    rig.settle()
    return next((ok, text) for *who, ok, text in rig.answers if who == [OWN, rig.asked])


def test_moves_that_were_queued_are_removed_by_a_withdrawal(new_rig: Callable[[], Any]) -> None:
    rig = new_rig()
    rig.enable()
    assert rig.ask('program', NEAR)[0]
    before = rig.planner.queue
    assert rig.ask('program', STEP, OWN)[0]
    assert withdraw(rig, rig.asked) == (True, 'its moves were removed from the queue')
    rig.run(5)
    assert rig.planner.queue == before  # planned anew
    assert [report.state for report in rig.reports][-1] == 'aborted'
    assert rig.ask('start')[0]
    rig.finish()
    assert rig.task.state['tcp'][0] == pytest.approx([0.02, 0.0, -0.76], abs=1e-9)


def test_the_only_moves_in_the_queue_are_removed_by_a_withdrawal_once(new_rig: Callable[[], Any]) -> None:
    rig = new_rig()
    assert rig.ask('program', NEAR, OWN)[0]
    number = rig.asked
    assert withdraw(rig, number)[0]
    assert rig.planner.queue == (0, 0.0)
    accepted, sentence = withdraw(rig, number)
    assert not accepted
    assert sentence.startswith('it was carried out before it could be withdrawn')


def test_moves_with_successors_cannot_be_cancelled_and_the_reply_reports_it(
    new_rig: Callable[[], Any],
) -> None:
    rig = new_rig()
    assert rig.ask('program', NEAR, OWN)[0]
    number = rig.asked
    assert rig.ask('program', STEP)[0]
    before = rig.planner.queue
    assert withdraw(rig, number) == (
        False,
        'it cannot be withdrawn: moves that were queued later follow its own',
    )
    assert rig.planner.queue == before


@pytest.mark.parametrize(
    ('action', 'text'), [('start', ''), ('start', STEP), ('move', STEP), ('override', '70')]
)
def test_executed_request_cannot_be_cancelled_and_the_reply_reports_it(
    action: str, text: str, new_rig: Callable[[], Any]
) -> None:
    rig = new_rig()
    rig.enable()
    assert rig.ask('program', NEAR)[0]
    accepted, done = rig.ask(action, text, OWN)
    assert accepted
    assert withdraw(rig, rig.asked) == (False, f'it was carried out before it could be withdrawn: {done}')


def test_a_request_that_was_never_received_is_withdrawn(new_rig: Callable[[], Any]) -> None:
    assert withdraw(new_rig(), 17) == (True, 'withdrawn')


@pytest.mark.parametrize('action', ['program', 'move', 'start'])
@pytest.mark.parametrize('stage', STAGES)
def test_an_operator_that_loses_control_leaves_no_moves(
    action: str, stage: str, new_rig: Callable[[], Any]
) -> None:
    """A client that is killed is not heard any more; another one takes control."""
    if (action, stage) == ('program', 'ordered'):
        pytest.skip('there is no such stage')
    rig = new_rig()
    rig.enable()
    rig.take_control(OWN)

    class Killed(Withdrawn):
        def withdraw(self) -> None:
            self.rig.take_control(OTHER, by_force=True)

    assert Killed(rig, action, NEAR, stage).answers[101] == (False, 'its operator has lost control')
    rig.run(100)
    assert rig.planner.queue == (0, 0.0)
    assert rig.state.motion == 'idle'
    assert rig.task.state['tcp'][0] == pytest.approx(rig.robot.motion.home_m, abs=1e-9)


# commands -------------------------------------------------------------------------------------------------------------


class RigOperator:
    """An operator of a robot without ROS, as ``delta3 move`` knows one."""

    def __init__(self, rig: Any) -> None:
        self.rig, self.in_control, self.interruptible = rig, False, True
        self.progress_s = float('inf')
        self.queue = None

    @property
    def state(self) -> str:
        return str(self.rig.planner.motion)

    @property
    def state_changes(self) -> int:
        return sum(isinstance(one, Entered) for one in self.rig.said)

    @property
    def progress(self) -> MotionProgress:
        return MotionProgress(fault=str(self.rig.state.fault or ''))

    def wait_until(self, condition: Callable[[], Any], what: str) -> None:
        for _ in range(400):
            if condition():
                return
            self.rig.run(5)
        raise RunError(f'no {what}')

    def spin_for(self, _: float) -> None:
        self.rig.run(5)

    def take_control(self, name: str, by_force: bool) -> str:
        reason = self.rig.take_control(OWN, by_force)
        if reason is not None:
            raise RefusedError(reason)
        self.in_control, self.rig.beating = True, OWN
        return f'{name} has control'

    def release_control(self) -> None:
        if self.in_control:
            self.in_control = False
            self.rig.control.release(OWN)
            self.rig.tell()

    def _outcome(self, accepted: bool, sentence: str) -> str:
        if not accepted:
            raise RefusedError(Reason(Code.STATE, sentence))
        return sentence

    def call(self, name: str) -> str:
        of_task = name in (*move.STOPS, 'enable', 'reset')
        return self._outcome(*(self.rig.do(name) if of_task else self.rig.ask(name, '', OWN)))

    def override(self, percent: float) -> str:
        return self._outcome(*self.rig.ask('override', repr(percent), OWN))

    def send_program(self, text: str, _: Any) -> str:
        return self._outcome(*self.rig.ask('program', text, OWN))

    def start_program(self, text: str, _: Any) -> str:
        return self._outcome(*self.rig.ask('start', text, OWN))

    def move(self, text: str, _: Any) -> str:
        return self._outcome(*self.rig.ask('move', text, OWN))


FAILING = (
    'l 0.2 0 -0.8', 'l 0 0 -0.2', 'l 0 0 -0.2 --queue', 'l 0 0', 'l 0 0 -0.75 --blend -1', 'l 0.2 0 -0.8 --speed 0',
    'c 0.1 0 -0.8 0.2 0 -0.8', 'sb 0.1 0 -0.8 9 9 9', 'program no_such_program', 'program experiment1', 'start',
    'hold', 'resume', 'abort', 'override 0', 'override 151', 'override fast', 'reset', 'enable', 'start --queue',
    'l 0.02 0 -0.76 --queue', 'clear 1', 'jump',
)  # fmt: skip


@pytest.mark.parametrize('state', STATES)
def test_a_command_that_fails_leaves_queue_and_robot_as_they_were(
    state: str, new_rig: Callable[[], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = new_rig()
    put_into(rig, state)

    @contextmanager
    def operating(_: str) -> Iterator[RigOperator]:
        yield RigOperator(rig)

    monkeypatch.setattr(robot_client, 'operating', operating)
    failed = 0
    for line in FAILING:
        before = known(rig)
        try:
            status = move.main(line.split())
        except SystemExit as end:
            status = int(end.code or 0)
        if status == 0:  # what succeeds may change all of it
            rig = new_rig()
            put_into(rig, state)
            continue
        failed += 1
        assert known(rig) == before or (state == 'moving' and rig.state.motion == 'idle'), line
    assert failed >= 10


def test_a_move_that_was_rejected_is_not_driven_by_the_next_command(
    rig: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    @contextmanager
    def operating(_: str) -> Iterator[RigOperator]:
        yield RigOperator(rig)

    monkeypatch.setattr(robot_client, 'operating', operating)
    path: list[np.ndarray] = []
    command = rig.task.command
    rig.task.command = lambda cycle: (command(cycle), path.append(rig.task.state['tcp'][0].copy()))[0]
    lines = ('disable', 'l 0.2 0 -0.8', 'enable', 'l 0 0.05 -0.82', 'l 0.2 0 -0.8 --queue')
    assert [move.main(line.split()) for line in lines] == [0, 1, 0, 0, 0]
    assert path[-1] == pytest.approx([0.0, 0.05, -0.82], abs=1e-9)
    assert np.abs(np.array(path)[:, 0]).max() < 1e-9
    assert 'already stands' not in capsys.readouterr().err


def test_taking_control_reports_the_removed_moves(
    rig: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    @contextmanager
    def operating(_: str) -> Iterator[RigOperator]:
        yield RigOperator(rig)

    monkeypatch.setattr(robot_client, 'operating', operating)
    put_into(rig, 'controlled')
    assert move.main(['l', '0', '0', '-0.2', '--take-over']) == 1
    assert rig.planner.queue == (0, 0.0)
    assert 'the queued moves of the other operator are removed' in capsys.readouterr().out
