"""Tests of belt tracking in the controller: dependence on bus time, continuity and stop."""

import math

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics, parameters
from delta3_pacdrive.belts import knowledge as belt_knowledge
from delta3_pacdrive.belts.camera import Sighting
from delta3_pacdrive.belts.meeting import BeltAxes
from delta3_pacdrive.belts.queue import QueuedPart
from delta3_pacdrive.belts.synchronization import Motion, TrackLimits, TrackWindow
from delta3_pacdrive.belts.tracking import JUMPS_MAX, BeltReading, BeltTracking, TrackOrder
from delta3_pacdrive.control.cycle.transformation import DISABLE_CYCLES, Transformation
from delta3_pacdrive.errors import Code
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.paths.path_dynamics import arm_motion
from delta3_pacdrive.planning.program.model import Dwell, MoveL, Output, Program, Target
from delta3_pacdrive.planning.program_planner import plan
from delta3_pacdrive.robot.motor import friction_torque, motor
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE

PER_M = 2.0**20  # so fine that its rounding does not count
WINDOW = TrackWindow(0.4, 1.0)
LIMITS = TrackLimits(4.0, 40.0, 4000.0)
BELT = BeltAxes('line', (-0.7, 0.1, -0.87), math.pi / 2.0, PER_M, WINDOW, 0.3, 0.001)
FIRST = 200  # bus cycle in which the plan gets on the belt


def never(cycle):
    return False


class Bench:
    """A belt whose travel is a function of time, and a controller that follows it."""

    def __init__(self, way, jump=None, timing='thesis'):
        self.robot = parameters.load(parameters.MODEL_CONTROLLER).replace(bus__timing=timing)
        self.tracking = BeltTracking(self.robot, [BELT])
        self.delay_s = self.robot.set_point_delay_cycles * 1e-3
        self._way, self._jump = way, jump or {}
        self.cycle, self.offsets, self._extra = 0, [], 0.0

    def run(self, to, asked=lambda cycle: cycle >= FIRST):
        """Advance to a bus cycle; record the correction of each command."""
        while self.cycle < to:
            k = self.cycle
            self.offsets.append(self.tracking.offset if self.tracking.step(k, asked(k)) else None)
            self._extra += self._jump.get(k, 0.0)
            count = math.floor(PER_M * (self._way(1e-3 * k) + self._extra))
            self.tracking.observe(k, [BeltReading(count)])
            self.cycle += 1
        return self

    def order(self, part_m, limits=LIMITS):
        self.tracking.order(TrackOrder(0, part_m, 0.7, WINDOW, limits))
        return self

    def along(self, first, last):
        """Return the corrections of the commands of some bus cycles along the belt."""
        return np.array([BELT.of_base(one).place[0] for one in self.offsets[first:last]])

    def due(self, part_m, first, last):
        """Return the distance of the part from its reference when these commands were reached."""
        times = 1e-3 * np.arange(first, last) + self.delay_s
        return part_m + np.array([self._way(time) for time in times]) - 0.7


def steady(time):
    return 0.5 * time


def braking(time):
    """0.5 m/s, and from 0.4 s on to rest with 2 m/s2."""
    late = min(max(time - 0.4, 0.0), 0.25)
    return 0.5 * min(time, 0.4) + 0.5 * late - late**2


@pytest.mark.parametrize('way', [steady, braking])
@pytest.mark.parametrize(('timing', 'delay_s'), [('thesis', 1.75e-3), ('sercos2', 2.75e-3)])
def test_once_on_the_belt_the_command_is_where_the_part_is_when_it_is_reached(way, timing, delay_s):
    bench = Bench(way, timing=timing).order(0.4).run(700)
    assert bench.delay_s == pytest.approx(delay_s, rel=1e-12)
    # of the delay and one cycle at 2 m/s2, and the lag of the filter when the belt begins to brake
    assert np.abs(bench.along(350, 700) - bench.due(0.4, 350, 700)).max() < 11e-3 * (delay_s + 1e-3)
    across = np.array([BELT.of_base(one).place[1:] for one in bench.offsets[350:700]])
    assert np.abs(across).max() < 1e-12


def test_belt_correction_is_zero_before_and_begins_and_ends_at_rest_without_a_jump():
    bench = Bench(steady).order(0.4).run(900, lambda k: FIRST <= k < 500)
    added = [n for n, one in enumerate(bench.offsets) if one is not None]
    assert added[0] == FIRST
    assert added == list(range(added[0], added[-1] + 1))
    places = np.array([one.place for one in bench.offsets[added[0] : added[-1] + 1]])
    speeds = np.diff(places, axis=0) / 1e-3
    assert np.abs(places[[0, -1]]).max() < 1e-4
    assert np.linalg.norm(np.diff(speeds, axis=0), axis=1).max() / 1e-3 < 1.1 * LIMITS.acceleration_m_s2
    assert bench.tracking.free


