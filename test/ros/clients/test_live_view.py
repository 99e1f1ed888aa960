"""Tests of the live page without robot and browser: requests to the robot, and failures."""

from collections import deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from delta3_pacdrive.errors import Code, Reason, RefusedError, RunError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.ros import present_robot
from delta3_pacdrive.ros.clients import live_view
from delta3_pacdrive.ros.clients import page_commands as page_wishes
from delta3_pacdrive.ros.clients.live_view import LiveView
from delta3_pacdrive.view.values import Facts, UiCommand

OVER_S = 600.0  # long after every fact here
STEP_S = 0.01  # of the clock
TOLD_STEPS, ON_ITS_WAY_STEPS = 10, 10  # how often the robot tells how it is, and how long that takes
PATIENCE_S = 10.0  # of an operator who waits for an answer
RELEASED_S = 0.4  # after which a button that was let go has stopped the robot, answers in time


class Cell:
    """A robot, its operator, a page and the spinning process: a clock runs, and planned events happen.

    Attributes
    ----------
    asked
        Requests to the robot, with their times.
    takes_s
        Time until the reply of the robot; ``inf``: no reply.
    brakes_s
        Time until it is at rest.
    refuses
        Requests that it rejects.

    """

    def __init__(self, parameters: Parameters) -> None:
        self.now, self.due, self.held = 0.0, deque[tuple[float, Callable[[], None]]](), ''
        self.asked: list[tuple[str, float]] = []
        self.velocities_sent: list[tuple[float, tuple[float, float, float]]] = []
        self.takes_s: dict[str, list[float]] = {}
        self.refuses: set[str] = set()
        self.brakes_s = 0.0
        self.late: set[str] = set()  # what happens only when it is about to be answered
        self.told: list[tuple[str, bool]] = []
        self.slider = 0  # how often it was put back
        # the page
        self.commands: deque[UiCommand] = deque()
        self.watched, self.controls = True, SimpleNamespace(show_override=self._put_back)
        # the robot, and what is known of it
        self.operator, self.parameters, self.available = self, parameters, True
        self.planned = SimpleNamespace(points_m=np.empty((0, 3)), changes=0)
        self.cell = SimpleNamespace(now=SimpleNamespace(things=(), changes=0))
        self.stood: list[Any] = []  # what the page was told to draw around the robot
        self.state, self.in_control, self.queue = 'idle', False, SimpleNamespace(moves=0)
        self.progress_s, self.rejoins, self.publishers, self.silent = 0.0, False, 1, False
        self.states = deque([self.state], ON_ITS_WAY_STEPS)
        self._publish_progress()
        self.view = LiveView(self, self, self)

    def _put_back(self) -> None:
        self.slider += 1

    def at(self, time_s: float, does: Callable[[], None]) -> None:
        self.due.append((time_s, does))

    def click(self, time_s: float, action: str, text: str = '') -> None:
        self.at(time_s, lambda: self.commands.append(UiCommand(action, text, time_s=time_s)))

    def hold(self, start_s: float, end_s: float, direction: str = '+x') -> None:
        self.at(start_s, lambda: setattr(self, 'held', direction))
        self.at(end_s, lambda: setattr(self, 'held', ''))

    def run(self, seconds: float) -> None:
        """Let the view run; it ends as with Ctrl-C."""
        self.at(seconds, self.view.stop)
        self.view.run(1.0)

    def times(self, action: str) -> list[float]:
        return [time_s for name, time_s in self.asked if name == action]

    # process

    def spin_for(self, seconds: float) -> None:
        for _ in range(max(1, round(seconds / STEP_S))):
            self.now += STEP_S
            self.states.append(self.state)
            if round(self.now / STEP_S) % TOLD_STEPS == 0:
                self._publish_progress()
            assert self.now < OVER_S, 'the view does not end'
            for planned in [item for item in self.due if item[0] <= self.now]:
                self.due.remove(planned)
                planned[1]()
            if self.held:
                self.commands.append(UiCommand('press', f'{self.held} 50', time_s=self.now))

    def rejoin(self) -> None:
        self.rejoins = True

    # page

    def report(self, sentence: str, refused: bool = False) -> None:
        self.told.append((sentence, refused))

    report_scope = report

    def show(self, _: Any) -> None:
        pass

    plan = read = use = show

    def clear_history(self) -> None:
        pass

    def show_cell(self, things: Any) -> None:
        self.stood.append(things)

    # what is known of the robot

    def count_publishers(self, _: str) -> int:
        return self.publishers

    def _publish_progress(self) -> None:
        if self.silent:
            return
        self.progress_s = self.now
        self.progress = MotionProgress(session='a', tcp_m=(0.0, 0.0, -0.75), state=self.states[0])

    def update_parameters(self) -> bool:
        return False

    def instant(self) -> None:
        return None

    def facts(self) -> Facts:
        return Facts()

    # operator

    def take_control(self, *_: Any) -> None:
        self.in_control = True

    def release_control(self) -> None:
        self.in_control = False

    def get_namespace(self) -> str:
        return '/'

    def wait_until(self, condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> None:
        end = self.now + patience_s
        while not condition():
            if self.now > end:
                raise RunError(f'no {what} within {patience_s:g} s')
            self.view.spin_for(2 * STEP_S)

    def override(self, percent: float) -> str:
        return self.call(f'override {percent:g}')

    def send_program(self, text: str) -> str:
        return self.call('program')

    def input(self, request: str) -> str:
        return self.call(f'input {request}')

    def velocities(self) -> Callable[[float, float, float], None]:
        return lambda *velocity: self.velocities_sent.append((self.now, velocity))

    def call(self, action: str, text: str = '') -> str:
        self.asked.append((action, self.now))
        queue = self.takes_s.get(action, [])
        takes_s = queue.pop(0) if queue else 2 * STEP_S
        given_up = self.now + PATIENCE_S
        answer: list[str] = []
        done_s = takes_s - STEP_S if action in self.late else min(takes_s, STEP_S)
        self.at(self.now + done_s, lambda: answer.append(self._do(action)))
        answered = self.now + takes_s
        while self.now < min(answered, given_up) or not answer:
            self.view.spin_for(2 * STEP_S)
        if self.now < answered:
            raise RunError(f'no answer to "{action}"')
        if answer[0]:
            raise RefusedError(Reason(Code.STATE, answer[0]))
        return f'{action} accepted'

    def _do(self, action: str) -> str:
        """Let the robot do something; returns why not."""
        if action in self.refuses:
            return f'{action} is refused'
        if action in ('hold', 'abort'):
            if self.state == 'idle':
                return 'the robot is idle'
            if action == 'abort' and not self.takes_s.get('deaf'):
                self.state = 'stopping'
                self.at(self.now + self.brakes_s, lambda: setattr(self, 'state', 'idle'))
            elif action == 'hold':
                self.state = 'stopped'
        elif action == 'program':
            if self.state != 'idle':
                return f'the robot is {self.state}'
            self.queue.moves += 1
        elif action == 'clear':
            self.queue.moves = 0
        elif action == 'steer':
            if self.state != 'idle':
                return f'the robot is {self.state}'
            self.state = 'steered'
        elif action == 'start':
            if self.state != 'idle' or not self.queue.moves:
                return 'there is nothing to start'
            self.state, self.queue.moves = 'moving', 0
        return ''


@pytest.fixture
def cell(robot: Parameters, monkeypatch: pytest.MonkeyPatch) -> Cell:
    made = Cell(robot)
    for module in (live_view, page_wishes, present_robot):
        monkeypatch.setattr(module, 'time', SimpleNamespace(monotonic=lambda: made.now))
    return made


def test_jog_moves_while_its_button_is_held_and_stops_on_release(cell: Cell) -> None:
    cell.hold(0.5, 2.0)
    moving = []
    cell.at(1.5, lambda: moving.append(cell.state))
    cell.run(4.0)
    assert moving == ['steered']
    times = [time_s for time_s, _ in cell.velocities_sent]
    assert {velocity for _, velocity in cell.velocities_sent} == {(0.05, 0.0, 0.0)}
    assert min(times) < 0.6
    assert max(times) < 2.0 + STEP_S
    assert max(np.diff(times)) < 0.1
    assert cell.state == 'idle'
    (stopped,) = cell.times('abort')
    assert 2.0 < stopped < 2.0 + RELEASED_S


def test_button_moves_the_robot_again_after_a_short_loss_and_standstill(cell: Cell) -> None:
    cell.brakes_s = 0.7
    cell.hold(0.5, 1.5)
    cell.hold(1.8, 6.0)  # the page was too busy to say that the button is held
    cell.run(8.0)
    first, second = cell.times('steer')
    assert 1.5 + cell.brakes_s < second < 6.0
    assert first < 1.5
    assert not [sentence for sentence, refused in cell.told if refused]
    assert len(cell.times('abort')) == 2
    assert cell.state == 'idle'


def test_state_from_before_a_stop_does_not_let_a_button_move_the_robot(cell: Cell) -> None:
    cell.brakes_s = 0.7
    cell.takes_s['steer'] = [1.0]
    cell.late.add('steer')  # it moves for an instant, which no report contains
    cell.hold(0.5, 0.8)
    cell.hold(1.3, 4.0)
    cell.run(6.0)
    assert len(cell.times('steer')) == 2
    assert not [sentence for sentence, refused in cell.told if refused and 'stopping' in sentence]


@pytest.mark.parametrize(
    ('action', 'text'), [('start', ''), ('teach', ' '), ('packaged', 'none'), ('step', 'x')]
)
def test_rejected_command_of_another_client_does_not_keep_a_jog_running(
    cell: Cell, action: str, text: str
) -> None:
    cell.hold(0.5, 3.0)
    cell.click(1.5, action, text)
    cell.run(5.0)
    assert any(refused for _, refused in cell.told)
    (stopped,) = cell.times('abort')
    assert 3.0 < stopped < 3.0 + RELEASED_S
    assert cell.state == 'idle'


def test_second_press_while_the_start_of_the_first_one_is_unanswered_is_stopped_as_well(cell: Cell) -> None:
    cell.takes_s['steer'] = [2.0]
    cell.hold(0.5, 0.6)
    cell.hold(1.5, 4.0)
    cell.run(6.0)
    stops = cell.times('abort')
    assert 0.6 < stops[0] < 0.6 + RELEASED_S
    assert 4.0 < stops[-1] < 4.0 + RELEASED_S
    assert cell.state == 'idle'


@pytest.mark.parametrize('end_s', [3.0, 30.0])
def test_jog_with_an_unanswered_start_is_stopped(cell: Cell, end_s: float) -> None:
    cell.takes_s['steer'] = [float('inf')]
    cell.hold(0.5, end_s)
    cell.run(40.0)
    asked = cell.times('steer')[0]
    assert cell.times('abort')[0] < min(end_s, asked + PATIENCE_S) + RELEASED_S
    assert cell.state == 'idle'


def test_unanswered_stop_is_reported_and_repeated_until_standstill(cell: Cell) -> None:
    cell.takes_s['abort'] = [float('inf')] * 2
    cell.takes_s['deaf'] = [1.0]
    cell.hold(0.5, 2.0)
    cell.at(15.0, lambda: cell.takes_s.pop('deaf', None))
    cell.run(60.0)
    assert len(cell.times('abort')) >= 2
    assert ('no answer to "abort"', True) in cell.told
    assert cell.state == 'idle'


def test_lost_abort_of_another_client_does_not_keep_a_jog_running(cell: Cell) -> None:
    cell.takes_s['abort'] = [float('inf')]
    cell.takes_s['deaf'] = [1.0]
    cell.hold(0.5, 2.0)
    cell.click(1.5, 'abort')
    cell.at(11.0, lambda: cell.takes_s.pop('deaf'))
    cell.run(20.0)
    assert len(cell.times('abort')) == 2
    assert cell.state == 'idle'


def test_unreachable_robot_is_queried_for_a_limited_time(cell: Cell) -> None:
    cell.takes_s['abort'] = [float('inf')] * 100
    cell.takes_s['deaf'] = [1.0]
    cell.hold(0.5, 2.0)
    cell.at(2.1, lambda: setattr(cell, 'available', False))
    cell.run(60.0)
    assert len(cell.times('abort')) == 1


def test_held_jog_is_cancelled_because_no_client_would_stop_it_on_resume(
    cell: Cell,
) -> None:
    cell.hold(0.5, 3.0)
    cell.click(1.5, 'hold')
    cell.run(4.0)
    assert cell.times('hold')[0] < cell.times('abort')[0] < 1.5 + RELEASED_S
    assert cell.state == 'idle'


def test_line_that_could_not_start_is_not_left_for_the_next_start(cell: Cell) -> None:
    cell.refuses.add('start')
    cell.click(0.5, 'step', '+x 10 50')
    cell.click(3.0, 'step', '+x 10 50')
    cell.run(5.0)
    assert len(cell.times('program')) == 2
    assert cell.queue.moves == 0


@pytest.mark.parametrize('action', ['start', 'jog'])
def test_end_of_the_page_stops_pending_starts(cell: Cell, action: str) -> None:
    cell.queue.moves = 0 if action == 'jog' else 1
    sent = 'steer' if action == 'jog' else 'start'
    cell.takes_s[sent] = [1.0]
    cell.late.add(sent)
    if action == 'jog':
        cell.hold(0.5, 9.0)
    else:
        cell.click(0.5, 'start')
    cell.run(0.8)
    assert cell.times(sent)
    cell.spin_for(3.0)
    assert cell.state in ('idle', 'stopped')
    assert not cell.in_control


def test_repeated_clicks_on_stop_are_one_stop_until_its_reply(cell: Cell) -> None:
    cell.takes_s['emergency_stop'] = [float('inf')]
    for n in range(300):
        cell.click(1.0 + 0.02 * n, 'emergency_stop')
    cell.run(20.0)
    assert len(cell.times('emergency_stop')) == 1


def test_only_the_newest_override_that_waits_counts(cell: Cell) -> None:
    cell.takes_s['enable'] = [2.0]
    cell.click(0.5, 'enable')
    for n, percent in enumerate((50, 60, 70)):
        cell.click(1.0 + 0.1 * n, 'override', f'{percent}')
    cell.run(4.0)
    assert [name for name, _ in cell.asked if name.startswith('override')] == ['override 70']


def test_slider_returns_after_a_rejected_override(cell: Cell) -> None:
    cell.refuses.add('override 150')
    cell.click(0.5, 'override', '90')
    cell.run(1.0)
    assert cell.slider == 0
    cell.view = LiveView(cell, cell, cell)
    cell.click(cell.now + 0.1, 'override', '150')
    cell.run(cell.now + 1.0)
    assert cell.slider == 1


def test_control_stays_with_the_holder_of_a_button_at_the_edge_of_the_workspace(cell: Cell) -> None:
    kept = []
    cell.hold(0.5, 4.0)
    cell.at(2.0, lambda: setattr(cell, 'state', 'idle'))
    cell.at(3.5, lambda: kept.append(cell.in_control))
    cell.run(6.0)
    assert kept == [True]
    assert not cell.in_control


@pytest.mark.parametrize('text', ['../../../etc/hostname', '/etc/hostname', 'none', ''])
def test_a_page_can_name_no_file_of_this_machine(cell: Cell, text: str) -> None:
    cell.click(0.5, 'packaged', text)
    cell.run(1.0)
    assert cell.times('program') == []
    assert any('there is no packaged program' in sentence for sentence, _ in cell.told)


@pytest.mark.parametrize(
    ('action', 'text'),
    [
        *(('press', '+w 10'), ('press', 'x'), ('step', '+x a b'), ('step', '')),
        *(('scope', ''), ('scope', '[]'), ('scope', '{"channels": 3}'), ('scope', '[' * 100_000)),
    ],
)
def test_arbitrary_page_request_does_not_end_the_view(cell: Cell, action: str, text: str) -> None:
    cell.click(0.5, action, text)
    cell.run(1.0)
    assert cell.now >= 1.0
    assert any(refused for _, refused in cell.told)


def test_input_is_set_without_control_and_a_rejection_is_reported(cell: Cell) -> None:
    control = []
    cell.click(0.5, 'input', 'start on')
    cell.at(0.8, lambda: control.append(cell.in_control))
    cell.refuses.add('input moon on')
    cell.click(1.0, 'input', 'moon on')
    cell.run(2.0)
    assert [name for name, _ in cell.asked if name.startswith('input')] == ['input start on', 'input moon on']
    assert cell.told == [('input start on accepted', False), ('input moon on is refused', True)]
    assert control == [False]


def test_cell_is_drawn_once_and_again_after_a_change(cell: Cell) -> None:
    def known(*things: str) -> None:
        cell.cell.now = SimpleNamespace(things=things, changes=cell.cell.now.changes + 1)

    cell.at(0.5, lambda: known('belt'))
    cell.at(1.5, lambda: known('belt', 'box'))
    cell.run(3.0)
    assert cell.stood == [('belt',), ('belt', 'box')]


def test_page_that_lost_its_robot_sends_no_requests_before_it_rejoins(cell: Cell) -> None:
    cell.at(5.0, lambda: setattr(cell, 'silent', True))
    cell.click(24.99, 'start')
    cell.run(OVER_S)
    assert cell.rejoins
    assert 25.0 < cell.now < 25.1
    assert [sentence for sentence, _ in cell.told][-1].startswith(
        'no message from transformation_task for 20 s'
    )


def test_rejoining_page_keeps_its_knowledge_of_the_robot(
    robot: Parameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    told, seen, left = robot.replace(motion__tcp_speed_limit_m_s=2.0), [], []

    class View:
        def __init__(self, page: Any, reader: Any, process: Any) -> None:
            self.reader, self.process = reader, process
            self.spin_for = process.spin_for

        def run(self, patience_s: float) -> None:
            seen.append((self.reader.parameters, patience_s))
            self.reader.parameters = told
            self.process.rejoins = len(seen) < 2

    def process() -> Any:
        return SimpleNamespace(rejoins=False, add=lambda _: None, spin_for=lambda _: None)

    monkeypatch.setattr(live_view, 'LiveView', View)
    monkeypatch.setattr(live_view, 'OperatorNode', lambda *_, **__: SimpleNamespace())
    monkeypatch.setattr(
        live_view, 'RobotReader', lambda _, known: SimpleNamespace(parameters=known, operator=None)
    )
    monkeypatch.setattr(
        live_view, 'node_process', SimpleNamespace(join=lambda: None, Process=process, leave=left.append)
    )
    live_view.run(SimpleNamespace(), robot, '/', 3.0)
    assert seen == [(robot, 3.0), (told, float('inf'))]
    assert len(left) == 2
