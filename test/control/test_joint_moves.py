"""Tests of trajectories of arm angles in the transformation task: grid, hold, resume and truncation."""

import math

import numpy as np
import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.paths.move import Move
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.planning.program.model import JointPoint, Joints, Program
from delta3_pacdrive.planning.resume import resume, return_plan
from thoroughness import examples

GEAR, CYCLE_S = 32.0, 1e-3
INCREMENT_RAD = math.tau / 2**19
HALF = 0.5 * INCREMENT_RAD * (1.0 + 1e-6)
HOME = (0.0, 0.0, -0.75)
STILL = (0.0, 0.0, 0.0)
BEGIN = 10
RANDOM = examples(1000)


@pytest.fixture(scope='module')
def home(robot):
    """Return the arm angles at the start."""
    return kinematics.inverse(HOME, robot.kinematics)


def plan_of(robot, points):
    return program_planner.plan(Program('joints', (Joints(tuple(points)),)), HOME, robot).plan


def as_received(plan, robot):
    """Return a plan as it comes out of its messages."""
    return Plan.of(
        [Move.from_array(move.to_array(n, 1), robot.kinematics)[0] for n, move in enumerate(plan.moves)]
    )


def started(robot, plan, cycle=BEGIN):
    """Return a task at rest at home that starts a plan at a cycle."""
    task = Transformation(robot)
    task.locate(kinematics.inverse(HOME, robot.kinematics) * GEAR)
    task.load(plan)
    task.start(cycle)
    return task


def swing(home):
    """Return two points, in the middle of which all arms move."""
    return [
        JointPoint(0.4, tuple(home + 0.15), (0.5, 0.5, 0.5), STILL),
        JointPoint(1.0, tuple(home + np.array([0.3, 0.2, 0.25])), STILL, STILL),
    ]


def random_points(generator, robot):
    """Return points in the workspace, as gentle as any robot bears, with speeds and accelerations, or without."""
    carries = int(generator.integers(0, 3))
    time, points, angles = 0.0, [], kinematics.inverse(HOME, robot.kinematics)
    for left in reversed(range(int(generator.integers(1, 5)))):
        radius, azimuth = 0.25 * math.sqrt(generator.random()), math.tau * generator.random()
        place = radius * math.cos(azimuth), radius * math.sin(azimuth), generator.uniform(-0.9, -0.78)
        # on the way there, as far as half a second allows
        angles = angles + np.clip(kinematics.inverse(place, robot.kinematics) - angles, -0.1, 0.1)
        time += CYCLE_S * int(generator.integers(400, 800))
        speeds, accelerations = (generator.uniform(-most, most, 3) * (left > 0) for most in (0.1, 0.5))
        points.append(
            JointPoint(
                time,
                tuple(angles.tolist()),
                tuple(speeds.tolist()) if carries else None,
                tuple(accelerations.tolist()) if carries > 1 else None,
            )
        )
    return points


def test_random_trajectories_are_followed_within_the_grid_at_their_points(robot):
    robot = robot.replace(gear__limit_moves=False)  # at random speeds the gears reject most of them
    generator = np.random.default_rng(2024)
    carried = set()
    for _ in range(RANDOM):
        points = random_points(generator, robot)
        plan = as_received(plan_of(robot, points), robot)
        task = started(robot, plan)
        commands = np.array([task.command(cycle).motors.copy() for cycle in range(task.end_cycle + 2)])
        for point in points:
            missed = commands[BEGIN + round(point.time_s / CYCLE_S)] - GEAR * np.array(point.angles_rad)
            assert np.abs(missed).max() <= HALF
        carried.add((points[0].speeds_rad_s is None, points[0].accelerations_rad_s2 is None))
        assert np.array_equal(commands[-1], commands[-2])
    assert len(carried) == 3


def test_between_the_points_arms_and_tcp_follow_the_polynomials(robot, home):
    plan = plan_of(robot, swing(home))
    task, move = started(robot, plan), plan.move(0)
    for cycle in range(task.end_cycle):
        motors = task.command(cycle).motors.copy()
        if cycle >= BEGIN:
            angles = sample_path([(cycle - BEGIN) * CYCLE_S], move.segments)[0, 0]
            assert np.abs(motors - GEAR * angles).max() <= HALF
            assert task.state['tcp'][0] == pytest.approx(
                kinematics.forward(angles, robot.kinematics), abs=1e-12
            )


def test_a_program_that_is_over_leaves_the_arms_where_they_are_within_the_grid(robot, home):
    task = started(robot, plan_of(robot, swing(home)))
    last = [task.command(cycle).motors.copy() for cycle in range(task.end_cycle + 1)][-1]
    task.clear_program()
    assert np.abs(task.command(task.next_cycle).motors - last).max() <= INCREMENT_RAD * (1.0 + 1e-6)


def test_a_hold_in_the_middle_stays_on_the_trajectory_and_a_resume_ends_at_the_goal(robot, home):
    points = swing(home)
    plan = plan_of(robot, points)
    task = started(robot, plan)
    commands = [task.command(cycle).motors.copy() for cycle in range(BEGIN + 500)]
    held = task.hold()
    while task.next_cycle < task.end_cycle + 50:
        commands.append(task.command(task.next_cycle).motors.copy())
    stands = task.timeline.at(task.next_cycle).distance_m
    assert held.held
    assert 0.5 < stands < 0.7
    angles = sample_path([stands], plan.move(0).segments)[0, 0]
    assert np.abs(commands[-1] - GEAR * angles).max() <= HALF
    task.change(resume(task.timeline, task.next_cycle, 1.0))
    commands.append(task.command(task.next_cycle).motors.copy())
    while task.next_cycle <= task.end_cycle:
        commands.append(task.command(task.next_cycle).motors.copy())
    assert np.abs(commands[-1] - GEAR * np.array(points[-1].angles_rad)).max() <= HALF
    steps = np.abs(np.diff(np.array(commands), axis=0)).max()
    assert steps <= GEAR * 0.9 * CYCLE_S  # no jump anywhere: as fast as the trajectory itself


def test_half_the_override_takes_twice_as_long_on_the_same_path(robot, home):
    plan = plan_of(robot, swing(home))
    task = Transformation(robot)
    task.locate(home * GEAR)
    task.load(plan)
    assert task.start(BEGIN, 0.5) == BEGIN + 2000


def test_after_a_fault_the_rest_of_a_trajectory_is_driven_from_where_it_was_left(robot, home):
    points = swing(home)
    timeline = Timeline(plan_of(robot, points), CYCLE_S)
    timeline.start(0)
    timeline.change(timeline.stop(500))
    at = timeline.plan.move(0).sample([timeline.at(timeline.end_cycle).distance_m])[0, 0]
    left = return_plan(timeline, at + np.array([0.0, 0.0, -2e-3]), robot)
    assert len(left) == 2
    assert left.move(1).start_m() == pytest.approx(at, abs=1e-9)
    assert left.end_m() == pytest.approx(kinematics.forward(np.array(points[-1].angles_rad), robot), abs=1e-9)
