"""Tests of moves appended during motion or hold: the path continues without a jump."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.control.queue.planning_job import APPENDED_MAX

ALONG = 'move_l: {to_m: [0.1, 0.0, -0.75], speed_m_s: 0.3%s}'
UP = 'move_l: {to_m: [0.1, 0.06, -0.74], speed_m_s: 0.3}'
BACK = 'move_l: {to_m: [0.0, 0.06, -0.75], speed_m_s: 0.3}'
CORNER = np.array([0.1, 0.0, -0.75])
CYCLE_S = 1e-3
ACCELERATION, JERK = 15.0, 600.0  # of the parameters


class Driver:
    """A rig that is enabled, and the TCP of every cycle."""

    def __init__(self, rig: Any) -> None:
        self.rig = rig
        self.tcp: list[np.ndarray] = []
        command = rig.task.command

        def commanded(cycle: int) -> Any:
            result = command(cycle)
            self.tcp.append(rig.task.state['tcp'][0].copy())
            return result

        rig.task.command = commanded
        rig.enable()

    def ask(self, text: str, action: str = 'move') -> str:
        accepted, sentence = self.rig.ask(action, text)
        assert accepted, sentence
        return sentence

    def smooth(self) -> None:
        """Check that neither speed nor acceleration jumps anywhere."""
        path = np.array(self.tcp)
        speed = np.diff(path, axis=0) / CYCLE_S
        acceleration = np.diff(speed, axis=0) / CYCLE_S
        assert np.linalg.norm(speed, axis=1).max() < 0.3 * 1.51
        assert np.linalg.norm(acceleration, axis=1).max() < ACCELERATION * 1.5**2 * 1.02
        assert np.linalg.norm(np.diff(acceleration, axis=0), axis=1).max() < 4.0 * JERK * 1.5**3 * CYCLE_S

    def nearest(self, point: np.ndarray) -> float:
        return float(np.linalg.norm(np.array(self.tcp) - point, axis=1).min())

    def states(self, number: int) -> list[str]:
        identities = list(dict.fromkeys(report.id for report in self.rig.reports))
        return [report.state for report in self.rig.reports if report.id == identities[number]]


@pytest.fixture
def driver(rig: Any) -> Driver:
    return Driver(rig)


def test_moves_sent_in_a_row_are_executed_in_a_row_and_reported_to_their_end(driver: Driver) -> None:
    driver.ask(ALONG % '')
    assert driver.ask(UP).startswith('1 statements follow')
    driver.ask(BACK)
    driver.rig.finish()
    driver.smooth()
    assert driver.nearest(CORNER) < 1e-7  # without a blend the TCP stands there
    assert np.abs(driver.tcp[-1] - [0.0, 0.06, -0.75]).max() < 1e-7
    assert [driver.states(n)[-1] for n in range(3)] == ['done'] * 3
    assert [driver.states(n)[:2] for n in range(3)] == [['planning', 'queued']] * 3


def test_arm_angles_sent_during_motion_are_executed_after_its_moves(driver: Driver) -> None:
    driver.ask(ALONG % ', blend_m: 0.02')
    driver.rig.run(30)
    angles = kinematics.inverse((0.1, 0.03, -0.76), driver.rig.robot.kinematics).tolist()
    point = {'time_s': 0.5, 'angles_rad': angles, 'speeds_rad_s': [0, 0, 0]}
    sentence = driver.ask(json.dumps({'joints': {'points': [point]}}))
    assert sentence.startswith('1 statements follow')
    assert sentence.endswith('the corner before them is not rounded: they begin at rest')
    driver.ask('move_l: {to_m: [0.1, 0.03, -0.75]}')
    driver.rig.finish()
    driver.smooth()
    assert driver.nearest(CORNER) < 1e-7  # arm angles begin at rest: the corner before them is not rounded
    assert driver.nearest(np.array([0.1, 0.03, -0.76])) < 1e-7
    assert np.abs(driver.tcp[-1] - [0.1, 0.03, -0.75]).max() < 1e-7
    assert [driver.states(n)[-1] for n in range(3)] == ['done'] * 3


@pytest.mark.parametrize('override', ['100', '40', '150'])
def test_corner_to_an_appended_move_is_rounded_during_motion(override: str, driver: Driver) -> None:
    driver.rig.ask('override', override)
    driver.ask(ALONG % ', blend_m: 0.02')
    driver.rig.run(30)
    assert 'not rounded' not in driver.ask(UP)
    driver.rig.finish()
    driver.smooth()
    assert 1e-3 < driver.nearest(CORNER) < 0.02
    path = np.array(driver.tcp)
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) / CYCLE_S
    corner = int(np.argmin(np.linalg.norm(path - CORNER, axis=1)))
    assert speed[corner] > 0.05
    assert np.abs(path[-1] - [0.1, 0.06, -0.74]).max() < 1e-7


def test_near_corner_is_not_rounded_and_the_reply_reports_it(driver: Driver) -> None:
    driver.ask(ALONG % ', blend_m: 0.02')
    while np.linalg.norm(driver.tcp[-1] - CORNER) > 0.012:
        driver.rig.run(1)
    assert 'the corner before them is not rounded' in driver.ask(UP)
    driver.rig.finish()
    driver.smooth()
    assert driver.nearest(CORNER) < 1e-7
    assert np.abs(driver.tcp[-1] - [0.1, 0.06, -0.74]).max() < 1e-7


def test_an_output_switches_once_where_the_longer_plan_has_it(driver: Driver) -> None:
    driver.ask('[{%s}, {output: {name: output1, value: true}}]' % (ALONG % ', blend_m: 0.02'))
    driver.rig.run(30)
    driver.ask(f'[{{{UP}}}, {{output: {{name: output2, value: true, before_m: 0.01}}}}]')
    changes = []
    while driver.rig.state.motion == 'moving':
        driver.rig.run(1)
        if not changes or changes[-1][0] != driver.rig.task.outputs:
            changes.append((driver.rig.task.outputs, driver.tcp[-1]))
    assert [outputs for outputs, _ in changes] == [0, 2, 6]
    assert np.linalg.norm(changes[1][1] - CORNER) < 0.012
    assert np.linalg.norm(changes[2][1] - [0.1, 0.06, -0.74]) == pytest.approx(0.01, abs=1e-3)


@pytest.mark.parametrize('blend', ['', ', blend_m: 0.02'])
def test_moves_follow_while_the_robot_is_held_and_are_driven_when_it_resumes(
    blend: str, driver: Driver
) -> None:
    driver.ask(ALONG % blend)
    driver.rig.run(80)
    assert driver.rig.do('hold')[0]
    driver.rig.run(200)
    stands = driver.tcp[-1]
    assert 'the robot is stopped: resume continues' in driver.ask(UP)
    driver.rig.run(50)
    assert np.array_equal(driver.tcp[-1], stands)
    assert driver.rig.state.motion == 'stopped'
    driver.ask('', 'resume')
    driver.rig.finish()
    driver.smooth()
    assert (driver.nearest(CORNER) < 1e-7) == (not blend)
    assert np.abs(driver.tcp[-1] - [0.1, 0.06, -0.74]).max() < 1e-7


@pytest.mark.parametrize('later', [0, 1, 30, 58, 59, 60, 61, 90])
def test_a_hold_at_any_time_loses_no_move(later: int, driver: Driver) -> None:
    rig = driver.rig
    driver.ask(ALONG % ', blend_m: 0.02')
    rig.run(20)
    rig.asked += 1
    rig.planner.ask(request(rig, UP), rig.now_s)
    rig.settle()
    rig.run(later)
    assert rig.do('hold')[0]
    rig.run(300)
    assert rig.answers[-1][1:3] == (rig.asked, True), rig.answers[-1]
    driver.ask('', 'resume')
    rig.finish()
    driver.smooth()
    assert np.abs(driver.tcp[-1] - [0.1, 0.06, -0.74]).max() < 1e-7


@pytest.mark.parametrize('later', [0, 1, 59, 60, 61, 90])
@pytest.mark.parametrize('service', ['abort', 'emergency_stop'])
def test_moves_that_follow_are_given_up_with_the_program(service: str, later: int, driver: Driver) -> None:
    rig = driver.rig
    driver.ask(ALONG % ', blend_m: 0.02')
    rig.run(20)
    rig.asked += 1
    rig.planner.ask(request(rig, UP), rig.now_s)
    rig.settle()
    rig.run(later)
    assert rig.do(service)[0]
    rig.run(400)
    assert rig.state.motion == ('idle' if service == 'abort' else 'error')
    assert rig.answers[-1][1] == rig.asked
    assert driver.states(0)[-1] == 'aborted'
    assert driver.states(1)[-1] in ('aborted', 'refused')
    if service != 'abort':
        assert rig.do('reset')[0]
        rig.enable()
        driver.ask('', 'resume')  # the longer plan too, if it was taken
        rig.finish()
        end = [0.1, 0.06, -0.74] if rig.answers[-2][2] else [0.1, 0.0, -0.75]
        assert np.abs(driver.tcp[-1] - end).max() < 1e-7
    driver.ask(BACK)
    rig.finish()
    assert np.abs(driver.tcp[-1] - [0.0, 0.06, -0.75]).max() < 1e-7


def test_override_and_following_moves_are_independent(driver: Driver) -> None:
    driver.ask(ALONG % ', blend_m: 0.02')
    for n, percent in enumerate((50, 120, 80, 150)):
        driver.ask(str(percent), 'override')
        driver.ask(
            f'move_l: {{to_m: [{0.1 - 0.02 * n:g}, {0.05 + 0.02 * n:g}, -0.75], speed_m_s: 0.3, blend_m: 0.01}}'
        )
    driver.ask(BACK)
    driver.rig.finish()
    driver.smooth()
    assert np.abs(driver.tcp[-1] - [0.0, 0.06, -0.75]).max() < 1e-7


def test_rejection_does_not_affect_the_running_program(driver: Driver) -> None:
    driver.ask(ALONG % ', blend_m: 0.02')
    before = driver.rig.task.timeline
    refused = (
        'move_l: {to_m: [0.1, 0.0, -8.0]}',
        f'{{moves: [{{{UP}}}], payload_kg: 1.0}}',
        f'{{moves: [{{{UP}}}], start_m: [0.0, 0.0, -0.75]}}',
        str([{'dwell': {'time_s': 0.1}}] * (APPENDED_MAX + 1)),
        '][',
    )
    for text in refused:
        accepted, sentence = driver.rig.ask('move', text)
        assert not accepted
        assert sentence
    assert driver.rig.task.timeline is before
    driver.rig.finish()
    assert np.abs(driver.tcp[-1] - CORNER).max() < 1e-7


def rounded_moves(count: int) -> tuple[list[np.ndarray], list[str]]:
    """Return the ends of moves with rounded corners, and their texts."""
    points = [np.array([0.03 * np.cos(0.6 * n), 0.03 * np.sin(0.6 * n), -0.76]) for n in range(count)]
    text = '{{move_l: {{to_m: [{:g}, {:g}, {:g}], blend_m: 0.004, speed_m_s: 0.3}}}}'
    return points, [text.format(*point) for point in points]


def test_long_stream_of_blended_moves_continues_and_the_plan_stays_short(driver: Driver) -> None:
    points, moves = rounded_moves(APPENDED_MAX + 30)
    moves[39::40] = [move.replace(', blend_m: 0.004', '') for move in moves[39::40]]
    for n in range(0, len(moves), 5):
        driver.ask(f'[{", ".join(moves[n : n + 5])}]')
        driver.rig.run(200)  # they take 500
    assert len(driver.rig.task.timeline.plan) <= 3
    driver.rig.finish()
    driver.smooth()
    assert np.abs(driver.tcp[-1] - points[-1]).max() < 1e-6
    assert {report.state for report in driver.rig.reports} >= {'done', 'running'}
    done = [report.id for report in driver.rig.reports if report.state == 'done']
    assert len(done) == len(set(done)) == len(moves) / 5


def test_a_sequence_of_rounded_corners_that_has_become_long_ends_in_a_corner(driver: Driver) -> None:
    """All of it is planned anew whenever a move is appended."""
    points, moves = rounded_moves(APPENDED_MAX + 2)
    driver.ask(f'[{", ".join(moves[:-2])}]')
    driver.rig.run(1000)  # until there is room for more
    assert 'is not rounded: a sequence of rounded corners has at most 100 statements' in driver.ask(moves[-2])
    assert 'not rounded' not in driver.ask(moves[-1])
    driver.rig.finish()
    driver.smooth()
    stood = [n for n, point in enumerate(points) if driver.nearest(point) < 1e-7]
    assert stood == [APPENDED_MAX - 1, len(points) - 1]


def test_the_same_requests_in_the_same_cycles_give_the_same_bits(new_rig: Any) -> None:
    def drive() -> np.ndarray:
        driver = Driver(new_rig())
        driver.ask(ALONG % ', blend_m: 0.02')
        driver.rig.run(30)
        driver.ask(UP)
        driver.rig.finish()
        return np.array(driver.tcp)

    assert np.array_equal(drive(), drive())


def test_pending_moves_of_an_operator_without_control_are_rejected(driver: Driver) -> None:
    rig = driver.rig
    rig.take_control('A')
    rig.ask('move', ALONG % '', 'A')
    rig.asked += 1
    rig.planner.ask(replace(request(rig, UP), operator='A'), rig.now_s)
    rig.planner.ask(request(rig, UP), rig.now_s)  # of nobody, while A has control
    rig.state.hold()
    rig.settle()
    rig.take_control('B', by_force=True)
    rig.run(300)
    told = [(operator, accepted) for operator, number, accepted, _ in rig.answers if number == rig.asked]
    assert sorted(told) == [('', False), ('A', False)]
    assert len(rig.task.timeline.plan) == 1


def request(rig: Any, text: str) -> Any:
    from delta3_pacdrive.control.messages import Request

    return Request('a1b2c3d4', '', rig.asked, rig.control.changes, 'move', text)
