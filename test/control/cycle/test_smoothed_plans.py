"""Tests of plans that jump: trajectories that begin or replace each other while the robot moves, within its limits."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics, parameters
from delta3_pacdrive.control.cycle.servo import default_limits
from delta3_pacdrive.control.cycle.transformation import DISABLE_CYCLES, Transformation
from delta3_pacdrive.control.queue.tolerances import state_at
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.joint_trajectory import at_rest
from delta3_pacdrive.planning.limits.violations import compared
from delta3_pacdrive.planning.paths.path_dynamics import path_coefficients, timed_dynamics
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.planning.program.model import JointPoint, Joints, Program
from delta3_pacdrive.planning.resume import resume
from delta3_pacdrive.robot.motor import friction_torque, motor
from thoroughness import examples

ROBOT = parameters.load()
HOME = np.array([0.0, 0.0, -0.8])
ANGLES = kinematics.inverse(HOME, ROBOT.kinematics)
T, GEAR = ROBOT.bus.cycle_time_s, ROBOT.dynamics.gear_ratio
STILL = (0.0, 0.0, 0.0)
UNEVEN = np.array([0.1, 0.2, 0.15])  # [rad]
BEGIN = 10
SHARE = 1e-3  # by which a limit may be exceeded
GRID_RAD = 0.5 * math.tau / 2**19 / GEAR  # of the commands, arm side


def plan_of(points: Sequence[JointPoint], start: JointPoint) -> Plan:
    """Return the plan of a trajectory that is smoothed."""
    program = Program('joints', (Joints(tuple(points)),))
    return program_planner.plan(program, HOME, ROBOT, smoothed_from=start).plan


def single(by: float | Floats, time_s: float = 0.25) -> JointPoint:
    """Return a point without speeds."""
    return JointPoint(time_s, tuple((ANGLES + by).tolist()))


class Robot:
    """A transformation task that has begun a smoothed trajectory, and its commands: TCP, and offset from the plan."""

    def __init__(self, *points: JointPoint, smoothed: bool = True) -> None:
        self.task = task = Transformation(ROBOT)
        task.locate(ANGLES * GEAR)
        task.load(plan_of(points, at_rest(ANGLES)))
        task.start(BEGIN, smoothed=smoothed)
        self.motions: list[Floats] = []
        self.motors: list[Floats] = []

    def run(self, cycles: int) -> None:
        """Command a number of bus cycles."""
        for _ in range(cycles):
            self.motors.append(self.task.command(self.task.next_cycle).motors.copy())
            state = self.task.state[0]
            self.motions.append(np.array([state['tcp'], *state['offset'][1:], state['planned']]))

    def replace(self, *points: JointPoint, cycle: int = 0, start: JointPoint | None = None) -> None:
        """Replace the trajectory in a bus cycle, 0: 20 cycles ahead."""
        cycle = cycle or self.task.next_cycle + 20
        start = start or state_at(self.task.timeline, cycle)
        self.task.replace(plan_of(points, start), cycle, 1.0)

    def finish(self) -> None:
        """Run to the end of the program."""
        while self.task.next_cycle <= self.task.end_cycle:
            self.run(1)
            assert self.task.next_cycle < 20_000

    @property
    def derivatives(self) -> tuple[Floats, Floats, Floats]:
        """Velocity, acceleration and jerk of the commanded TCP, shape (cycles, 3)."""
        place = np.array([motion[0] for motion in self.motions])
        velocity = np.diff(place, axis=0) / T
        acceleration = np.diff(velocity, axis=0) / T
        return velocity, acceleration, np.diff(acceleration, axis=0) / T


def excess(robot: Robot) -> float:
    """Return by which share the commanded TCP exceeds its limits of acceleration and jerk."""
    limits = default_limits(ROBOT)
    _, acceleration, jerk = robot.derivatives
    sizes = np.linalg.norm(acceleration, axis=1).max(), np.linalg.norm(jerk, axis=1).max()
    return max(sizes[0] / limits.acceleration_m_s2, sizes[1] / limits.jerk_m_s3) - 1.0


def random_streams() -> Iterator[np.random.Generator]:
    yield from (np.random.default_rng(seed) for seed in range(examples(60)))


def test_random_streams_of_points_without_speeds_respect_the_limits_and_end_at_the_last_point() -> None:
    for generator in random_streams():
        robot = Robot(single(generator.uniform(-0.05, 0.25, 3)))
        target = ANGLES
        for _ in range(12):
            robot.run(int(generator.integers(10, 90)))
            cycle = robot.task.next_cycle + int(generator.integers(-20, 40))
            if cycle >= robot.task.timeline.end_cycle or robot.task.extending:
                continue
            point = single(generator.uniform(-0.05, 0.25, 3), float(generator.uniform(0.1, 0.5)))
            robot.replace(point, cycle=cycle)
            target = np.array(point.angles_rad)
        robot.finish()
        assert excess(robot) <= SHARE
        if target is not ANGLES:
            assert np.abs(robot.motors[-1] / GEAR - target).max() <= GRID_RAD
        assert not robot.task.servo.active


def test_torques_and_voltages_of_a_stream_stay_within_the_motors() -> None:
    robot = Robot(single(0.25))
    for by in (0.0, 0.25, -0.05, 0.2):
        robot.run(80)
        robot.replace(single(by))
    robot.finish()
    place = np.array([motion[0] for motion in robot.motions])
    velocity, acceleration, _ = robot.derivatives
    n = len(acceleration)
    samples = np.zeros((n, 4, 3))
    samples[:, 0], samples[:, 1], samples[:, 2] = place[1 : n + 1], velocity[:n], acceleration
    payload = np.zeros(n, np.int64)
    coefficients = path_coefficients(samples, payload, (ROBOT.dynamics.payload_mass_kg,), ROBOT)
    master = np.zeros((n, 4))
    master[:, 0], master[:, 1] = np.arange(n) * T, 1.0
    demand = timed_dynamics(master[:, 0], master, samples, coefficients, ROBOT)
    assert max(float(entry.stretch.max()) for entry in compared(demand, ROBOT)) <= 1.0 + SHARE


def test_a_replacement_with_speeds_is_followed_to_the_grid() -> None:
    """A client that continues the motion smoothly gets the trajectory that it has sent."""
    first = JointPoint(1.0, tuple((ANGLES + 0.2).tolist()), STILL, STILL)
    robot = Robot(first)
    robot.run(400)
    robot.replace(JointPoint(0.8, tuple((ANGLES + UNEVEN).tolist()), STILL, STILL))
    robot.run(25)
    away = []
    while robot.task.next_cycle <= robot.task.end_cycle:
        robot.run(1)
        tcp, _, _, planned = robot.motions[-1]
        away.append(np.linalg.norm(tcp - planned))
    # 12 um: where the jerk of the new trajectory jumps by more than the limit
    assert max(away) < 2e-5
    assert np.abs(robot.motors[-1] / GEAR - ANGLES - UNEVEN).max() <= GRID_RAD


def test_the_old_trajectory_is_followed_until_the_replacement_begins() -> None:
    first = JointPoint(1.0, tuple((ANGLES + 0.2).tolist()), STILL, STILL)
    alone, other = Robot(first), Robot(first)
    other.replace(single(0.0), cycle=500)
    for robot in (alone, other):
        robot.run(600)
    same = [np.array_equal(a, b) for a, b in zip(alone.motors, other.motors, strict=True)]
    assert same.index(False) == 500


@pytest.mark.parametrize('by', [0.0, 0.3])
def test_the_motion_of_a_trajectory_that_is_not_smoothed_continues_in_its_replacement(by: float) -> None:
    robot = Robot(JointPoint(0.8, tuple((ANGLES + 0.2).tolist()), STILL, STILL), smoothed=False)
    robot.run(400)
    robot.replace(single(by, 0.3))
    robot.finish()
    _, acceleration, jerk = (np.linalg.norm(rows, axis=1) for rows in robot.derivatives)
    begin = 420
    limits = default_limits(ROBOT)
    assert jerk[begin - 4 :].max() <= limits.jerk_m_s3 * (1.0 + SHARE)
    assert acceleration[begin - 4 :].max() <= limits.acceleration_m_s2 * (1.0 + SHARE)
    assert np.abs(robot.motors[-1] / GEAR - ANGLES - by).max() <= GRID_RAD


def test_a_replacement_that_has_begun_already_is_joined_in_progress() -> None:
    """What counts is the bus cycle of the start, not the arrival: both robots come to the same motion."""
    point = JointPoint(0.6, tuple((ANGLES + UNEVEN).tolist()), STILL, STILL)
    robots = []
    for late in (0, 40):
        robot = Robot(JointPoint(1.0, tuple((ANGLES + 0.2).tolist()), STILL, STILL))
        robot.run(400)
        start = state_at(robot.task.timeline, 420)
        robot.run(20 + late)
        robot.replace(point, cycle=420, start=start)
        robot.finish()
        assert excess(robot) <= SHARE
        robots.append(robot)
    prompt, late_one = (robot.motors[850:1020] for robot in robots)
    assert np.abs(np.array(prompt) - np.array(late_one)).max() / GEAR < 1e-5


def test_a_replacement_that_is_over_is_rejected() -> None:
    robot = Robot(JointPoint(1.0, tuple((ANGLES + 0.2).tolist()), STILL, STILL))
    robot.run(400)
    start = state_at(robot.task.timeline, 100)
    with pytest.raises(ProgramError, match='its last bus cycle 350 is over, the next one is 400'):
        robot.replace(single(0.1), cycle=100, start=start)
    assert not robot.task.extending


def test_a_hold_stops_on_the_trajectory_and_a_resumed_one_ends_at_its_point() -> None:
    robot = Robot(single(0.25, 0.6))
    robot.run(250)
    robot.task.hold()
    robot.run(1500)
    _, _, _, planned = robot.motions[-1]
    assert robot.motions[-1][0] == pytest.approx(planned, abs=1e-7)
    assert robot.motions[-1][1:3] == pytest.approx(np.zeros((2, 3)), abs=1e-5)
    robot.task.change(resume(robot.task.timeline, robot.task.next_cycle + 5, 1.0))
    robot.run(10)
    robot.finish()
    assert excess(robot) <= SHARE
    assert np.abs(robot.motors[-1] / GEAR - ANGLES - 0.25).max() <= GRID_RAD


def test_a_hard_stop_ends_the_motion_at_once_and_the_program_can_be_cleared() -> None:
    robot = Robot(single(0.25))
    robot.run(150)
    robot.task.stop_at(0, hard=True)
    robot.run(400)
    assert np.array_equal(robot.motors[-1], robot.motors[-2])
    place = robot.motions[-1][0].copy()
    robot.task.clear_program()
    robot.run(2)
    assert robot.motions[-1][0] == pytest.approx(place, abs=1e-12)
    assert not robot.task.servo.active


def test_the_torques_sent_to_the_drives_belong_to_the_smoothed_motion() -> None:
    """The feed-forward of a trajectory of arm angles counts the offset of the TCP from it."""
    robot = ROBOT.replace(control__feed_forward='model')
    task = Transformation(robot)
    task.locate(ANGLES * GEAR)
    task.load(plan_of([single(0.25)], at_rest(ANGLES)))
    task.start(BEGIN, smoothed=True)
    torques, places = [], []
    while task.next_cycle <= task.end_cycle:
        torques.append(task.command(task.next_cycle).torques.copy())
        places.append(task.state['tcp'][0].copy())
    angles = kinematics.inverse(np.array(places), robot.kinematics)
    speeds = np.gradient(angles, T, axis=0)
    needed = dynamics.inverse(angles, speeds, np.gradient(speeds, T, axis=0), robot) / GEAR
    friction = [[friction_torque(GEAR * speed, motor(robot)[0]) for speed in row] for row in speeds]
    needed += np.array(friction)
    lead = float(task.record['constants']['torque_lead'][0]) / T
    cycles = np.arange(20, len(torques) - 20)
    due = [np.interp(cycles + lead, np.arange(len(needed)), column) for column in needed.T]
    off = np.abs(np.array(torques)[cycles] - np.array(due).T)
    # 2 % of the largest torque: the offset is continued with constant acceleration over the lead of 2.6 ms
    assert off.max() < 0.02 * np.abs(needed).max()
    assert np.abs(needed).max() > 0.5


@pytest.mark.parametrize('hard', [False, True])
@pytest.mark.parametrize('cycle', [40, 120, 230, 300])
def test_a_stop_of_a_robot_that_lags_behind_its_plan_disables_the_drives_at_rest(
    cycle: int, hard: bool
) -> None:
    robot = Robot(single(0.25, 0.1))
    robot.run(cycle)
    robot.task.stop_at(0, hard=hard)
    robot.run(1)
    disabled = robot.task.disable_cycle
    robot.run(600)
    moving = [
        n for n in range(1, len(robot.motors)) if not np.array_equal(robot.motors[n], robot.motors[n - 1])
    ]
    # the increment grid hides the very end of the motion
    assert moving[-1] <= disabled - DISABLE_CYCLES + 1
    assert moving[-1] >= disabled - DISABLE_CYCLES - 60
    if not hard:
        assert excess(robot) <= SHARE
