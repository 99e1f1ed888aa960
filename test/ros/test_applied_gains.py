"""Tests of gains in the drives of a robot on the graph: applied under torque, restored, or rejected as a set."""

import contextlib
from pathlib import Path
from typing import Any

import pytest

from delta3_pacdrive.cli.main import main
from delta3_pacdrive.control.operation.service_texts import DriveValues
from delta3_pacdrive.errors import ProgramError, TuningError
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.mc4_drive import MC4DriveNode
from delta3_pacdrive.studies.drives.tuning import drive_gains as applied

GAINS = {'position_gain_rad_s_rad': 49.77, 'velocity_gain_a_s_rad': 0.3946, 'notch_1_frequency_hz': 232.0}
DEFAULT = {'position_gain_rad_s_rad': 60.0, 'velocity_gain_a_s_rad': 0.35, 'notch_1_frequency_hz': 0.0}


class Cell:
    """A robot without a clock, and an operator."""

    def __init__(self, graph: Any) -> None:
        self.task = graph.robot()
        self.operator = graph.add(OperatorNode, graph.spin_for)
        self.drives = [node for node in graph.nodes if isinstance(node, MC4DriveNode)]
        graph.spin_until(lambda: self.task.progress().in_torque, 'torque')

    def values(self) -> list[dict[str, float]]:
        return [{name: node.get_parameter(f'drive.{name}').value for name in GAINS} for node in self.drives]


@pytest.fixture
def cell(graph: Any) -> Cell:
    return Cell(graph)


def test_drives_in_torque_accept_gains_and_are_restored(cell: Cell, tmp_path: Path) -> None:
    channel = DriveValues(cell.operator)
    applied.apply(GAINS, channel, '/', tmp_path)
    assert cell.values() == [GAINS] * 3
    assert all(int(node.drive.constants['notches'][0]) == 1 for node in cell.drives)
    applied.undo(channel, tmp_path)
    assert cell.values() == [DEFAULT] * 3
    assert cell.task.progress().fault == ''
    assert cell.task.progress().in_torque


def test_a_drive_that_rejects_leaves_all_as_they_were(cell: Cell, tmp_path: Path) -> None:
    channel = DriveValues(cell.operator)
    with pytest.raises(TuningError, match=r'8503: P-0-0033: .*; all drives have their previous values'):
        applied.apply(GAINS | {'notch_1_frequency_hz': 5.0}, channel, '/', tmp_path)
    assert cell.values() == [DEFAULT] * 3


def test_rejection_by_the_second_drive_restores_the_values_of_the_first_one(
    cell: Cell, tmp_path: Path
) -> None:
    class Refusing(DriveValues):
        def write(self, axis: str, idn: str, value: float) -> None:
            if axis == 'axis2':
                raise ProgramError('axis2: 8503: S-0-0104: it is write protected (error 0x7008)')
            super().write(axis, idn, value)

    with pytest.raises(TuningError, match=r'axis2: .* all drives have their previous values'):
        applied.apply(GAINS, Refusing(cell.operator), '/', tmp_path)
    assert cell.values() == [DEFAULT] * 3


def test_command_applies_the_proposal_of_auto_and_restores_the_gains(
    cell: Cell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = ', '.join(f'{name}: {value}' for name, value in GAINS.items())
    (tmp_path / 'gains.yaml').write_text(f'/**:\n  ros__parameters:\n    drive: {{{rows}}}\n')
    monkeypatch.setattr(
        'delta3_pacdrive.ros.clients.robot_client.operating', lambda _: contextlib.nullcontext(cell.operator)
    )
    assert main(['tune', '--apply', '--output', str(tmp_path)]) == 0
    assert 'position_gain_rad_s_rad = 49.77' in capsys.readouterr().out
    assert cell.values() == [GAINS] * 3
    assert main(['tune', '--undo', '--output', str(tmp_path)]) == 0
    assert cell.values() == [DEFAULT] * 3