def test_no_synchronization_without_a_command():
    bench = Bench(steady).run(FIRST + 1)
    assert bench.tracking.free
    assert 'gets on a belt in bus cycle 200, but no belt has been selected' in bench.tracking.lost.sentence


def test_a_part_that_leaves_the_window_is_lost_with_the_number_of_the_cycle():
    bench = Bench(steady).order(0.4).run(1300)
    assert bench.tracking.lost.code is Code.BELT
    assert 'belt line in bus cycle 1199: the part is at 1000.4 mm, the window ends at 1000.0 mm' in str(
        bench.tracking.lost.sentence
    )


def test_belt_that_returns_the_part_out_of_the_window_is_reported():
    bench = Bench(lambda time: -0.3 * time).order(0.6).run(800)
    assert (
        'or runs backwards, the part is at 394.9 mm, and the window begins at 400.0 mm'
        in bench.tracking.lost.sentence
    )


def test_halted_tracking_comes_to_rest_and_synchronizes_again_from_there():
    bench = Bench(steady).order(0.4).run(400)
    bench.tracking.halt(400)
    rest = bench.tracking.rest_cycle
    assert 400 < rest < 440
    bench.run(500)
    stood = bench.along(rest + 1, 500)
    assert np.ptp(stood) == 0.0
    assert stood[0] - bench.along(399, 400)[0] == pytest.approx(0.5 * 0.5 * (rest - 400) * 1e-3, abs=5e-4)
    back_s = bench.tracking.back_s(500)
    bench.tracking.again_cycle = 500
    bench.tracking.resume()
    on = 500 + math.ceil(back_s / 1e-3) + 1
    bench.run(on + 100)
    assert np.abs(bench.along(on, on + 100) - bench.due(0.4, on, on + 100)).max() < 30e-6


def test_work_finished_during_a_halt_is_left():
    bench = Bench(steady).order(0.4).run(400, lambda k: k >= FIRST)
    bench.tracking.halt(400)
    bench.run(500, lambda k: k < 410)
    assert not bench.tracking.works
    left = 500 + math.ceil(bench.tracking.back_s(500) / 1e-3)
    bench.tracking.again_cycle = 500
    bench.tracking.resume()
    bench.run(left + 1, never)
    assert bench.tracking.free
    assert bench.offsets[left] is None


def test_second_halt_before_the_continuation_keeps_it_at_rest():
    bench = Bench(steady).order(0.4).run(400)
    bench.tracking.halt(400)
    bench.run(450)
    bench.tracking.again_cycle = 470
    bench.tracking.resume()
    bench.run(460)
    bench.tracking.halt(460)
    assert np.ptp(bench.run(600).along(450, 600)) == 0.0


def test_a_hard_stop_takes_over_from_a_soft_one_until_that_is_over():
    bench = Bench(steady).order(0.4).run(400)
    bench.tracking.halt(400)
    soft = bench.tracking.rest_cycle
    bench.run(405)
    bench.tracking.halt(405, hard=True)
    rest = bench.tracking.rest_cycle
    assert 405 < rest < soft
    bench.run(rest + 10)
    bench.tracking.halt(rest + 10, hard=True)
    assert bench.tracking.rest_cycle == rest
    assert np.abs(np.diff(bench.along(395, rest + 10), n=2)).max() / 1e-6 < 205.0


def test_belt_too_fast_at_synchronization_is_lost_without_correction():
    bench = Bench(lambda time: 5.0 * time).order(-0.5).run(FIRST + 50)
    assert bench.tracking.lost.code is Code.BELT
    assert 'belt line in bus cycle 200: a belt of 5.0' in bench.tracking.lost.sentence
    assert np.abs(bench.along(FIRST, FIRST + 50)).max() == 0.0


def test_belt_that_exceeds_the_speed_limit_of_the_robot_is_lost():
    def quicker(time):
        return 0.5 * time + max(time - 0.4, 0.0) ** 2

    bench = Bench(quicker).order(0.5, TrackLimits(0.6, 40.0, 4000.0)).run(500)
    assert bench.tracking.lost.code is Code.BELT
    assert 'the robot at 0.6 m/s at most' in bench.tracking.lost.sentence


def test_a_hard_stop_is_as_hard_as_a_fault_may_be():
    rests = []
    for hard in (False, True):
        bench = Bench(steady).order(0.4).run(400)
        bench.tracking.halt(400, hard)
        rests.append(bench.tracking.rest_cycle)
    assert rests[1] < rests[0]


