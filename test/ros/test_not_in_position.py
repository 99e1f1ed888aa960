"""Tests of a robot that does not reach its position window: every client reports it and fails."""

import contextlib
from pathlib import Path
from typing import Any

import pytest

from delta3_pacdrive.cli.main import main
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode

NARROW_RAD = 1e-6  # of a shaft: less than an increment of its encoder
PATIENCE_S = 0.05


def test_move_that_does_not_arrive_fails_with_its_message(
    graph: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = {'motion__in_position_timeout_s': PATIENCE_S, 'motion__start_cycle': -1}
    settings |= {'drive__position_window_rad': NARROW_RAD}
    task = graph.robot(**settings)
    graph.add(UnitRobotNode, **settings)
    operator = graph.add(OperatorNode, graph.spin_for)
    graph.spin_until(lambda: task.progress().in_torque and operator.queue, 'torque, and a planner')
    monkeypatch.setattr(
        'delta3_pacdrive.ros.clients.robot_client.operating', lambda _: contextlib.nullcontext(operator)
    )
    program = tmp_path / 'short.yaml'
    program.write_text('in_position: true\nmoves:\n- move_l: {to_m: {by_m: [0.01, 0.0, -0.01]}}\n')
    assert main(['move', 'program', str(program)]) == 1
    told = capsys.readouterr()
    assert 'not in position 0.05 s after the set points came to rest' in told.err
    assert 'the robot is at rest' not in told.out
