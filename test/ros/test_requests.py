"""One request, one answer: moves by a service with text in and text out, and what is told of each, over real DDS."""

import json
from typing import Any

import pytest
from diagnostic_msgs.srv import AddDiagnostics
from std_msgs.msg import String
from std_srvs.srv import Trigger

from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.qos import REQUEST
from delta3_pacdrive.ros.robot_client import OperatorNode

LINE = 'move_l: {to_m: [0.05, 0.0, -0.75], speed_m_s: 0.5}'


class Cell:
    """A robot without a clock, its planner, an operator, and a client that has nothing but the service."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.reports = graph.listen(String, 'unit_robot/requests', REQUEST)
        self.task = graph.robot(motion__start_cycle=-1)
        self.planner = graph.add(UnitRobotNode, motion__start_cycle=-1)
        self.operator = graph.add(OperatorNode, graph.spin_for)
        graph.spin_until(lambda: self.task.progress()['in_torque'] and self.operator.state, 'torque')

    def move(self, text: str) -> tuple[bool, dict[str, str]]:
        response = self.graph.call(
            AddDiagnostics, 'unit_robot/move', AddDiagnostics.Request(load_namespace=text)
        )
        return response.success, json.loads(response.message)

    def states(self, identity: str) -> list[str]:
        """Return the states that were told of a request, each once."""
        told = [report['state'] for report in map(json.loads, (m.data for m in self.reports))
                if report['id'] == identity]  # fmt: skip
        return list(dict.fromkeys(told))

    def wait_for(self, identity: str, state: str) -> None:
        self.graph.spin_until(lambda: state in self.states(identity), f'{state} of {identity}')


@pytest.fixture
def cell(graph: Any) -> Cell:
    return Cell(graph)


def test_a_move_is_driven_and_its_id_is_followed_to_the_end(cell: Cell) -> None:
    accepted, answer = cell.move(LINE)
    assert accepted, answer
    assert set(answer) == {'id', 'code', 'sentence'}
    assert (answer['code'], answer['sentence'][:7]) == ('', 'started')
    cell.wait_for(answer['id'], 'done')
    states = cell.states(answer['id'])
    assert (states[:2], states[-1]) == (['planning', 'queued'], 'done')


def test_each_refusal_has_an_id_a_code_and_a_sentence_of_its_own(cell: Cell) -> None:
    refused = [cell.move('move_l: {to_m: [0.0, 0.0, -8.0]}'), cell.move(''), cell.move('[' * 60)]
    assert not any(accepted for accepted, _ in refused)
    assert [answer['code'] for _, answer in refused] == ['content'] * 3
    assert len({answer['id'] for _, answer in refused}) == 3
    assert 'z is -8 m' in refused[0][1]['sentence']
    cell.wait_for(refused[0][1]['id'], 'refused')
    assert cell.move(LINE)[0]


def test_who_has_control_keeps_others_out(cell: Cell) -> None:
    cell.operator.take_control('somebody')
    accepted, answer = cell.move(LINE)
    assert (accepted, answer['code']) == (False, 'control')
    cell.operator.release_control()
    assert cell.move(LINE)[0]


def test_moves_that_wait_in_the_queue_are_started_under_the_name_of_the_node(cell: Cell) -> None:
    first = cell.move(f'{{{LINE}, start: false}}')[1]
    assert first['sentence'].startswith('planned'), first
    assert cell.graph.call(Trigger, 'unit_robot/start', Trigger.Request()).success
    cell.wait_for(first['id'], 'running')
    assert cell.graph.call(Trigger, 'transformation_task/abort', Trigger.Request()).success
    cell.wait_for(first['id'], 'aborted')


def test_moves_in_a_row_are_driven_in_a_row_while_the_robot_moves(cell: Cell) -> None:
    answers = [
        cell.move(f'move_l: {{to_m: [{x}, {y}, -0.75], speed_m_s: 0.05, blend_m: 0.005}}')
        for x, y in ((0.05, 0.0), (0.05, 0.05), (0.0, 0.05))
    ]
    assert all(accepted for accepted, _ in answers), answers
    assert answers[0][1]['sentence'].startswith('started')
    assert all('1 statements follow' in answer['sentence'] for _, answer in answers[1:])
    for _, answer in answers:
        cell.wait_for(answer['id'], 'done')
    cell.graph.spin_until(lambda: cell.operator.state == 'idle', 'the end')
    assert cell.task.progress()['tcp_m'] == pytest.approx([0.0, 0.05, -0.75], abs=1e-4)