def test_released_the_robot_is_free_and_the_next_order_counts():
    bench = Bench(steady).order(0.4).run(400)
    bench.tracking.halt(400)
    bench.run(450)
    bench.tracking.clear()
    assert bench.tracking.free
    assert bench.tracking.lost is None
    bench.order(0.3).run(800, lambda k: k >= 470)
    assert np.abs(bench.along(650, 800) - bench.due(0.3, 650, 800)).max() < 30e-6


def test_encoder_jump_moves_nothing_and_repeated_jumps_are_reported():
    bench = Bench(steady, {400: 0.03}).order(0.4).run(600)
    assert bench.tracking.observed.jumps[0] == 1
    assert bench.tracking.lost is None
    assert np.abs(bench.along(400, 600) - bench.due(0.4, 400, 600)).max() < 0.2e-3
    often = {400 + 60 * n: 0.03 for n in range(JUMPS_MAX + 1)}
    bench = Bench(steady, often).order(0.4).run(700)
    assert (
        'its encoder has jumped 4 times, so the position of the part is unknown'
        in bench.tracking.lost.sentence
    )


def test_latch_gives_the_position_of_the_part_less_the_barrier_delay():
    tracking = Bench(steady).run(300, never).tracking
    tracking.observe(300, [BeltReading(math.floor(PER_M * 0.15), (math.floor(PER_M * 0.14),))])
    (part,) = tracking.take_parts(0)
    # 1 ms at 0.5 m/s
    assert part.along_m == pytest.approx(0.3 - 0.14 + 0.0005, abs=5e-6)


def test_camera_reports_type_position_and_angle_with_the_number_of_its_picture():
    tracking = Bench(steady).run(300, never).tracking
    seen = Sighting('bar', 0.5, 0.02, 0.3, math.floor(PER_M * 0.1))
    tracking.observe(300, [BeltReading(math.floor(PER_M * 0.15), (), (seen,))])
    (part,) = tracking.take_parts(0)
    assert part == QueuedPart('bar', pytest.approx(0.4, abs=2e-6), 0.02, 0.3, belt='line')


def test_bouncing_light_barrier_reports_a_part_once():
    bench = Bench(steady).run(300, never)
    latched = tuple(math.floor(PER_M * way) for way in (0.14, 0.141, 0.143))
    bench.tracking.observe(300, [BeltReading(math.floor(PER_M * 0.15), latched)])
    (part,) = bench.tracking.take_parts(0)
    assert part.along_m == pytest.approx(0.3 - 0.14 + 0.0005, abs=5e-6)
    assert bench.tracking.observed.bounced[0] == 2


def test_camera_without_pictures_beyond_the_time_limit_is_dead():
    belt = BELT._replace(camera_every_m=0.1)
    tracking = BeltTracking(parameters.load(), [belt])
    for cycle in range(761):
        pictures = min(math.floor(0.5e-3 * cycle / 0.1), 1)  # none behind the first one
        tracking.observe(cycle, [BeltReading(math.floor(PER_M * 0.5e-3 * cycle), (), (), pictures)])
        if cycle == 690:
            assert tracking.blind_m(0) == 0.0
    assert tracking.blind_m(0) == pytest.approx(0.28, abs=1e-3)


class Controlled(Bench):
    """A controller whose plan synchronizes with the belt, moves on it, and leaves it."""

    def __init__(self):
        super().__init__(steady)
        self.task = Transformation(self.robot)
        self.task.follow_belts([BELT])
        self.tracking = self.task.tracking
        self.task.locate(
            kinematics.inverse((0.0, 0.0, -0.8), self.robot.kinematics) * self.robot.dynamics.gear_ratio
        )
        limits = Limits(2.0, 20.0, 2000.0)
        moves = (
            Output('track', 1.0),
            MoveL(limits=limits, to=Target((0.0, 0.05, -0.82))),
            Dwell(0.3),
            MoveL(limits=limits, to=Target((0.0, 0.0, -0.8))),
            Output('track', 0.0),
        )
        self.task.load(plan(Program('work', moves), (0.0, 0.0, -0.8), self.robot).plan)
        self.tcp, self.torque = [], []

    def go_on(self, to):
        """Go on to a bus cycle; keep where the TCP is commanded to be, and whether the drives are to have torque."""
        while self.cycle < to:
            self.task.command(self.cycle)
            self.tcp.append(self.task.state['tcp'][0].copy())
            self.torque.append(self.task.control(self.cycle) & CONTROL_ENABLE == CONTROL_ENABLE)
            count = math.floor(PER_M * self._way(1e-3 * self.cycle))
            self.tracking.observe(self.cycle, [BeltReading(count)])
            self.cycle += 1
        return self


