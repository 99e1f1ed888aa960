"""``delta3 bench steering``: limits in random streams of set points, lag behind smooth ones, standstill, and cost."""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive import parameters as core
from delta3_pacdrive.belts.synchronization import Vector
from delta3_pacdrive.control.cycle.servo import default_limits
from delta3_pacdrive.control.cycle.set_points import STANDSTILL_S, SetPoint, SetPointKind
from delta3_pacdrive.control.cycle.steering import POSITION, VELOCITY, begin_at, servo_record, servo_step
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.limits.violations import compared
from delta3_pacdrive.planning.paths.path_dynamics import path_coefficients, timed_dynamics
from delta3_pacdrive.studies.framework.figure_style import COLOURS, dress, titled_figure
from delta3_pacdrive.studies.framework.report_folder import Drawings, Table
from delta3_pacdrive.studies.framework.study import OnProgress, silent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STREAMS, SEED, CYCLES = 1000, 1, 300
RATES_HZ = (20.0, 50.0, 125.0, 500.0)
JITTER_S, LOST = 0.02, 0.05
FOLLOWED_CYCLES, SETTLED_S = 3000, 0.5
LAGS_S = np.arange(-0.02, 0.06, 0.001)
PAYLOADS_KG = (0.0, 0.5, 4.0, 9.0)
SPREAD = {
    'speed_m_s': (-1.0, 1.15),
    'acceleration_m_s2': (0.0, 2.3),
    'jerk_m_s3': (1.5, 5.0),
}  # powers of ten
CENTRE = np.array([0.0, 0.0, -0.8])
AWAY_M, FREED_M = 0.02, 1e-4  # from the centre; way after which a robot has left its place
FREED_CYCLES, TIMED = 1500, 2000
MM, MS, US = 1e3, 1e3, 1e6


@dataclass
class Motion:
    """Commanded motion of the TCP: one row per bus cycle of ``cycle_time_s``, of shape (cycles, 3)."""

    place: Floats
    velocity: Floats
    acceleration: Floats
    cycle_time_s: float

    @classmethod
    def of(cls, rows: Floats, cycle_time_s: float) -> 'Motion':
        """Return the motion of rows of position, velocity and acceleration, shape (cycles, 3, 3)."""
        return cls(rows[:, 0], rows[:, 1], rows[:, 2], cycle_time_s)

    @property
    def jerk(self) -> Floats:
        """Jerk between two bus cycles [m/s^3]."""
        return np.asarray(np.diff(self.acceleration, axis=0) / self.cycle_time_s)

    @property
    def largest(self) -> tuple[float, float, float]:
        """Largest speed, acceleration and jerk."""
        speed, acceleration, jerk = (
            float(np.linalg.norm(rows, axis=1).max())
            for rows in (self.velocity, self.acceleration, self.jerk)
        )
        return speed, acceleration, jerk

    def shares(self, robot: Parameters, limits: Limits) -> dict[str, float]:
        """Return the largest share of each limit of a robot that the motion uses; above 1 it is exceeded."""
        k, n, (x, y, z) = robot.kinematics, len(self.place), self.place.T
        speed, acceleration, jerk = self.largest
        # as one path over time: the distance of the master is time itself
        samples = np.stack([self.place, self.velocity, self.acceleration, np.zeros((n, 3))], axis=1)
        c = path_coefficients(samples, np.zeros(n, np.int64), (robot.dynamics.payload_mass_kg,), robot)
        master = np.stack([np.arange(n) * self.cycle_time_s, np.ones(n), np.zeros(n), np.zeros(n)], axis=1)
        entries = compared(timed_dynamics(master[:, 0], master, samples, c, robot), robot)
        degrees = np.degrees(c[:, 0:3])
        return {
            'speed': speed / limits.speed_m_s,
            'acceleration': acceleration / limits.acceleration_m_s2,
            'jerk': jerk / limits.jerk_m_s3,
            'workspace': float(
                max(
                    np.hypot(x, y).max() / (0.5 * k.workspace_diameter_m),
                    z.min() / k.workspace_bottom_m,
                    k.workspace_top_m / z.max(),
                )
            ),
            'arm angles': float(
                max(degrees.max() / k.arm_angle_max_deg, degrees.min() / k.arm_angle_min_deg)
            ),
            'joints and singularities': float(
                max(
                    k.serial_singularity_min / c[:, 18:21].min(),
                    np.degrees(c[:, 21:24]).max() / k.forearm_swing_max_deg,
                    k.parallel_singularity_min / c[:, 24].min(),
                )
            ),
            'motors': max(float(entry.stretch.max()) for entry in entries),
        }


