"""Tests of catalogue and soak on a robot in this process: evidence with a fault, and none without."""

import json
from collections.abc import Callable
from typing import Any

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.robot.drive import drive_clock
from delta3_pacdrive.robot.plant import plant_clock
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.verification.fault_catalogue.cases import Case, Outcome, State
from delta3_pacdrive.verification.fault_catalogue.runner import Catalogue
from delta3_pacdrive.verification.soak import runner as soak
from delta3_pacdrive.verification.soak.programs import Drawn
from delta3_pacdrive.verification.soak.runner import Figures, Soak
from thoroughness import some

ROBOT = parameters.load()


class Standing:
    """A robot that is up in this process, in place of one that was brought up."""

    interrupted = False

    def __init__(self, graph: Any) -> None:
        self.graph, self.node = graph, graph.listener
        self.notes: list[str] = []
        self.poll: Callable[[float], None] = graph.spin_for
        self.add: Callable[[Any], None] = graph.adopt
        task = graph.robot()
        graph.add(UnitRobotNode)
        graph.spin_until(lambda: task.progress().in_torque, 'torque')

    def processes(self) -> list[Any]:
        return []


LONG = pytest.mark.long


@pytest.fixture(scope='module')
def standing(shared_graph: Any) -> Standing:
    return Standing(shared_graph)


@pytest.fixture(scope='module')
def catalogue(standing: Standing) -> Catalogue:
    return Catalogue(standing, ROBOT)  # type: ignore[arg-type]


def outcome_of(catalogue: Catalogue, state: State, expected: str = '', **fault: Any) -> Outcome:
    return catalogue.run(Case(fault, state, expected))


LEFT_BEHIND = [
    ({'fault': 'drop_mdt', 'axis': 'axis2'}, State.STANDING, '1 lost'),
    ({'fault': 'drop_at', 'axis': 'axis3'}, State.STANDING, '1 lost'),
    ({'fault': 'duplicate_at', 'axis': 'axis1', 'cycles': 20}, State.DISABLED, '20 repeated'),
    ({'fault': 'duplicate_mdt', 'axis': 'axis1', 'cycles': 20}, State.STANDING, '20 repeated'),
    ({'fault': 'encoder_jump', 'axis': 'axis1', 'jump_rad': 0.1}, State.STANDING, 'up to 0.1000 rad wrong'),
    ({'fault': 'dc_link', 'axis': 'axis1', 'voltage_v': 560.0}, State.STANDING, 'dc_link axis1 voltage_v 560 b'),
    ({'fault': 'payload_lost'}, State.STANDING, ' kg lost'),
    # over before anybody looks
    ({'fault': 'encoder_jump', 'axis': 'axis2', 'jump_rad': 0.1, 'for_s': 0.05}, State.STANDING, '0.1000 rad'),
]  # fmt: skip


@pytest.mark.parametrize(('fault', 'state', 'evidence'), some(LEFT_BEHIND, LEFT_BEHIND[6:7]))
def test_after_effects_of_a_fault_are_found(
    fault: dict[str, Any], state: State, evidence: str, catalogue: Catalogue
) -> None:
    found = outcome_of(catalogue, state, **fault)
    assert evidence in found.evidence, found
    assert found.as_expected, found


@pytest.mark.parametrize('state', [State.ENABLING, pytest.param(State.STOPPING, marks=LONG)])
def test_a_fault_hits_the_short_state_that_it_is_meant_for(state: State, catalogue: Catalogue) -> None:
    found = outcome_of(catalogue, state, fault='drop_at', axis='axis2')
    assert found.evidence == '1 lost', found
    assert found.as_expected, found


@pytest.mark.long
def test_earlier_losses_are_not_evidence(catalogue: Catalogue) -> None:
    for _ in range(2):
        assert outcome_of(catalogue, State.STANDING, fault='drop_mdt', axis='axis2').evidence == '1 lost'


def test_a_fault_that_stops_the_robot_is_timed_and_measured(catalogue: Catalogue) -> None:
    found = outcome_of(catalogue, State.MOVING, '8171', fault='encoder_failure', axis='axis3')
    assert found.as_expected, found
    assert (found.reported.code, found.reported.number) == ('drive', 8171)
    assert 0.0 <= (found.detected_s or 0.0) <= 0.002
    assert 1e-4 < found.deviation_m < 0.03
    assert not found.exercised


@pytest.mark.long
def test_hidden_fault_of_a_disabled_drive_is_detected_by_the_exercise(catalogue: Catalogue) -> None:
    found = outcome_of(catalogue, State.DISABLED, '8905', fault='winding_short', axis='axis1')
    assert found.as_expected, found
    assert found.exercised


NONE_BEFALLS = [
    ('', {'fault': 'encoder_jump', 'axis': 'axis1', 'jump_rad': 0.1}),
    ('', {'fault': 'brake_stuck', 'axis': 'axis3'}),
    ('8171', {'fault': 'encoder_failure', 'axis': 'axis1'}),
    ('', {'fault': 'payload_lost'}),
]


@pytest.mark.parametrize(('expected', 'fault'), some(NONE_BEFALLS, NONE_BEFALLS[2:3]))
def test_robot_without_the_injected_fault_is_not_as_expected(
    expected: str, fault: dict[str, Any], catalogue: Catalogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drive_clock, 'apply_to_drive', lambda *_: None)
    monkeypatch.setattr(plant_clock, 'apply_to_plant', lambda *_: None)
    found = outcome_of(catalogue, State.STANDING, expected, **fault)
    assert not found.reported
    assert not found.problem
    assert not found.as_expected, found