@pytest.mark.parametrize('hard', [False, True])
def test_fault_on_the_belt_stops_path_and_belt_motion_and_then_disables_torque(hard):
    bench = Controlled().order(0.4)
    bench.task.enable(20)
    bench.task.start(FIRST)
    bench.go_on(FIRST + 350)
    bench.task.stop_at(FIRST + 350, hard)
    bench.go_on(FIRST + 500)
    tcp = np.array(bench.tcp)
    stands = np.flatnonzero(np.abs(np.diff(tcp, axis=0)).max(axis=1) > 0.0)[-1] + 1
    speed = np.linalg.norm(np.diff(tcp[FIRST + 340 : FIRST + 350], axis=0), axis=1) / 1e-3
    assert speed.min() > 0.45  # it went with the belt
    assert stands < FIRST + (360 if hard else 390)
    assert bench.task.end_cycle in range(stands, stands + 3)
    # the torque stays until it stands, and for as long as a drive needs to see that
    assert bench.tracking.rest_cycle <= bench.task.end_cycle
    off = bench.task.end_cycle + DISABLE_CYCLES
    assert np.flatnonzero(bench.torque).tolist() == list(range(20, off))


def test_plan_synchronizes_leaves_and_ends_at_the_given_positions():
    bench = Controlled().order(0.4)
    bench.task.start(FIRST)
    bench.go_on(FIRST + 1000)
    assert bench.tracking.free
    assert bench.tcp[-1].tolist() == bench.task.state['planned'][0].tolist()
    assert bench.tcp[-1] == pytest.approx((0.0, 0.0, -0.8), abs=1e-12)
    assert bench.task.outputs == 0


def test_torques_on_a_belt_are_those_of_the_whole_motion():
    offset = Motion((0.05, -0.02, 0.01), (0.8, -0.3, 0.2), (6.0, 9.0, -4.0))
    robot = parameters.load(parameters.MODEL_CONTROLLER)
    task = Transformation(robot)
    task.locate(kinematics.inverse((0.0, 0.0, -0.8), robot.kinematics) * robot.dynamics.gear_ratio)
    task.state['tracks'], task.state['offset'] = 1, offset
    task.command(0)
    lead = robot.drive.position_period_s + robot.torque_dead_time_s
    place, velocity, acceleration = (np.array(one) for one in offset)
    there = (0.0, 0.0, -0.8) + place + lead * velocity + 0.5 * lead**2 * acceleration
    theta = kinematics.inverse(there, robot.kinematics)
    along = tuple(there), tuple(velocity + lead * acceleration), tuple(acceleration)
    rates, bends = arm_motion(tuple(theta), along, 1.0, 0.0, kinematics.geometry(robot.kinematics)[0])
    ratio = robot.dynamics.gear_ratio
    due = dynamics.inverse(theta, np.array(rates), np.array(bends), robot) / ratio
    due += [friction_torque(ratio * rate, motor(robot)[0]) for rate in rates]
    assert task.torques == pytest.approx(due, rel=1e-9)


def test_unclaimed_parts_are_the_newest_and_older_ones_are_counted(monkeypatch):
    monkeypatch.setattr(belt_knowledge, 'PARTS_MAX', 3)
    tracking = BeltTracking(parameters.load(), [BELT])
    counts = [math.floor(PER_M * 0.1 * n) for n in range(5)]
    for cycle, count in enumerate(counts):
        tracking.observe(cycle, [BeltReading(math.floor(PER_M * 0.01), (count,))])
    assert tracking.observed.dropped[0] == 2
    taken = tracking.take_parts(0)
    assert [part.along_m for part in taken] == pytest.approx([0.3 - 0.1 * n for n in (2, 3, 4)], abs=1e-3)
    assert tracking.take_parts(0) == []
    tracking.observe(5, [BeltReading(math.floor(PER_M * 0.01), (counts[-1] + 1,))])
    assert tracking.observed.bounced[0] == 1  # the last one that was told is not forgotten


@pytest.mark.parametrize('jump_m', [0.03, -0.03])
def test_part_in_a_picture_before_a_jump_keeps_its_position_of_then(jump_m):
    speed, taken = 0.3, 120
    bench = Bench(lambda time: speed * time).run(taken, never)

    def observed(extra_m, *sighted, pictures):
        count = math.floor(PER_M * (speed * 1e-3 * bench.cycle + extra_m))
        bench.tracking.observe(bench.cycle, [BeltReading(count, sighted=sighted, pictures=pictures)])
        bench.cycle += 1
        return count

    there_m = 0.2 - speed * 1e-3 * taken
    count = observed(0.0, pictures=1)
    for _ in range(80):
        observed(jump_m, pictures=1)
    observed(jump_m, Sighting('bar', 0.2, 0.0, 0.0, count), pictures=1)
    (part,) = bench.tracking.take_parts(0)
    assert bench.tracking.observed.jumps[0] == 1
    assert part.along_m == pytest.approx(there_m, abs=1e-5)
