"""Tests of the extension of a running plan: fixed part, checks and continuity."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.extension import (
    Extension,
    RunningProgram,
    Splice,
    SpliceError,
    extend,
    extended_program,
)
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.plan import EXTENDED_MOVES_MAX
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.planning.program.model import Dwell, MoveL, Program, Target
from delta3_pacdrive.planning.program_planner import Planned

JOINTS = 'moves: [{joints: {points: [{time_s: 1.2, angles_rad: [0.3, 0.4, 0.2], speeds_rad_s: [0, 0, 0]}]}}]'
HOME = (0.0, 0.0, -0.75)
CYCLE_S = 1e-3
LIMITS = Limits(0.4, 12.0, 400.0)
FIRST = MoveL(Target((0.1, 0.0, -0.75)), limits=LIMITS)
SECOND = MoveL(Target((0.1, 0.1, -0.75)), limits=LIMITS)


class Drive:
    """A program that is driven from bus cycle 100 on."""

    def __init__(self, robot: Any, *statements: Any, override: float = 1.0) -> None:
        self.robot = robot
        self.program = Program('driven', statements)
        self.planned = program_planner.plan(self.program, HOME, robot, open_end=True)
        self.known = RunningProgram.of(self.program, self.planned)
        self.timeline = Timeline(self.planned.plan, CYCLE_S)
        self.timeline.start(100, override)

    def follow(self, cycle: int, *statements: Any, rounded: bool = True) -> tuple[Extension, Splice, Planned]:
        splice = self.known.splice(rounded)
        program = Program('more', (*splice.again, *statements), payload_kg=splice.payload_kg)
        planned = program_planner.plan(program, splice.start_m, self.robot, open_end=True)
        extension = extend(self.timeline, cycle, splice, planned.plan)
        self.known = extended_program(self.known, extension, splice, program, planned)
        return extension, splice, planned


def place(timeline: Timeline, cycle: int) -> np.ndarray:
    now = timeline.at(cycle)
    return sample_path([now.distance_m], timeline.plan.move(now.number).segments)[0, 0]


@pytest.mark.parametrize('override', [1.0, 0.3, 1.5])
def test_executed_moves_continue_unchanged_to_their_end(override: float, robot: Any) -> None:
    drive = Drive(robot, FIRST, override=override)
    extension, _, _ = drive.follow(150, SECOND)
    before, after = drive.timeline, extension.timeline
    for cycle in range(150, before.end_cycle):
        assert np.abs(place(before, cycle) - place(after, cycle)).max() < 1e-12
    assert len(after.plan) == 2
    assert np.abs(place(after, after.end_cycle) - [0.1, 0.1, -0.75]).max() < 1e-9


def test_moves_that_were_driven_are_left_out(robot: Any) -> None:
    drive = Drive(robot, FIRST, SECOND, FIRST)
    cycle = drive.timeline.end_cycle - 30
    extension, _, _ = drive.follow(cycle, SECOND)
    assert (extension.first, extension.kept) == (2, 3)
    assert len(extension.timeline.plan) == 2
    assert [end and end[0] for end in drive.known.ends] == [0, 1]
    assert drive.known.statements == (FIRST, SECOND)
    assert len(drive.known.loads) == len(extension.timeline.plan.moves)


def test_dwell_continues_for_its_remaining_time(robot: Any) -> None:
    drive = Drive(robot, Dwell(0.5))
    extension, _, _ = drive.follow(300, SECOND)
    after = extension.timeline
    assert after.end_cycle - drive.timeline.end_cycle == pytest.approx(
        extension.more.duration_s / CYCLE_S, abs=1.0
    )
    assert np.abs(place(after, 599) - HOME).max() < 1e-12


def test_corner_is_rounded_before_its_blend_only(robot: Any) -> None:
    blended = replace(FIRST, blend_m=0.03)
    drive = Drive(robot, blended)
    extension, splice, _ = drive.follow(150, SECOND)
    assert (splice.kept, splice.again) == (0, (blended,))
    assert splice.common_m == pytest.approx(0.07, abs=1e-5)
    path = np.array([place(extension.timeline, cycle) for cycle in range(150, extension.timeline.end_cycle)])
    assert np.linalg.norm(path - [0.1, 0.0, -0.75], axis=1).min() > 1e-3
    late = Drive(robot, blended)
    behind = next(c for c in range(150, 9999) if late.timeline.at(c).distance_m > 0.071)
    with pytest.raises(SpliceError, match='rounded'):
        late.follow(behind, SECOND)
    from_rest, _, _ = late.follow(behind, SECOND, rounded=False)
    assert (from_rest.first, from_rest.kept) == (0, 1)
    held = Drive(robot, blended)
    held.timeline.change(held.timeline.stop(behind))
    with pytest.raises(SpliceError, match='rounded'):
        held.follow(held.timeline.end_cycle, SECOND)


def test_a_plan_that_would_let_the_tcp_jump_is_rejected(robot: Any) -> None:
    drive = Drive(robot, FIRST)
    extension, _, _ = drive.follow(150, SECOND)
    plan, profile = extension.timeline.plan, extension.profile
    for column, step in ((1, 1e-4), (2, 1e-3), (3, 0.1)):
        table = profile.table.copy()
        table[0, column] += step
        with pytest.raises(ProgramError, match='does not continue the motion'):
            drive.timeline.extended(plan, replace(profile, table=table))
    elsewhere = Drive(robot, MoveL(Target((0.0, 0.1, -0.75)), limits=LIMITS)).planned.plan
    with pytest.raises(ProgramError, match='does not continue the motion'):
        drive.timeline.extended(elsewhere, profile)
    with pytest.raises(ProgramError, match='does not follow the present one'):
        drive.timeline.extended(plan, replace(profile, held=True))
    with pytest.raises(ProgramError, match='does not follow the present one'):
        drive.timeline.extended(plan, replace(profile, number=7))


def test_moves_that_begin_elsewhere_or_are_too_many_are_rejected(robot: Any) -> None:
    drive = Drive(robot, FIRST)
    more = drive.planned.plan
    with pytest.raises(ProgramError, match='away from the end of the previous one'):
        drive.planned.plan.extended(0, 1, more)
    with pytest.raises(ProgramError, match='cannot be kept'):
        drive.planned.plan.extended(0, 2, more)
    many = program_planner.plan(
        Program('many', tuple(Dwell(0.01 + 1e-6 * n) for n in range(EXTENDED_MOVES_MAX))),
        (0.1, 0.0, -0.75),
        robot,
    )
    with pytest.raises(ProgramError, match='can be extended only while'):
        drive.planned.plan.extended(0, 1, many.plan)


def test_rms_current_of_the_remainder_is_kept(robot: Any) -> None:
    hard = Limits(3.0, 60.0, 6000.0)
    swing = tuple(MoveL(Target((x, 0.0, -0.85)), limits=hard) for x in (0.3, -0.3) * 4)
    nominal = robot.motor.nominal_current_a
    first = program_planner.plan(Program('swing', swing, payload_kg=10.0), HOME, robot)
    known = RunningProgram.of(Program('swing', swing, payload_kg=10.0), first)
    end = first.plan.end_m()
    load = known.load(0, len(first.plan))
    assert load is not None
    alone = program_planner.plan(Program('more', (Dwell(5.0), *swing), payload_kg=10.0), end, robot)
    behind = program_planner.plan(
        Program('more', (Dwell(5.0), *swing), payload_kg=10.0), end, robot, before=load
    )
    total = load + RunningProgram.of(Program('more', (Dwell(5.0), *swing)), behind).load(0, len(behind.plan))  # type: ignore[operator]
    assert load.rms(1.0).max() <= nominal * 1.001
    assert total.rms(1.0).max() <= nominal * 1.001
    assert behind.rms_current_a[0] == pytest.approx(float(total.rms(1.0)[0]), rel=1e-6)
    assert behind.rate <= alone.rate


def test_moves_follow_a_path_of_arm_angles_as_well(robot: Any) -> None:
    document = yaml_file.parse(JOINTS, 'joints', ProgramError)
    statement = program_file.parse(document, robot.motion).statements[0]
    drive = Drive(robot, statement)
    here = drive.planned.plan.end_m()
    extension, _, _ = drive.follow(150, MoveL(Target((here[0], here[1], here[2] - 0.02)), limits=LIMITS))
    assert extension.timeline.plan.tables.moves['joints'].tolist() == [1, 0]
    end = extension.timeline.at(extension.timeline.end_cycle)
    assert (end.number, end.distance_m) == (1, pytest.approx(0.02, abs=1e-9))


def test_no_longer_plan_looks_like_the_start_of_a_program(robot: Any) -> None:
    # a recording takes a single phase at 0 of the first move for a start
    for statement in (Dwell(0.1), FIRST):
        end = Drive(robot, statement).timeline.end_cycle
        for cycle in (102, 150, end - 1, end, end + 500):
            drive = Drive(robot, statement)
            here = drive.planned.plan.end_m()
            up = MoveL(Target((here[0], here[1], here[2] - 0.01)), limits=LIMITS)
            extension, _, _ = drive.follow(cycle, up)
            assert len(extension.profile.table) > 1, (statement, cycle)
