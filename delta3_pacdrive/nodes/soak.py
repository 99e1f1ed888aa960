"""Random programs with random faults for as long as one likes; every telegram is held against what must always be."""

import random
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import psutil
from sensor_msgs.msg import JointState

from delta3_pacdrive import kinematics
from delta3_pacdrive import parameters as core
from delta3_pacdrive.bus.phases import DRIVES
from delta3_pacdrive.bus.time import NANOSECONDS
from delta3_pacdrive.drive.record import IMPLAUSIBLE_SPEED, SHORT_CIRCUIT
from delta3_pacdrive.errors import Delta3Error, ProgramError
from delta3_pacdrive.injection import KINDS, LOSES_AT, NODES, Place
from delta3_pacdrive.nodes import telegram
from delta3_pacdrive.nodes.attendant import Attendant
from delta3_pacdrive.nodes.bringup import Bringup, Options
from delta3_pacdrive.nodes.qos import RECORDER

HOME_M = (0.0, 0.0, -0.8)
RADIUS_M, TOP_M, BOTTOM_M = 0.35, -0.74, -0.92
MOVES_MAX = 5
DISTURBED = 0.7  # share of the programs that are disturbed
PROCESSES = 0.1  # share of the faults that befall a process
OBSERVED_S = 0.3
WARM_S = 20.0  # after which memory is measured for the first time
STOP_DEPTH_RAD = np.radians(3.0)  # by which an end stop may give way
STANDING_M = 1e-3
VIOLATIONS_SHOWN = 10


@dataclass
class Figures:
    """What a soak did.

    Attributes
    ----------
    rss_start_mb, rss_end_mb
        Memory of the processes that lived throughout.
    violations
        Sentences about what must never be and was.

    """

    programs: int = 0
    refused: int = 0
    cycles: int = 0
    injected: int = 0
    stopped: int = 0
    survived: int = 0
    lost_telegrams: int = 0
    lost_injected: int = 0
    rss_start_mb: float = 0.0
    rss_end_mb: float = 0.0
    kinds: dict[str, int] = field(default_factory=dict)
    violations: list[str] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """Whether nothing was violated and every fault was survived."""
        return not self.violations and self.survived == self.injected


class Invariants:
    """What must hold in every cycle, whatever happens."""

    def __init__(self, robot: core.Parameters, violate: Callable[[str], None]) -> None:
        motor, drive, dynamics = robot.motor, robot.drive, robot.dynamics
        self._robot, self._violate = robot, violate
        self._torque_max = SHORT_CIRCUIT * motor.peak_current_a * motor.torque_constant_n_m_a * 1.0001
        self._speed_max = motor.max_speed_rad_s * drive.overspeed_factor * IMPLAUSIBLE_SPEED
        ratio = dynamics.gear_ratio
        self._low = np.radians(dynamics.end_stop_min_deg) * ratio - STOP_DEPTH_RAD * ratio
        self._high = np.radians(dynamics.end_stop_max_deg) * ratio + STOP_DEPTH_RAD * ratio
        self._codecs = {
            'plant/motor_shafts': telegram.shafts_codec(),
            'sercos/mdt': telegram.mdt_codec(),
            **{f'sercos/at/{axis}': telegram.at_codec(axis) for axis in DRIVES},
        }
        self._last_ns = dict.fromkeys(self._codecs, -1)
        self.topics = tuple(self._codecs)

    def check(self, topic: str, telegrams: list[bytes], may_be_garbled: bool, may_repeat: bool) -> None:
        """Look at the telegrams of a topic, in the order in which they came."""
        rows = []
        for data in telegrams:
            try:
                sec, nanosec, _, values = self._codecs[topic].decode(data)
            except Delta3Error as error:
                if not may_be_garbled:
                    self._violate(f'{topic}: {error}')
                continue
            if sec < 0:
                continue
            stamp = sec * NANOSECONDS + nanosec
            if stamp <= self._last_ns[topic] and not may_repeat:
                self._violate(
                    f'{topic}: bus time {stamp / NANOSECONDS:.6f} s after {self._last_ns[topic] / NANOSECONDS:.6f} s'
                )
            self._last_ns[topic] = max(stamp, self._last_ns[topic])
            rows.append(values)
        if rows:
            self._check_values(topic, np.array(rows))

    def _check_values(self, topic: str, values: Any) -> None:
        if topic == 'plant/motor_shafts':
            positions, speeds = values[:, :3], values[:, 3:6]
            if positions.min() < self._low or positions.max() > self._high:
                self._violate(
                    f'a shaft at {positions.min():.1f} to {positions.max():.1f} rad, beyond the end stops'
                )
            if np.abs(speeds).max() > self._speed_max:
                self._violate(
                    f'a shaft turns at {np.abs(speeds).max():.1f} rad/s, the limit is {self._speed_max:.1f}'
                )
        elif topic == 'sercos/mdt':
            self._check_commands(values)
        elif np.abs(values[:, 2]).max() > self._torque_max:
            self._violate(
                f'{topic}: torque {np.abs(values[:, 2]).max():.2f} N m, the limit is {self._torque_max:.2f}'
            )

    def _check_commands(self, values: Any) -> None:
        limits = self._robot.kinematics
        tcp = kinematics.forward(values / self._robot.dynamics.gear_ratio, limits)
        radius = np.hypot(tcp[:, 0], tcp[:, 1]).max()
        low, high = tcp[:, 2].min(), tcp[:, 2].max()
        if radius > limits.workspace_diameter_m / 2 + STANDING_M:
            self._violate(f'the TCP is commanded to a radius of {radius:.4f} m')
        if low < limits.workspace_bottom_m - STANDING_M or high > limits.workspace_top_m + STANDING_M:
            self._violate(f'the TCP is commanded to z from {low:.4f} to {high:.4f} m')