class SteeredRobot:
    """The transformation task of a steered robot, without drives."""

    def __init__(self, robot: Parameters, limits: Limits | None = None, home_m: Floats | None = None) -> None:
        self._cycle_time_s = robot.bus.cycle_time_s
        self.task, self.cycle = Transformation(robot), 0
        place = np.array(robot.motion.home_m if home_m is None else home_m)
        self.task.locate(kinematics.inverse(place, robot) * robot.dynamics.gear_ratio)
        self.task.servo.begin(0, limits or default_limits(robot), self.task.tracking)

    def run(self, cycles: int, feed: Callable[[float], list[SetPoint]] = lambda _: []) -> Motion:
        """Run bus cycles; ``feed`` returns the set points that arrive before a bus time [s]."""
        rows = np.empty((cycles, 3, 3))
        for n in range(cycles):
            now_s = self.cycle * self._cycle_time_s
            for point in feed(now_s):
                self.task.servo.take(point, now_s)
            self.task.command(self.cycle)
            state = self.task.state[0]
            offset = state['offset'] if state['tracks'] else np.zeros((3, 3))
            rows[n] = state['tcp'], offset[1], offset[2]
            self.cycle += 1
        return Motion.of(rows, self._cycle_time_s)


def stream(
    value: Callable[[float], Vector],
    kind: SetPointKind,
    rate_hz: float,
    seed: int = SEED,
    jitter_s: float = JITTER_S,
    lost: float = LOST,
    until_s: float = math.inf,
) -> Callable[[float], list[SetPoint]]:
    """Return the feed of a stream whose messages are late by up to ``jitter_s`` and partly lost."""
    random = np.random.default_rng(seed)

    def messages() -> Iterator[tuple[float, SetPoint]]:
        arrived = 0.0
        for n in range(10**6):
            at = n / rate_hz
            if at > until_s:
                return
            # a connection keeps the order of its messages
            arrived = max(arrived, at + random.uniform(0.0, jitter_s))
            if random.random() >= lost:
                yield arrived, SetPoint(kind, at, value(at))

    source = messages()
    waiting: list[tuple[float, SetPoint]] = []

    def feed(now_s: float) -> list[SetPoint]:
        found: list[SetPoint] = []
        while True:
            if not waiting:
                following = next(source, None)
                if following is None:
                    return found
                waiting.append(following)
            if waiting[0][0] > now_s:
                return found
            found.append(waiting.pop()[1])

    return feed


def curve(time_s: float) -> Vector:
    """Return a position on a smooth closed curve near the home position [m]."""
    angle = math.tau * 0.7 * time_s
    return 0.1 * math.cos(angle) - 0.1, 0.1 * math.sin(angle), -0.78 + 0.02 * math.sin(2.0 * angle)


def reached(motion: Motion, robot: Parameters) -> Floats:
    """Return the places that the TCP reaches in each bus cycle, a set-point delay after its commands, shape (n, 3)."""
    times = np.arange(len(motion.place)) * motion.cycle_time_s
    delay_s = robot.set_point_delay_cycles * motion.cycle_time_s
    return np.array([np.interp(times - delay_s, times, column) for column in motion.place.T]).T


def lag_s(motion: Motion, robot: Parameters) -> float:
    """Return the delay of the TCP behind ``curve`` that explains its motion best [s]."""
    times = np.arange(len(motion.place)) * motion.cycle_time_s
    settled, actual = times > SETTLED_S, reached(motion, robot)

    def deviation(lag: float) -> float:
        wanted = np.array([curve(at - lag) for at in times[settled].tolist()])
        return float(((actual[settled] - wanted) ** 2).sum())

    return float(LAGS_S[np.argmin([deviation(lag) for lag in LAGS_S.tolist()])])


def measure(count: int = STREAMS, show: OnProgress = silent) -> dict[str, Any]:
    """Return the figures; ``show`` is called with stage, number done and total number."""
    robot = core.load()
    return {
        'streams': _random_streams(robot, count, show),
        'lags': [_followed(robot, rate_hz) for rate_hz in RATES_HZ],
        'standstill': [_stopped(robot, kind) for kind in (SetPointKind.VELOCITY, SetPointKind.POSITION)],
        'step_s': _step_s(robot),
    }


