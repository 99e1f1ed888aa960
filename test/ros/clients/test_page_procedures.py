"""Tests of the tab Commissioning of the page on the running graph: procedures, their end, and hostile requests."""

from collections import deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.ros.clients import live_view
from delta3_pacdrive.ros.clients.live_view import LiveView
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.view.values import Facts, UiCommand

GAUGE_RAD = 9.6  # of the motor: 17 degrees of the arm
HOMING = 'S-0-0148 Drive-controlled homing'


class Visited:
    """A page with a browser, the view that serves it, and a robot: the scenario advances while the view spins."""

    def __init__(self, graph: Any) -> None:
        self.graph, self.watched, self.controls = graph, True, None
        self.commands: deque[UiCommand] = deque()
        self.replies: list[tuple[str, bool]] = []
        self.steps: list[tuple[str, str, bool]] = []
        self.scenario: list[tuple[Callable[[], Any], Callable[[], Any]]] = []
        self.rejoins = False
        self.task = graph.robot(motion__start_cycle=-1)
        graph.add(UnitRobotNode, motion__start_cycle=-1)
        self.operator, self.other = (graph.add(OperatorNode, graph.spin_for) for _ in range(2))
        graph.spin_until(lambda: self.task.progress().in_torque and self.operator.state, 'torque')
        self.parameters, self.available = parameters.load(), True
        self.planned = SimpleNamespace(points_m=np.empty((0, 3)), changes=0)
        self.cell = SimpleNamespace(now=SimpleNamespace(things=(), changes=0))
        self.view = LiveView(self, self, self)  # type: ignore[arg-type]
        self.operator.spin_for = self.view.spin_for

    def click(self, action: str, text: str = '', by_force: bool = False) -> None:
        self.commands.append(UiCommand(action, text, by_force))

    def disable(self) -> None:
        self.other.call('disable')
        self.graph.spin_until(lambda: not self.task.progress().in_torque, 'no torque')

    def when(self, condition: Callable[[], Any], *does: Callable[[], Any]) -> None:
        """Act once a condition holds, after all earlier conditions."""
        self.scenario.append((condition, lambda: [one() for one in does]))

    def run(self) -> None:
        """Let the view run until the scenario has ended."""
        self.view.run(60.0)
        assert not self.scenario

    # process

    def spin_for(self, seconds: float) -> None:
        self.graph.spin_for(seconds)
        if self.scenario and self.scenario[0][0]():
            self.scenario.pop(0)[1]()
            if not self.scenario:
                self.view.stop()

    def rejoin(self) -> None:
        self.rejoins = True

    # page

    def report(self, sentence: str, refused: bool = False) -> None:
        self.replies.append((sentence, refused))

    def report_procedure(self, axis: str, sentence: str, failed: bool = False) -> None:
        self.steps.append((axis, sentence, failed))

    def said(self, begin: str) -> Callable[[], bool]:
        return lambda: any(sentence.startswith(begin) for sentence, _ in self.replies)

    def show(self, _: Any) -> None:
        pass

    read = use = show_path = show_cell = show

    def clear_history(self) -> None:
        pass

    # robot

    def update_parameters(self) -> bool:
        return False

    def instant(self) -> None:
        return None

    def facts(self) -> Facts:
        return Facts()


@pytest.fixture
def page(graph: Any) -> Visited:
    return Visited(graph)


def commissioning(page: Visited) -> Callable[[], bool]:
    return lambda: page.operator.state == 'commissioning'


def test_procedure_shows_its_steps_and_result_and_rejects_other_requests(page: Visited) -> None:
    page.disable()
    page.click('procedure', 'axis2 S-0-0148')
    page.when(
        commissioning(page),
        lambda: page.click('procedure', 'axis1 P-0-0541'),
        lambda: page.click('enable'),
    )
    page.when(page.said(f'axis2: {HOMING}: done'), lambda: None)
    page.run()
    first, second, result = page.replies
    sentence = f'axis2: {HOMING} is in progress'
    assert first == (f'procedure is rejected: {sentence}', True)
    assert second == (f'enable is rejected: {sentence}', True)
    assert not result[1]
    assert ('axis2', 'axis2: searches the reference', False) in page.steps
    assert page.steps[-1] == ('axis2', result[0], False)
    assert not page.task.progress().in_torque
    assert not page.operator.in_control


@pytest.mark.parametrize('way', ['button', 'disable', 'browser leaves', 'view ends'])
def test_procedure_is_interrupted(page: Visited, way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_view, 'GONE_S', 0.0)
    page.disable()
    page.click('procedure', 'axis1 P-0-0524')
    does = {
        'button': lambda: page.click('end_procedure'),
        'disable': lambda: page.click('disable'),
        'browser leaves': lambda: setattr(page, 'watched', False),
        'view ends': page.view.stop,
    }[way]
    page.when(commissioning(page), does)
    page.when(lambda: page.operator.state == 'idle', lambda: None)
    page.run()
    assert page.steps[-1] == ('axis1', 'axis1: P-0-0524 Commutation offset setting: interrupted', True)
    assert page.other.drive('axis1 read P-0-0524').endswith('= 0x0005')
    assert page.task.progress().fault == ''


@pytest.mark.parametrize(
    'text', ['', 'axis9 S-0-0148', 'axis1 S-0-0099', 'axis1', 'axis1 S-0-0148 7', 'axis1 write S-0-0047 0']
)
def test_request_for_anything_else_is_rejected(page: Visited, text: str) -> None:
    page.disable()
    page.click('procedure', text)
    page.when(lambda: page.replies, lambda: None)
    page.run()
    ((sentence, refused),) = page.replies
    assert refused
    assert sentence.endswith('is not an axis and a procedure command')
    assert page.operator.state == 'idle'


def test_enabled_robot_and_another_operator_are_respected(page: Visited) -> None:
    page.click('procedure', 'axis1 S-0-0148')
    page.when(
        lambda: page.replies,
        page.disable,
        lambda: page.other.take_control('other'),
        lambda: page.click('procedure', 'axis1 P-0-0541'),
    )
    page.when(
        lambda: len(page.replies) == 2, lambda: page.click('procedure', 'axis1 P-0-0541', by_force=True)
    )
    page.when(page.said('axis1: P-0-0541 Brake check: done'), lambda: page.click('end_procedure'))
    page.when(lambda: len(page.replies) == 4, lambda: None)
    page.run()
    enabled, controlled, result, without = page.replies
    assert 'the drives are enabled: disable them first' in enabled[0]
    assert 'has control of the robot' in controlled[0]
    assert 'the brake holds' in result[0]
    assert without == ('the page executes no procedure', True)
    assert [refused for _, refused in page.replies] == [True, True, False, True]
