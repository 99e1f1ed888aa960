"""Tests of the path for views: complete, from accepted orders only, and available to late subscribers."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.control.cycle.planned_path import PIECES_MAX, POINTS_MAX, STEP_M, PlannedPath
from delta3_pacdrive.control.messages import EXTEND, ORDER, Origin, Status
from delta3_pacdrive.errors import ProgramError, TelegramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.extension import RunningProgram, extend, extended_program
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.planning.program.model import MoveL, Program, Target

HOME = (0.0, 0.0, -0.75)
A, B, C = (0.1, 0.0, -0.75), (0.1, 0.1, -0.75), (0.0, 0.1, -0.75)
CYCLE_S = 1e-3
LIMITS = Limits(0.4, 12.0, 400.0)
Rows = list[tuple[str, Any]]


def line(to: tuple[float, float, float], blend_m: float = 0.0) -> MoveL:
    return MoveL(Target(to), limits=LIMITS, blend_m=blend_m)


def label(kind: str, number: int, session: str = '5e55') -> str:
    return Origin(kind, 'one', session, number).label()


def moves_of(plan: Plan, number: int) -> Rows:
    count = len(plan.moves)
    return [(label(move.kind.name, number), move.to_array(n, count)) for n, move in enumerate(plan.moves)]


def ordered(plan: Plan, number: int) -> Rows:
    order = np.concatenate([[-1.0, 1.0], plan.tables.order])
    return [*moves_of(plan, number), (label(ORDER, number), order)]


def status(order: int, session: str = '5e55') -> Status:
    return Status(session, '', 1, 'one', 'moving', 'CP4', '', '', 1, HOME, 0, '', '', 0, order, 0, 0)


def take(path: PlannedPath, rows: Rows) -> None:
    for row in rows:
        path.take(*row)


def comes_near(path: PlannedPath, *places: Any) -> bool:
    apart = np.linalg.norm(path.points_m[:, None] - np.array(places), axis=2).min(axis=0)
    return bool((apart < 1e-9).all())


class Stream:
    """A moving robot that receives further moves."""

    def __init__(self, robot: Any, *statements: Any) -> None:
        self.robot = robot
        program = Program('driven', statements)
        planned = program_planner.plan(program, HOME, robot, open_end=True)
        self.known, self.number = RunningProgram.of(program, planned), 1
        self.timeline = Timeline(planned.plan, CYCLE_S)
        self.timeline.start(100)
        self.rows = ordered(planned.plan, 1)

    def follow(self, cycle: int, *statements: Any) -> Rows:
        """Return the rows of moves that follow from a bus cycle on."""
        splice = self.known.splice(rounded=True)
        program = Program('more', (*splice.again, *statements), payload_kg=splice.payload_kg)
        planned = program_planner.plan(program, splice.start_m, self.robot, open_end=True)
        extension = extend(self.timeline, cycle, splice, planned.plan)
        self.known = extended_program(self.known, extension, splice, program, planned)
        self.timeline, self.number = extension.timeline, self.number + 1
        row = extension.row(self.number - 1)
        return [*moves_of(planned.plan, self.number), (label(EXTEND, self.number), row)]


@pytest.fixture
def path(robot: Any) -> PlannedPath:
    return PlannedPath(robot.kinematics)


@pytest.fixture(scope='module')
def plan(robot: Any) -> Plan:
    document = {'moves': [{'move_l': {'to_m': list(place)}} for place in (A, B)], 'repeat': 3}
    return program_planner.plan(program_file.parse(document, robot.motion), HOME, robot).plan


def test_the_path_of_an_order_is_shown_once_it_is_accepted(path: PlannedPath, plan: Plan) -> None:
    take(path, ordered(plan, 1))
    assert not len(path.points_m)
    path.update(status(1))
    assert comes_near(path, HOME, A, B)
    # in rounds each different move is drawn once
    steps = np.linalg.norm(np.diff(path.points_m, axis=0), axis=1)
    assert steps.max() <= STEP_M
    assert path.changes == 1


def test_late_plan_is_shown_with_its_earlier_acceptance(path: PlannedPath, plan: Plan) -> None:
    path.update(status(1))
    take(path, ordered(plan, 1)[:-1])
    assert not len(path.points_m)
    take(path, ordered(plan, 1)[-1:])
    assert comes_near(path, HOME, A, B)
    path.update(status(1))
    assert path.changes == 1


def test_an_order_that_is_rejected_is_never_shown(path: PlannedPath, plan: Plan, robot: Any) -> None:
    take(path, ordered(plan, 1))
    path.update(status(1))
    other = Stream(robot, line(C))
    for number in range(2, 30):
        take(path, ordered(other.timeline.plan, number))
        path.update(status(1))
    assert comes_near(path, A, B)
    assert not comes_near(path, C)
    # the order that is driven is known however many others were refused
    path.use(robot.kinematics)
    assert comes_near(path, A, B)


def test_following_moves_extend_the_path_and_keep_the_driven_part(robot: Any, path: PlannedPath) -> None:
    stream = Stream(robot, line(A))
    take(path, stream.rows)
    path.update(status(1))
    take(path, stream.follow(150, line(B)))
    assert not comes_near(path, B)
    path.update(status(2))
    assert comes_near(path, HOME, A, B)
    # the first move has been driven, and is no part of the plan any more
    take(path, stream.follow(stream.timeline.end_cycle - 20, line(C)))
    path.update(status(3))
    assert comes_near(path, HOME, A, B, C)
    assert np.linalg.norm(np.diff(path.points_m, axis=0), axis=1).max() <= STEP_M


def test_a_corner_that_is_rounded_when_moves_follow_is_drawn_as_it_is_driven(
    robot: Any, path: PlannedPath
) -> None:
    stream = Stream(robot, line(A, blend_m=0.02))
    take(path, stream.rows)
    path.update(status(1))
    assert comes_near(path, HOME, A)
    take(path, stream.follow(120, line(B)))
    path.update(status(2))
    assert comes_near(path, HOME, B)
    apart = np.linalg.norm(path.points_m - A, axis=1).min()
    assert 2e-3 < apart < 0.02


def test_late_viewer_shows_later_messages(robot: Any, path: PlannedPath) -> None:
    stream = Stream(robot, line(A))
    take(path, stream.follow(150, line(B)))
    path.update(status(2))
    assert comes_near(path, A, B)
    assert not comes_near(path, HOME)
    take(path, stream.follow(stream.timeline.end_cycle - 20, line(C)))
    path.update(status(3))
    assert comes_near(path, A, B, C)


def test_of_a_move_that_is_resumed_the_rest_is_shown(robot: Any, path: PlannedPath, plan: Plan) -> None:
    first = plan.moves[0]
    share = 1.0 - 0.05 / first.length_m
    table = first.master * [1.0, share, share, share, share] + [0.0, 0.05, 0.0, 0.0, 0.0]
    rest = replace(first, master=table)
    path.take(label('LINE', 1), rest.to_array(0, 1))
    path.take(label(ORDER, 1), np.array([-1.0, 1.0, 0.0]))
    path.update(status(1))
    assert comes_near(path, first.sample([0.05])[0, 0], A)
    assert not comes_near(path, HOME)


def test_path_of_arm_angles_uses_the_latest_known_robot(robot: Any) -> None:
    text = '{joints: {points: [{time_s: 1.2, angles_rad: [0.3, 0.4, 0.2], speeds_rad_s: [0, 0, 0]}]}}'
    document = yaml_file.parse(f'moves: [{text}]', 'a program', ProgramError)
    planned = program_planner.plan(program_file.parse(document, robot.motion), HOME, robot)
    path = PlannedPath(robot.replace(kinematics__forearm_length_m=0.9).kinematics)
    take(path, ordered(planned.plan, 1))
    path.update(status(1))
    assert not comes_near(path, planned.plan.end_m())
    path.use(robot.kinematics)
    assert comes_near(path, planned.plan.end_m())


def test_a_path_of_a_session_that_is_over_is_not_shown(path: PlannedPath, plan: Plan) -> None:
    take(path, ordered(plan, 1))
    path.update(status(1))
    path.update(status(0))  # the planner was started again
    assert len(path.points_m)
    path.update(status(0, session='0ff5'))
    assert not len(path.points_m)


def test_a_plan_of_thousands_of_moves_is_drawn_with_fewer_points(path: PlannedPath, plan: Plan) -> None:
    count = 3 * PIECES_MAX
    for n in range(count):
        path.take(label('LINE', 1), plan.moves[n % 2].to_array(n, count))
    path.take(label(ORDER, 1), np.arange(-2.0, count))
    path.update(status(1))
    assert POINTS_MAX / 2 < len(path.points_m) <= POINTS_MAX


@pytest.mark.parametrize(
    ('text', 'row', 'error'),
    [
        ('ORDER', [], TelegramError),
        (label('LINE', 1), [1.0], ProgramError),
        (label(EXTEND, 1), [1.0, 0.0], ProgramError),
    ],
)
def test_invalid_row_of_a_plan_is_rejected(path: PlannedPath, text: str, row: Any, error: Any) -> None:
    with pytest.raises(error):
        path.take(text, np.array(row))
    path.take(label(ORDER, 1), np.array([-1.0, 1.0, np.nan, 1e300, -5.0]))
    path.take(label('ABRACADABRA', 1), np.array([1.0]))
    path.update(status(1))
    assert not len(path.points_m)


def test_move_beyond_the_range_of_numbers_is_not_shown(path: PlannedPath, plan: Plan) -> None:
    slow = np.array([1e2, 5e306, 5e304, 5e302, 5e300])  # so that no jerk is infinite
    row = replace(plan.moves[0], master=slow * plan.moves[0].master).to_array(0, 1)
    take(path, [(label('LINE', 1), row), (label(ORDER, 1), np.array([-1.0, 1.0, 0.0]))])
    path.update(status(1))
    assert np.isfinite(path.points_m).all()