def _followed(robot: Parameters, rate_hz: float) -> dict[str, float]:
    motion = SteeredRobot(robot).run(FOLLOWED_CYCLES, stream(curve, SetPointKind.POSITION, rate_hz))
    wanted = np.array([curve(n * motion.cycle_time_s) for n in range(FOLLOWED_CYCLES)])
    away = np.linalg.norm(reached(motion, robot) - wanted, axis=1)[round(SETTLED_S / motion.cycle_time_s) :]
    return {
        'rate_hz': rate_hz,
        'lag_s': lag_s(motion, robot),
        'deviation_max_m': float(away.max()),
        'jerk_max_m_s3': motion.largest[2],
    }


def _stopped(robot: Parameters, kind: SetPointKind) -> dict[str, Any]:
    last_s = 0.35

    def value(time_s: float) -> Vector:
        return (1.0, 0.0, 0.0) if kind is SetPointKind.VELOCITY else (time_s, 0.0, robot.motion.home_m[2])

    feed = stream(value, kind, 100.0, jitter_s=0.0, lost=0.0, until_s=last_s)
    motion = SteeredRobot(robot).run(1000, feed)
    moving = np.flatnonzero(np.linalg.norm(motion.velocity, axis=1) > 1e-9)[-1]
    rest_s = (moving + robot.set_point_delay_cycles) * motion.cycle_time_s
    return {'kind': str(kind), 'rest_s': float(rest_s - last_s), 'limit_s': STANDSTILL_S}


def _random_streams(robot: Parameters, count: int, show: OnProgress) -> dict[str, Any]:
    """Steer robots with random set points that jump, for random limits and payloads."""
    random, worst, dead_ends = np.random.default_rng(SEED), dict[str, float](), 0
    tasks = {
        payload: Transformation(robot.replace(dynamics__payload_mass_kg=payload)) for payload in PAYLOADS_KG
    }
    for n in range(count):
        show('streams', n, count)
        payload = float(random.choice(PAYLOADS_KG))
        task, loaded = tasks[payload], robot.replace(dynamics__payload_mass_kg=payload)
        limits = Limits(**{name: float(10.0 ** random.uniform(*powers)) for name, powers in SPREAD.items()})
        radius, azimuth = 0.6 * math.sqrt(random.random()), math.tau * random.random()
        home = np.array([radius * math.cos(azimuth), radius * math.sin(azimuth), random.uniform(-0.95, -0.7)])
        servo = servo_record(loaded, limits)
        zero = (0.0, 0.0, 0.0)
        begin_at(tuple(home.tolist()), zero, zero, servo, task.record)
        motion = _random_stream(random, home, limits, servo, task.record)
        for name, share in motion.shares(loaded, limits).items():
            worst[name] = max(worst.get(name, 0.0), share)
        dead_ends += not _can_return(servo, task.record)
    return {'count': count, 'cycles': CYCLES, 'seed': SEED, 'shares': worst, 'dead_ends': dead_ends}


def _random_stream(
    random: np.random.Generator, home: Floats, limits: Limits, servo: Any, task: Any
) -> Motion:
    """Return the motion for random positions and velocities, each for 2 to 50 bus cycles."""
    rows, every = np.empty((CYCLES, 3, 3)), int(random.choice([2, 5, 20, 50]))
    for n in range(CYCLES):
        if n % every == 0:
            servo['mode'] = random.choice([VELOCITY, POSITION])
            speeding = random.normal(0.0, limits.acceleration_m_s2, 3) * (random.random() < 0.5)
            servo['goal'] = (
                home + random.normal(0.0, 0.2, 3),
                random.normal(0.0, limits.speed_m_s, 3),
                speeding,
            )
        servo_step(servo, task)
        rows[n] = servo['p'][0], servo['v'][0], servo['a'][0]
    return Motion.of(rows, float(servo['cycle_time'][0]))


def _can_return(servo: Any, task: Any) -> bool:
    """Whether a velocity towards the centre of the workspace moves the robot from the place where it is."""
    begin = servo['p'][0].copy()
    if np.linalg.norm(begin - CENTRE) < AWAY_M:
        return True
    way_m = FREED_M * min(1.0, float(servo['speed'][0]))
    servo['mode'] = VELOCITY
    for _ in range(FREED_CYCLES):
        servo['goal'][0, 1] = 5.0 * (CENTRE - servo['p'][0])
        servo_step(servo, task)
        if np.linalg.norm(servo['p'][0] - begin) > way_m:
            return True
    return False


