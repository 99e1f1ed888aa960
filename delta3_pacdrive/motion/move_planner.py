"""Timing and checks of one move: the fastest master over its path that keeps every limit, and what it costs."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion import time_parametrization
from delta3_pacdrive.motion.blending import PathSegment, lower, name_of
from delta3_pacdrive.motion.curves import Curve
from delta3_pacdrive.motion.limits import Excess, Limits, check_arms, check_workspace, excess
from delta3_pacdrive.motion.path import sample_path
from delta3_pacdrive.motion.path_dynamics import (
    CENTRIFUGAL,
    INERTIAL,
    RATE,
    WEIGHT,
    PathDynamics,
    path_coefficients,
    timed_dynamics,
)
from delta3_pacdrive.motion.plan import Move, MoveKind
from delta3_pacdrive.motion.thermal_load import ThermalLoad, thermal_load
from delta3_pacdrive.motion.virtual_master import end_acceleration, master_at_distances, plan_master
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

MOVE_MAX_S = 3600.0
SHARES_MAX = 6  # halvings of the share of the acceleration that a jerk-limited master uses
WINDOW_MIN_S = 1e-3  # shortest time in which a smoothed master changes its acceleration
GRID_MIN, GRID_MAX, GRID_M, GRID_PER_PIECE = 97, 4001, 2.5e-3, 8
BEFORE = 1e-9  # of a move's length: distance between both sides of a place
END_REFINEMENTS = 7  # halvings of the grid towards both ends, where a master starts and stops
KEPT = 1.0 + 1e-3  # a limit is kept if time need not be stretched by more
NEARLY_KEPT = (
    1.0 + 5e-4
)  # what is left after planning with local limits is taken from the time of the whole move
ROUNDS_MAX = 8  # of planning with local limits, before all of the move is made slower
CURVATURE_SHARE, JERK_SHARE = 0.98, 0.8  # of the TCP's limits that may be used up by the path's bend alone


@dataclass(frozen=True)
class Event:
    """An output or a payload that changes at a distance [m] on a move."""

    distance_m: float
    output: int
    value: float
    payload_kg: float | None


@dataclass
class PlannedMove:
    """A move that is planned, with what the whole program needs to know about it."""

    move: Move
    load: ThermalLoad
    notices: list[str] = field(default_factory=list)


def grid(curve: Curve) -> Floats:
    """Distances at which a move is checked: even within each piece of the path, finer towards both ends of the move."""
    edges = np.append(curve.segments[:, 0], curve.length_m)
    lengths = np.diff(edges)
    step = curve.length_m / min(max(GRID_MIN, curve.length_m / GRID_M), GRID_MAX)
    counts = np.maximum(np.ceil(lengths / step), GRID_PER_PIECE).astype(int)
    number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    inner = (np.repeat(edges[:-1], counts) + number * np.repeat(lengths / counts, counts))[1:]
    refined = min(inner[0], curve.length_m - inner[-1]) * 0.5 ** np.arange(END_REFINEMENTS, 0, -1)
    return np.concatenate([edges[:1], refined, inner, curve.length_m - refined[::-1], edges[-1:]])


def check_legal_samples(
    distance: Floats, samples: Floats, parameters: Parameters, returning: bool = False
) -> None:
    """Refuse path samples that leave the workspace or the range of the arms; raises ProgramError."""
    check_workspace(distance, samples[:, 0], parameters, returning)
    coefficients = path_coefficients(
        samples, np.zeros(len(samples), np.int64), (parameters.dynamics.payload_mass_kg,), parameters
    )
    check_arms(distance, samples[:, 0], coefficients, parameters, returning)


NO_TCP_LIMITS = (np.array(np.inf), np.array(np.inf), np.array(np.inf))


def dynamics_at(
    times: Floats,
    master: Floats,
    samples: Floats,
    payload: NDArray[np.int64],
    payloads: tuple[float, ...],
    parameters: Parameters,
) -> PathDynamics:
    """Return what a master asks of the robot at path samples."""
    return timed_dynamics(
        times, master, samples, path_coefficients(samples, payload, payloads, parameters), parameters
    )


def require_holdable(found: Excess) -> None:
    """Refuse what no slowness makes possible; raises ProgramError."""
    if not math.isfinite(found.worst):
        raise ProgramError(f'{found.text}, even at standstill')


def _require_end_of_time(duration_s: float) -> None:
    if not duration_s <= MOVE_MAX_S:
        raise ProgramError(f'it would take {duration_s:.3g} s, the limit is {MOVE_MAX_S:g} s')


def event_rows(events: list[Event]) -> Floats:
    """Return events as the rows of a plan, in order of their distance."""
    rows = [(e.distance_m, e.output, e.value, -1.0 if e.payload_kg is None else e.payload_kg) for e in events]
    return np.array(sorted(rows, key=lambda row: row[0]), dtype=np.float64).reshape(-1, 4)


class MovePlanner:
    """Planner of one move: its grid, what the path asks there, and the limits that hold there."""

    def __init__(
        self,
        curve: Curve,
        stretches: list[tuple[float, Limits]],
        events: list[Event],
        payload_kg: float,
        parameters: Parameters,
        returning: bool = False,
    ) -> None:
        self.curve, self._parameters = curve, parameters
        self.distance = grid(curve)
        self.places = _both_sides(self.distance)
        self.samples = sample_path(self.places, curve.segments)
        changes = [e for e in sorted(events, key=lambda e: e.distance_m) if e.payload_kg is not None]
        self._payloads = (payload_kg, *[float(e.payload_kg) for e in changes if e.payload_kg is not None])
        index = np.searchsorted([e.distance_m for e in changes], self.places, side='right')
        check_workspace(self.places, self.samples[:, 0], parameters, returning)
        self._coefficients = path_coefficients(self.samples, index, self._payloads, parameters)
        check_arms(self.places, self.samples[:, 0], self._coefficients, parameters, returning)
        # where a stretch ends and the next begins, both limits hold
        ends, last = [end for end, _ in stretches], len(stretches) - 1
        beside = [np.minimum(np.searchsorted(ends, self.places, side), last) for side in ('left', 'right')]
        each = [lower(stretches[a][1], stretches[b][1]) for a, b in zip(*beside, strict=True)]
        self.speed = np.array([limits.speed_m_s for limits in each])
        self.acceleration = np.array([limits.acceleration_m_s2 for limits in each])
        self.jerk = np.array([limits.jerk_m_s3 for limits in each])

    def dynamics(self, phases: Floats) -> PathDynamics:
        """Evaluate a master on both sides of the places of the grid."""
        passed = master_at_distances(self.places, phases)
        master = np.ascontiguousarray(passed[:, 1:])
        # the end is reached, as the start is left, with the acceleration and the jerk of the phase beside it
        master[-1, 2], master[-1, 3] = end_acceleration(phases), phases[-2, 4]
        return timed_dynamics(passed[:, 0], master, self.samples, self._coefficients, self._parameters)

    def excess(self, dynamics: PathDynamics, motors_only: bool = False) -> Excess:
        """Compare a timed motion with the limits of the grid."""
        return excess(dynamics, (self.speed, self.acceleration, self.jerk), self._parameters, motors_only)

    def place_limits(
        self, with_motors: bool, speed: Floats, acceleration: Floats
    ) -> time_parametrization.PlaceLimits:
        """Limits of every place for ``timing``."""
        motor, coefficients = self._parameters.motor, self._coefficients[::2]
        second = np.linalg.norm(self.samples[::2, 2], axis=1)
        third = _worse(np.linalg.norm(self.samples[:, 3], axis=1))
        with np.errstate(divide='ignore'):
            caps = [
                speed,
                np.sqrt(CURVATURE_SHARE * acceleration / second),
                (JERK_SHARE * self.jerk[::2] / third) ** (1.0 / 3.0),
            ]
        torque = np.full((len(speed), 3), np.inf)
        if with_motors:
            shaft = np.abs(coefficients[:, RATE]) * self._parameters.dynamics.gear_ratio
            emf = motor.torque_constant_n_m_a / 3.0
            drop = motor.winding_resistance_ohm / 2.0 * motor.nominal_current_a
            voltage_speed = (self._parameters.drive.dc_link_voltage_v / np.sqrt(6.0) - drop) / emf
            highest = min(motor.max_speed_rad_s, voltage_speed)
            with np.errstate(divide='ignore'):
                caps.append((highest / shaft).min(axis=1))
            fastest = np.minimum.reduce(caps)[:, None]
            friction = motor.static_friction_n_m + motor.viscous_friction_n_m_s_rad * shaft * fastest
            torque = motor.torque_constant_n_m_a * motor.peak_current_a - friction
        return time_parametrization.PlaceLimits(
            self.distance,
            np.minimum.reduce(caps),
            acceleration,
            second,
            np.ascontiguousarray(coefficients[:, INERTIAL]),
            np.ascontiguousarray(coefficients[:, CENTRIFUGAL]),
            np.ascontiguousarray(coefficients[:, WEIGHT]),
            torque,
        )

    def fastest(self, with_motors: bool) -> Floats:
        """Phases of the fastest master within the limits of every place.

        A jerk-limited master on a short way cannot use all of the acceleration, and is faster if it does not try to.
        """
        jerk, most = float(self.jerk.min()), float(self.acceleration.max())
        if not math.isfinite(jerk):
            return self._fastest(with_motors, 1.0)
        # the peak of the acceleration of a free master from rest to rest over this length
        share = min(float(np.cbrt(0.5 * jerk**2 * self.curve.length_m)) / most, 1.0)
        best = self._fastest(with_motors, share)
        for _ in range(SHARES_MAX):
            share *= 0.5
            other = self._fastest(with_motors, share)
            if other[-1, 0] >= best[-1, 0]:
                break
            best = other
        return best

    def _fastest(self, with_motors: bool, share: float) -> Floats:
        """Phases of the fastest master that uses no more than a share of the acceleration."""
        speed, acceleration = self.speed[::2].copy(), share * self.acceleration[::2]
        jerk = float(self.jerk.min())
        window = max(float(acceleration.max()) / jerk, WINDOW_MIN_S) if math.isfinite(jerk) else 0.0
        best, chosen = math.inf, np.empty((0, 5))
        for _ in range(ROUNDS_MAX):
            profile = time_parametrization.fastest(
                self.place_limits(with_motors, speed, acceleration), window
            )
            if not len(profile) or not profile[1:-1].all():
                require_holdable(self.excess(self._standing(), motors_only=True))
                raise ProgramError('a motor cannot hold the arm somewhere on the path')
            _require_end_of_time(time_parametrization.duration(self.distance, profile) + window)
            phases, jerk_found = time_parametrization.smoothed(self.distance, profile, jerk, window)
            found = (
                self.excess(self.dynamics(phases), motors_only=False)
                if with_motors
                else self._tcp_excess(phases)
            )
            stretch = np.maximum(_worse(found.stretch), self._stretch_at_joints(phases))
            factor = max(
                float(stretch.max()), (jerk_found / jerk) ** (1.0 / 3.0) if math.isfinite(jerk) else 1.0, 1.0
            )
            if not math.isfinite(factor):
                raise ProgramError(found.text)
            if factor < best:
                best, chosen = factor, phases
            if factor <= NEARLY_KEPT:
                break
            window *= max(jerk_found / jerk, 1.0) if math.isfinite(jerk) else 1.0
            relief = time_parametrization.widened(
                self.distance, _spread(np.maximum(stretch, 1.0)), profile, window
            )
            speed /= relief
            acceleration /= relief**2
        return time_parametrization.slowed(chosen, best)

    def bound_s(self) -> float:
        """Shortest time [s] that limits of speed and acceleration and the motors allow, whatever the jerk."""
        limits = self.place_limits(True, self.speed[::2], self.acceleration[::2])
        return time_parametrization.duration(self.distance, time_parametrization.fastest(limits))

    def _standing(self) -> PathDynamics:
        """Evaluate standstill at every place of the grid."""
        master = np.zeros((len(self.places), 4))
        master[:, 0] = self.places
        return timed_dynamics(master[:, 1], master, self.samples, self._coefficients, self._parameters)

    def _tcp_excess(self, phases: Floats) -> Excess:
        d = self.dynamics(phases)
        total = np.maximum.reduce(
            [
                d.tcp_speed_m_s / self.speed,
                np.sqrt(d.tcp_acceleration_m_s2 / self.acceleration),
                np.cbrt(d.tcp_jerk_m_s3 / self.jerk),
            ]
        )
        return Excess(total, '')

    def _stretch_at_joints(self, phases: Floats) -> Floats:
        """Factor of time that the TCP's limits ask for where phases meet, given to the places of the grid around."""
        t, s, v = np.diff(phases[:, 0]), phases[1:-1, 1], phases[1:-1, 2]
        _, first, second, third = np.moveaxis(sample_path(s, self.curve.segments), 1, 0)
        after = np.searchsorted(self.distance, s).clip(1, len(self.distance) - 1)
        limit = 2 * after  # the same place among those of both sides
        stretch = np.ones(len(self.distance))
        end = phases[:-1, 3] + t * phases[:-1, 4]
        for a, j in ((phases[1:-1, 3], phases[1:-1, 4]), (end[:-1], phases[:-2, 4])):
            acceleration = np.linalg.norm(first * a[:, None] + second * v[:, None] ** 2, axis=1)
            change = first * j[:, None] + 3.0 * second * (v * a)[:, None] + third * v[:, None] ** 3
            needed = np.maximum(
                np.sqrt(acceleration / self.acceleration[limit]),
                np.cbrt(np.linalg.norm(change, axis=1) / self.jerk[limit]),
            )
            np.maximum.at(stretch, after, needed)
            np.maximum.at(stretch, after - 1, needed)
        return stretch

    def load(self, phases: Floats) -> ThermalLoad:
        """Sum up what a master asks of the motors."""
        d = self.dynamics(phases)
        weights = np.gradient(d.time_s) if len(d.time_s) > 1 else np.ones(1)
        return thermal_load(d, weights, float(phases[-1, 0]), self._parameters)


