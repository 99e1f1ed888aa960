"""Tests of the page's oscilloscope on the running graph: samples of the simulation, or an error message."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.planning.program.model import Dwell, Program
from delta3_pacdrive.recording.acquisition import Acquisition, Record
from delta3_pacdrive.ros.clients import page_commands
from delta3_pacdrive.ros.clients.page_commands import PageScope
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode


class Watching:
    """A page with an oscilloscope, and a robot with the requested drives."""

    def __init__(self, graph: Any) -> None:
        self.watched, self.scope = True, self
        self.records: list[Record] = []
        self.told: list[tuple[str, bool]] = []
        self.show = self.records.append
        robot: Any = SimpleNamespace(
            operator=graph.add(OperatorNode, graph.spin_for), parameters=parameters.load()
        )
        self.graph, self.oscilloscope = graph, PageScope(self, robot)  # type: ignore[arg-type]

    def report_scope(self, sentence: str, refused: bool = False) -> None:
        self.told.append((sentence, refused))

    def begin(self, channels: str, **more: Any) -> None:
        usual = {
            'mode': 'single', 'trigger': 'none', 'source': '', 'level': 0.0, 'edge': 'usual', 'pre_trigger_s': 0.0,
            'duration_s': 0.1, 'rate_hz': 16_000.0,
        }  # fmt: skip
        self.oscilloscope.begin(json.dumps({'channels': channels} | usual | more))

    def until(self, condition: Any, what: str) -> None:
        def looked() -> bool:
            self.oscilloscope.update()
            return bool(condition())

        self.graph.spin_until(looked, what)

    def until_told(self, begin: str) -> tuple[str, bool]:
        self.until(lambda: self.told and self.told[-1][0].startswith(begin), begin)
        return self.told[-1]


@pytest.fixture
def page(graph: Any) -> Watching:
    return Watching(graph)


def test_drawn_samples_are_those_of_the_simulation(graph: Any, page: Watching) -> None:
    graph.robot(('plant', '1', '2', '3'))
    page.begin('axis1.current_reference, axis2.voltage, axis3.position')
    page.until_told('recording')  # before bus time begins
    graph.add(TransformationTaskNode, real_time_factor=0.0)
    page.until(lambda: page.records, 'a record')
    (found,) = page.records
    simulated: list[Record] = []
    robot = parameters.load()
    simulation.run(
        Program('a robot that stands', (Dwell(0.1),)), robot, Acquisition(found.setting, simulated.append)
    )
    assert found.first == simulated[0].first == 1
    np.testing.assert_array_equal(found.values, simulated[0].values)
    assert page.told[-1] == ('1600 samples of 3 channels at 16000 Hz, from bus time 0.000063 s on', False)


def test_rolling_record_continues_until_ended_or_unwatched(
    graph: Any, page: Watching, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_commands, 'ROLLED_S', 0.0)
    graph.robot()
    page.begin('axis1.current', mode='rolling')
    page.until(lambda: len(page.records) > 3 and len(page.records[-1].values) == 1600, 'it rolls')
    page.oscilloscope.end()
    assert page.told[-1][0].startswith('1600 samples of a channel')
    assert page.records[-1].first >= page.records[-2].first
    shown = len(page.records)
    page.begin('axis1.current', mode='rolling')
    page.until(lambda: len(page.records) > shown, 'it rolls again')
    monkeypatch.setattr(page_commands, 'LEFT_S', 0.1)
    page.watched = False
    page.until(lambda: 'samples of a channel' in page.told[-1][0], 'it is ended')
    page.oscilloscope.end()
    assert page.told[-1] == ('nothing is recorded', False)


def test_another_one_is_rejected_by_its_name_and_one_of_the_same_page_is_replaced(
    graph: Any, page: Watching
) -> None:
    graph.robot()
    page.begin('axis1.speed', trigger='fault')
    assert page.until_told('waiting') == ('waiting for a fault of a drive', False)
    other = Watching(graph)
    other.begin('axis1.current, axis2.current')
    _, refused = other.until_told('the oscilloscope of axis1 is in use by process')
    assert refused
    page.begin('axis1.current, axis2.current')
    page.until(lambda: page.records, 'a record of what was asked for instead')
    other.begin('axis2.speed', trigger='channel', source='axis2.speed', level=1e6)
    other.until_told('waiting for axis2.speed rising through 1e+06 rad/s')
    other.oscilloscope.end()
    assert other.told[-1] == ('ended while axis2.speed rising through 1e+06 rad/s was awaited', False)
    page.begin('axis2.speed')
    page.until(lambda: len(page.records) == 2, 'a record of a drive that is free again')


def test_missing_robot_and_invalid_input_are_reported(
    page: Watching, monkeypatch: pytest.MonkeyPatch
) -> None:
    page.begin('axis1.sped')
    assert page.told[-1] == (
        "a drive has no channel 'sped': did you mean speed?: see delta3 scope list",
        True,
    )
    monkeypatch.setattr(page_commands, 'PATIENCE_S', 0.3)
    page.begin('axis1.speed')
    sentence, refused = page.until_told('no drives with an oscilloscope within 0.3 s')
    assert refused
    page.oscilloscope.update()
    assert page.told[-1][0] == sentence  # once