def test_error_of_a_case_is_reported(catalogue: Catalogue, monkeypatch: pytest.MonkeyPatch) -> None:
    drive = catalogue.drive

    def refuse_faults(moves: Any, faults: Any = (), **more: Any) -> None:
        if faults:
            raise ProgramError('the robot will not')
        drive(moves, faults, **more)

    monkeypatch.setattr(catalogue, 'drive', refuse_faults)
    found = outcome_of(catalogue, State.MOVING, fault='encoder_noise', axis='axis1', noise_rad=5e-4)
    assert found.problem == 'the robot will not'
    assert not found.as_expected
    assert found.recovered_s is not None


def test_robot_that_does_not_return_ends_its_case_and_not_the_catalogue(
    catalogue: Catalogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor does a bus that takes no order for a new machine: that of a busy robot was in CP0."""

    def refuse(*_: Any) -> None:
        raise ProgramError('the bus is in CP0')

    monkeypatch.setattr(catalogue, 'make_ready', refuse)
    monkeypatch.setattr(catalogue.operator, 'inject', refuse)
    found = outcome_of(catalogue, State.STANDING, fault='encoder_noise', axis='axis1', noise_rad=5e-4)
    assert 'the bus is in CP0' in found.problem
    assert found.recovered_s is None
    assert not found.as_expected


def test_bus_time_passes_when_it_should(catalogue: Catalogue) -> None:
    before = catalogue.fresh().bus_time_s
    catalogue.let_pass(0.5)
    assert catalogue.progress.bus_time_s >= before + 0.5


# soak

THERE = {'move_l': {'to_m': [0.1, 0.0, -0.8], 'speed_m_s': 0.5}}
SLOWLY = {'move_l': {'to_m': [0.1, 0.0, -0.8], 'speed_m_s': 0.05}}  # for longer than a request takes


class Replay:
    """One program of a soak."""

    def __init__(self, standing: Standing, monkeypatch: pytest.MonkeyPatch) -> None:
        self.figures = Figures()
        self._standing, self._patch = standing, monkeypatch
        self._soak = Soak(standing, ROBOT, 1, 'free', self.figures)  # type: ignore[arg-type]

    def run(self, moves: list[dict[str, Any]], *faults: dict[str, Any]) -> Figures:
        """Run it."""
        self._patch.setattr(soak, 'draw', lambda *_: Drawn(7, moves, list(faults)))
        self._soak.run(0.0, lambda _: None, 7)
        return self.figures

    def run_beside(self, moves: list[dict[str, Any]], fault: dict[str, Any]) -> Figures:
        """Run it; during the motion, a client unknown to the soak injects a fault."""
        graph = self._standing.graph
        other = graph.add(OperatorNode, graph.spin_for)
        due = False

        def draw(*_: Any) -> Drawn:
            nonlocal due
            due = True  # the robot stands, ready for the program
            return Drawn(7, moves, [])

        def poll(seconds: float) -> None:
            nonlocal due
            graph.spin_for(seconds)
            if due and other.state == 'moving':
                due = False
                other.inject(json.dumps(fault))

        self._patch.setattr(soak, 'draw', draw)
        self._patch.setattr(self._standing, 'poll', poll)
        self._soak.run(0.0, lambda _: None, 7)
        return self.figures


@pytest.fixture
def replay(standing: Standing, monkeypatch: pytest.MonkeyPatch) -> Replay:
    return Replay(standing, monkeypatch)


def test_an_undisturbed_program_is_held_against_its_commands_and_its_end(replay: Replay) -> None:
    figures = replay.run([THERE])
    assert figures.ok, figures
    assert (figures.programs, figures.undisturbed, figures.injected, figures.stopped) == (1, 1, 0, 0)
    assert 1e-6 < figures.error_max_m < 1.5e-3
    assert 0.0 < figures.end_max_m < 1e-5
    assert 200 < figures.cycles < 20_000


def test_disturbed_program_counts_its_faults_and_their_losses(replay: Replay) -> None:
    figures = replay.run(
        [THERE],
        {'fault': 'drop_at', 'axis': 'axis1', 'cycles': 1, 'after_s': 0.1},
        {'fault': 'encoder_failure', 'axis': 'axis2', 'after_s': 0.2},
    )
    assert figures.ok, figures
    assert (figures.injected, figures.survived, figures.stopped, figures.undisturbed) == (2, 2, 1, 0)
    assert figures.kinds == {'drop_at': 1, 'encoder_failure': 1}
    assert (figures.lost_at, figures.lost_at_injected) == (1, 1)


def test_rejected_program_does_not_count_as_run(replay: Replay) -> None:
    figures = replay.run([{'move_l': {'to_m': [0.9, 0.0, -0.8]}}])
    assert (figures.programs, figures.refused, figures.ok) == (0, 1, False)


@pytest.mark.parametrize(
    ('beside', 'sentence'),
    [
        pytest.param({'fault': 'drop_at', 'axis': 'axis1'}, 'AT: 1 lost, 0 were injected', marks=LONG),
        pytest.param(
            {'fault': 'drop_mdt', 'axis': 'axis2'},
            'MDT of axis2: 1 lost, 0 were injected',
            marks=LONG,
        ),
        ({'fault': 'encoder_failure', 'axis': 'axis2'}, 'stopped without an injected fault: axis2'),
    ],
)
def test_stop_without_an_injected_fault_is_a_violation_that_can_be_replayed(
    beside: dict[str, Any], sentence: str, replay: Replay
) -> None:
    figures = replay.run_beside([SLOWLY], beside)
    assert not figures.ok
    (violation,) = figures.violations
    assert violation.sentence.startswith(sentence)
    assert (violation.seed, violation.pace, violation.number) == (1, 'free', 7)
    assert violation.cycle > 0
    assert violation.program == Drawn(7, [SLOWLY], []).to_yaml()