def _both_sides(distance: Floats) -> Floats:
    """Return every place of a grid and, but for the first, the place right before it.

    Where a piece of the path or a phase of the master ends, acceleration and jerk differ on both sides.
    """
    before = np.maximum(distance[1:] - BEFORE * distance[-1], 0.5 * (distance[1:] + distance[:-1]))
    return np.concatenate([distance[:1], np.stack([before, distance[1:]], axis=1).ravel()])


def _worse(values: Floats) -> Floats:
    """Return the larger of the values on both sides of each place of a grid."""
    return np.concatenate([values[:1], np.maximum(values[1::2], values[2::2])])


def _spread(relief: Floats) -> Floats:
    """Return the larger of each value and its neighbours: a limit that moves a little still meets its place."""
    padded = np.pad(relief, 2, mode='edge')
    return np.asarray(np.maximum.reduce([padded[n : n + len(relief)] for n in range(5)]))


def plan_move(
    segments: list[PathSegment],
    curve: Curve,
    stretches: list[tuple[float, Limits]],
    events: list[Event],
    payload_kg: float,
    parameters: Parameters,
    returning: bool = False,
) -> PlannedMove:
    """Time one move and check it; one that is ``returning`` may begin beyond limits."""
    name = name_of(segments)
    planner = MovePlanner(curve, stretches, events, payload_kg, parameters, returning)
    limits = segments[0].limits
    if len(segments) == 1:
        phases = plan_master(curve.length_m, limits.speed_m_s, limits.acceleration_m_s2, limits.jerk_m_s3)
    else:
        phases = planner.fastest(with_motors=False)
    asked = float(phases[-1, 0])
    notices = []
    found = planner.excess(planner.dynamics(phases))
    if found.worst > KEPT:
        if any(segment.strict for segment in segments):
            raise ProgramError(f'{found.text} (strict)')
        phases = planner.fastest(with_motors=True)
        taken = float(phases[-1, 0])
        notices.append(f'{name} is slowed down, {taken:.4g} s instead of {asked:.4g} s: {found.text}')
    _require_end_of_time(float(phases[-1, 0]))
    jerk = min(limits.jerk_m_s3 for _, limits in stretches)
    move = Move(
        segments[0].kind if len(segments) == 1 else MoveKind.BLENDED,
        phases,
        curve.segments,
        min(limits.acceleration_m_s2 for _, limits in stretches),
        jerk,
        payload_kg,
        event_rows(events),
    )
    return PlannedMove(move, planner.load(phases), notices)