def _step_s(robot: Parameters) -> float:
    """Return the median time of a step, called from Python [s]."""
    task = SteeredRobot(robot).task
    servo, zero = servo_record(robot, default_limits(robot)), (0.0, 0.0, 0.0)
    begin_at((0.0, 0.0, -0.8), zero, zero, servo, task.record)
    times = []
    servo['mode'] = POSITION
    for n in range(TIMED):
        servo['goal'][0, 0] = curve(n * robot.bus.cycle_time_s)
        begin = time.perf_counter()
        servo_step(servo, task.record)
        times.append(time.perf_counter() - begin)
    return float(np.median(times))


def text(result: Mapping[str, Any]) -> Iterator[str]:
    """Yield the results as lines of text."""
    streams = result['streams']
    yield (
        f'{streams["count"]} random streams of {streams["cycles"]} bus cycles (seed {streams["seed"]}), limits over '
        f'three decades, 0 to {PAYLOADS_KG[-1]:g} kg: {streams["dead_ends"]} dead ends; largest share of a limit'
    )
    yield '  ' + ', '.join(f'{name} {100.0 * share:.2f} %' for name, share in streams['shares'].items())
    yield f'smooth stream of positions, {MS * JITTER_S:g} ms jitter, {100.0 * LOST:g} % lost'
    yield f'{"rate":>10} {"lag":>9} {"deviation":>12} {"jerk":>12}'
    for row in result['lags']:
        yield (
            f'{row["rate_hz"]:7.0f} Hz {MS * row["lag_s"]:6.0f} ms {MM * row["deviation_max_m"]:9.2f} mm '
            f'{row["jerk_max_m_s3"]:7.0f} m/s3'
        )
    rests = ', '.join(f'{one["kind"]} {MS * one["rest_s"]:.0f} ms' for one in result['standstill'])
    yield f'standstill after the last set point at 1 m/s: {rests}'
    yield f'one step: {US * result["step_s"]:.1f} us'


def table(result: Mapping[str, Any]) -> Table:
    """Return the figures of the smooth streams as a table."""
    names = list(result['lags'][0])
    return Table('lags.csv', names, [[row[name] for name in names] for row in result['lags']])


def drawings(_: Mapping[str, Any]) -> Drawings:
    """Return the drawing functions by file name."""
    return {'follow.png': partial(follow, core.load(), 50.0)}


def follow(robot: Parameters, rate_hz: float) -> 'Figure':
    """Plot the positions of a stream as they arrive, the TCP, and its speed and acceleration."""
    points: list[tuple[float, SetPoint]] = []
    feed = stream(curve, SetPointKind.POSITION, rate_hz)

    def noted(now_s: float) -> list[SetPoint]:
        found = feed(now_s)
        points.extend((now_s, point) for point in found)
        return found

    cycles = 1500
    motion = SteeredRobot(robot).run(cycles, noted)
    times = np.arange(cycles) * motion.cycle_time_s
    figure = titled_figure(
        f'A stream of {rate_hz:g} Hz with {MS * JITTER_S:g} ms jitter, {100 * LOST:g} % lost', 6.0
    )
    axes = figure.add_subplot(3, 1, 1)
    arrived = [at for at, _ in points]
    axes.plot(
        arrived,
        [MM * point.values[1] for _, point in points],
        '.',
        color=COLOURS[1],
        label='set points at arrival',
    )
    axes.plot(
        times, MM * np.array([curve(at)[1] for at in times.tolist()]), '--', color=COLOURS[2], label='curve'
    )
    axes.plot(times, MM * reached(motion, robot)[:, 1], color=COLOURS[0], label='TCP')
    dress(axes, xlabel='', ylabel='y [mm]')
    axes.legend(loc='lower left')
    sizes = (motion.velocity, 'speed [m/s]'), (motion.acceleration, 'acceleration [m/s2]')
    for n, (rows, label) in enumerate(sizes, start=2):
        axes = figure.add_subplot(3, 1, n)
        axes.plot(times, np.linalg.norm(rows, axis=1), color=COLOURS[0])
        dress(axes, xlabel='time [s]' if n == 3 else '', ylabel=label, ylim=(0.0, None))
    return figure
