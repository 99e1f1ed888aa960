"""Tests of random sequences of requests to a real graph: complete replies, and recovery by documented requests."""

import random
from typing import Any

import pytest
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from delta3_pacdrive.errors import Delta3Error
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire.qos import REQUEST

LENGTH = 50
ON_REQUEST = {'motion__start_cycle': -1}
PROGRAMS = (
    'moves: [{move_l: {to_m: [0.03, 0.0, -0.75]}}]',
    'moves: [{move_l: {to_m: [0.0, 0.02, -0.76], blend_m: 0.005}}, {move_l: {to_m: [0.0, 0.0, -0.75]}}]',
    'moves: [{move_l: {to_m: [0.0, 0.0, -0.2]}}]',
    '][',
)
STEP = 'moves: [{move_l: {to_m: {by_m: [0.0, 0.0, -0.01]}}}]'


class Sequence:
    """Requests of two operators and of clients without an identity, at random."""

    def __init__(self, graph: Any, seed: int) -> None:
        self.graph, self.chance = graph, random.Random(seed)
        self.task = graph.robot(**ON_REQUEST)
        graph.add(UnitRobotNode, **ON_REQUEST)
        self.operators = [graph.add(OperatorNode, graph.spin_for) for _ in range(2)]
        self.program = graph.listener.create_publisher(String, 'unit_robot/program', REQUEST)
        graph.spin_until(lambda: self.task.progress().in_torque and self.operators[0].state, 'torque')
        self.told: list[str] = []

    def attempt(self, what: str, action: Any) -> None:
        try:
            answer = str(action())
        except Delta3Error as error:
            answer = f'refused: {error}'
            assert 'within' not in answer, f'nobody has answered: {what}'
        self.told.append(f'{what}: {answer}')

    def step(self) -> None:
        chance, graph = self.chance, self.graph
        operator = chance.choice(self.operators)
        name = 'AB'[self.operators.index(operator)]
        kind = chance.choice(
            [
                'program',
                'call',
                'call',
                'call',
                'service',
                'override',
                'enable',
                'control',
                'anybody',
                'wait',
                'wait',
            ]
        )
        if kind == 'program':
            text = chance.choice(PROGRAMS)
            self.attempt(f'{name}: program', lambda: operator.send_program(text))
        elif kind == 'call':
            verb = chance.choice(
                ['start', 'start', 'resume', 'clear', 'hold', 'abort', 'emergency_stop', 'reset', 'reset']
            )
            self.attempt(f'{name}: {verb}', lambda: operator.call(verb))
        elif kind == 'service':
            verb = chance.choice(['start', 'resume', 'hold', 'reset'])
            response = graph.call(Trigger, verb, Trigger.Request())
            assert response.message
            self.told.append(f'anybody: {verb}: {response.success} {response.message}')
            if verb == 'start' and response.success:
                assert self.task.progress().state in ('moving', 'idle')
        elif kind == 'override':
            self.attempt(
                f'{name}: override', lambda: operator.override(chance.choice([50.0, 150.0, 100.0, 999.0]))
            )
        elif kind == 'enable':
            on = chance.random() < 0.7
            response = graph.call(SetBool, 'enable', SetBool.Request(data=on))
            self.told.append(f'anybody: enable {on}: {response.success} {response.message}')
        elif kind == 'control' and not operator.in_control:
            by_force = chance.random() < 0.5
            self.attempt(f'{name}: control', lambda: operator.take_control(name, by_force))
        elif kind == 'control':
            self.attempt(f'{name}: release', operator.release_control)
        elif kind == 'anybody':
            self.program.publish(String(data=chance.choice(PROGRAMS)))
        else:
            graph.spin_for(0.05 * chance.random())
        assert self.task.progress().phase == 'CP4'

    def lead_out(self) -> None:
        """Follow the documentation: reset, enable, clear; then a move works."""
        graph, operator = self.graph, self.operators[0]
        operator.take_control('the last one', by_force=True)
        graph.spin_until(lambda: operator.state != 'stopping', 'standstill')
        if operator.state in ('moving', 'stopped'):
            operator.call('abort')
        graph.spin_until(lambda: operator.state in ('idle', 'error'), 'the end of the motion')
        if self.task.progress().fault:
            operator.call('reset')
        operator.enable(True)
        graph.spin_until(lambda: self.task.progress().in_torque, 'torque')
        operator.call('clear')
        before = self.task.progress().tcp_m
        operator.send_program(STEP)
        operator.call('start')
        changes = operator.state_changes
        graph.spin_until(lambda: operator.state == 'idle' or operator.state_changes > changes, 'the motion')
        graph.spin_until(lambda: operator.state == 'idle', 'the end')
        after = self.task.progress().tcp_m
        assert after == pytest.approx([before[0], before[1], before[2] - 0.01], abs=2e-4)
        assert self.task.progress().fault == ''


@pytest.mark.parametrize(
    'seed', [0, 1, 2, 3, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(4, 12))]
)
def test_after_any_sequence_of_requests_the_documented_ones_lead_out(seed: int, graph: Any) -> None:
    sequence = Sequence(graph, seed)
    try:
        for _ in range(LENGTH):
            sequence.step()
        sequence.lead_out()
    except BaseException:
        print('\n'.join(sequence.told[-20:]))
        raise