def plan_cubic(
    curve: Curve,
    limits: Limits,
    payload_kg: float,
    name: str,
    parameters: Parameters,
    returning: bool = False,
) -> PlannedMove:
    """Check a sequence of cubics in time (chapter 5), and slow it down as a whole if a motor asks for that."""
    duration = curve.length_m
    times = np.linspace(0.0, duration, min(max(GRID_MIN, int(duration / 2e-3)), GRID_MAX))
    samples = sample_path(times, curve.segments)
    check_legal_samples(times, samples, parameters, returning)
    master = np.zeros((len(times), 4))
    master[:, 0], master[:, 1] = times, 1.0
    d = dynamics_at(times, master, samples, np.zeros(len(times), np.int64), (payload_kg,), parameters)
    found = excess(d, NO_TCP_LIMITS, parameters, motors_only=True)
    require_holdable(found)
    factor, notices = 1.0, []
    if found.worst > KEPT:
        factor = found.worst
        notices.append(
            f'{name} is slowed down, {duration * factor:.4g} s instead of {duration:.4g} s: {found.text}'
        )
    phases = time_parametrization.slowed(
        np.array([[0.0, 0.0, 1.0, 0.0, 0.0], [duration, duration, 0.0, 0.0, 0.0]]), factor
    )
    speed = max(float(d.tcp_speed_m_s.max()), 1e-6)
    move = Move(
        MoveKind.CUBIC, phases, curve.segments, limits.acceleration_m_s2 / speed, math.inf, payload_kg
    )
    load = thermal_load(d, np.gradient(times), duration, parameters)
    if factor > 1.0:
        load = replace(
            load,
            moving=load.moving / factor**3,
            mixed=load.mixed / factor,
            standing=load.standing * factor,
            duration_s=duration * factor,
            override_max=1.0,
        )
    return PlannedMove(move, load, notices)