class Soak(Attendant):
    """Random programs and faults on a robot that is up."""

    def __init__(
        self, bringup: Bringup, robot: core.Parameters, chance: random.Random, figures: Figures
    ) -> None:
        self._chance, self.figures = chance, figures
        self._fault: dict[str, Any] | None = None
        self._invariants = Invariants(robot, self._violate)
        self._takes: dict[str, Callable[[], Any]] = {}
        super().__init__(bringup)
        self._processes = bringup.processes
        for topic in self._invariants.topics:
            self._takes[topic] = self.operator.create_polled_subscription(JointState, topic, RECORDER)

    def _violate(self, sentence: str) -> None:
        during = f' ({self._fault})' if self._fault else ''
        self.figures.violations.append(f'{sentence}{during}')

    def look(self) -> None:
        """Hold every telegram against the invariants."""
        kind = self._fault['fault'] if self._fault else ''
        for topic, take in self._takes.items():
            telegrams = []
            while (taken := take()) is not None:
                telegrams.append(taken[0])
            if telegrams:
                repeats = kind in ('duplicate_at', 'delay_at', 'kill')
                self._invariants.check(topic, telegrams, kind == 'corrupt_at', repeats)

    def _rss_mb(self) -> dict[int, float]:
        """Resident memory of each process of the robot, by its number."""
        found = {}
        for child in self._processes():
            with suppress(psutil.NoSuchProcess):
                found[child.pid] = psutil.Process(child.pid).memory_info().rss / 1e6
        return found

    def run(self, seconds: float, show: Callable[[Figures], None]) -> None:
        """Run for a while."""
        started = time.monotonic()
        first_cycles = self.fresh()['cycles']
        cycles_before = self.figures.cycles
        measured, start = False, self._rss_mb()
        self.make_ready(HOME_M)
        while (passed := time.monotonic() - started) < seconds and len(
            self.figures.violations
        ) < VIOLATIONS_SHOWN:
            if not measured and passed > min(WARM_S, seconds / 4.0):
                measured = True
                start = self._rss_mb()
            self._run_program()
            self.figures.cycles = cycles_before + self.progress['cycles'] - first_cycles
            show(self.figures)
        end = self._rss_mb()
        survivors = start.keys() & end.keys()
        self.figures.rss_start_mb = sum(start[pid] for pid in survivors)
        self.figures.rss_end_mb = sum(end[pid] for pid in survivors)

    def _run_program(self) -> None:
        figures, chance = self.figures, self._chance
        fault = self._random_fault() if chance.random() < DISTURBED else None
        self._fault = fault
        lost = self.progress['lost_telegrams']
        try:
            self.drive(self._random_moves(), [fault] if fault else [])
        except ProgramError:
            figures.refused += 1
            self._fault = None
            return
        figures.programs += 1
        if fault:
            figures.injected += 1
            figures.kinds[fault['fault']] = figures.kinds.get(fault['fault'], 0) + 1
        reported = self.observe(OBSERVED_S + (fault['after_s'] if fault else 0.0))
        figures.stopped += bool(reported)
        if reported and not fault:
            self._violate(f'stopped without an injected fault: {reported}')
        self._count_losses(lost)
        try:
            self.make_ready(HOME_M)
            figures.survived += fault is not None
        except Delta3Error as error:
            self._violate(f'not recovered: {error}')
            self.replace_the_machine()
            self.make_ready(HOME_M)
        self._fault = None

    def _count_losses(self, before: int) -> None:
        """Compare the AT that the master misses with those that were taken away from it."""
        fault = self._fault
        lost = self.progress['lost_telegrams'] - before
        if fault and fault['fault'] in ('kill', 'freeze'):
            return  # the counter is that of a process which may be another one now
        allowed = fault['cycles'] if fault and fault['fault'] in LOSES_AT else 0
        self.figures.lost_telegrams += max(lost, 0)
        self.figures.lost_injected += allowed
        if lost > allowed:
            self._violate(f'{lost} AT lost, {allowed} were injected')

    def _random_point(self) -> list[float]:
        chance = self._chance
        radius, angle = RADIUS_M * chance.random() ** 0.5, chance.uniform(0.0, 2.0 * np.pi)
        return [radius * np.cos(angle), radius * np.sin(angle), chance.uniform(BOTTOM_M, TOP_M)]

    def _random_moves(self) -> list[dict[str, Any]]:
        chance = self._chance
        moves = []
        for _ in range(chance.randint(1, MOVES_MAX)):
            limits = {
                'speed_m_s': chance.uniform(0.3, 3.0),
                'acceleration_m_s2': chance.uniform(5.0, 40.0),
                'jerk_m_s3': chance.uniform(500.0, 8000.0),
            }
            kind = chance.choice(('l', 'l', 'l', 'c', 'sb'))
            if kind == 'l':
                blend = chance.choice((0.0, 0.0, chance.uniform(0.002, 0.03)))
                moves.append({'move_l': {'to_m': self._random_point(), 'blend_m': blend, **limits}})
            elif kind == 'c':
                moves.append(
                    {'move_c': {'via_m': self._random_point(), 'to_m': self._random_point(), **limits}}
                )
            else:
                points = [self._random_point() for _ in range(chance.randint(2, 6))]
                moves.append({'move_sb': {'through_m': points, **limits}})
        return moves

    def _random_fault(self) -> dict[str, Any]:
        """Draw a fault after which a robot can still be moved."""
        chance = self._chance
        values = {
            'jump_rad': chance.choice((0.05, -0.1, 3.0)),
            'drift_rad_s': chance.uniform(-0.5, 0.5),
            'noise_rad': chance.uniform(0.0, 1e-3),
            'voltage_v': chance.uniform(0.0, 900.0),
            'lost_share': 0.5,
            'torque_n_m': chance.uniform(-2.0, 2.0),
            'by_cycles': chance.randint(1, 8),
            'seconds': chance.uniform(0.01, 0.4),
        }
        of_processes = chance.random() < PROCESSES
        names = [
            name
            for name, kind in KINDS.items()
            if (kind.place == Place.NODE) == of_processes and name != 'clear'
        ]
        name = chance.choice(names)
        kind = KINDS[name]
        fault: dict[str, Any] = {'fault': name, 'after_s': chance.uniform(0.0, 0.8)}
        if kind.place == Place.AXIS:
            fault['axis'] = chance.choice(DRIVES)
        elif kind.place == Place.NODE:
            fault['node'] = chance.choice(NODES)
        if kind.value:
            fault[kind.value] = values[kind.value]
        if kind.telegram:
            fault['cycles'] = chance.choice((1, 1, 2, 5))
        return fault


def run_soak(
    seconds: float, seed: int, factor: float, figures: Figures, show: Callable[[Figures], None]
) -> None:
    """Bring a robot of separate processes up and soak it; adds to ``figures``, of which ``show`` is told."""
    robot = core.load()
    bringup = Bringup(Options(program=None, real_time_factor=factor))
    done = False

    def script(_: dict[str, Any]) -> None:
        nonlocal done
        if not done:
            done = True
            Soak(bringup, robot, random.Random(seed), figures).run(seconds, show)  # noqa: S311 (repeatable, not secret)
            bringup.stop()

    bringup.run(script)
