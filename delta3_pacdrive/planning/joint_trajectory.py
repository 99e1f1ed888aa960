"""Joint-space trajectories: interpolation as in the joint_trajectory_controller of ros2_control, and limit checks.

A segment is a quintic if both of its points have speeds and accelerations, a cubic if both have speeds, else a straight
line. The trajectory starts at rest at the current arm angles and ends at rest.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import OVERRIDE_MAX
from delta3_pacdrive.planning.limits.limits import legal_coefficients, legal_tcp
from delta3_pacdrive.planning.limits.violations import limit_violation
from delta3_pacdrive.planning.paths.joint_path import tcp_samples
from delta3_pacdrive.planning.paths.move import Move, MoveKind
from delta3_pacdrive.planning.paths.path import DEGREE, SEGMENT_COLUMNS, sample_path
from delta3_pacdrive.planning.paths.path_dynamics import PathDynamics, path_coefficients, timed_dynamics
from delta3_pacdrive.planning.planned_move import KEPT, SAMPLE_S, PlannedMove
from delta3_pacdrive.planning.program.model import JointPoint
from delta3_pacdrive.planning.thermal_load import thermal_load

START_TOLERANCE_RAD = 1e-3  # permitted deviation of a first point at time 0 from the current arm angles
REST_RAD_S = 1e-6  # lower final speeds are rounding
PIECE_SAMPLES_MIN, SAMPLES_MAX = 8, 60_000  # of the limit check: per piece, and in total
BEFORE = 1e-9  # distance of the last sample of a piece from its end, relative to the piece
NOWHERE = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class JointTrajectory:
    """Arm angles over time."""

    times_s: Floats  # of the points, with the start, shape (n + 1,)
    angles_rad: Floats  # shape (n + 1, 3)
    segments: Floats  # pieces (n, 19) over time, as those of paths
    first_number: int  # number of the point at the start; 0 if the first point is later

    @property
    def duration_s(self) -> float:
        """Duration from the start to the last point [s]."""
        return float(self.times_s[-1])

    def sample_times(self) -> Floats:
        """Return the times of the limit check: both sides of each point, and samples between them."""
        step = max(SAMPLE_S, self.duration_s / SAMPLES_MAX)
        found = []
        for start, end in zip(self.times_s[:-1], self.times_s[1:], strict=True):
            count = max(PIECE_SAMPLES_MIN, math.ceil((end - start) / step))
            found.append(np.linspace(start, end - BEFORE * (end - start), count))
        return np.concatenate([*found, self.times_s[-1:]])

    def where(self, times_s: Floats) -> Callable[[int], str]:
        """Return a function that formats the position of a sample for messages."""

        def place(n: int) -> str:
            time = float(times_s[n])
            number = min(int(np.searchsorted(self.times_s, time, 'left')), len(self.times_s) - 1)
            return f'at {time:.4f} s, before point {number + self.first_number}'

        return place

    def jumps(self) -> Floats:
        """Return the speed jumps at the points [rad/s], shape (n + 1, 3), for rest before and after."""
        coefficients = self.segments[:, 1:].reshape(-1, 3, DEGREE + 1)
        powers = np.arange(1, DEGREE + 1)
        grown = powers * np.diff(self.times_s)[:, None] ** (powers - 1)
        ends = np.einsum('nap,np->na', coefficients[:, :, 1:], grown)
        still = np.zeros((1, 3))
        after, before = np.concatenate([coefficients[:, :, 1], still]), np.concatenate([still, ends])
        return np.asarray(after - before)


def at_rest(angles_rad: Floats) -> JointPoint:
    """Return the start of a trajectory at rest."""
    first, second, third = angles_rad.tolist()
    return JointPoint(0.0, (first, second, third), NOWHERE, NOWHERE)


def joint_trajectory(
    points: Sequence[JointPoint], start: JointPoint, ends_in_motion: bool = False
) -> JointTrajectory:
    """Interpolate points, beginning with a start at time 0; the last one is at rest unless it ``ends_in_motion``.

    Raises
    ------
    ProgramError
        Times do not increase, a point at time 0 deviates from the current angles, or the last point is not at rest.

    """
    knots = list(points)
    if knots[0].time_s > 0.0:
        knots.insert(0, start)
    else:
        for axis, (angle, actual) in enumerate(zip(knots[0].angles_rad, start.angles_rad, strict=True)):
            if not abs(angle - actual) <= START_TOLERANCE_RAD:
                raise ProgramError(
                    f'point 1 at time 0 has arm {axis + 1} at {angle:.6g} rad, but its angle is {actual:.6g} rad, '
                    f'the limit of the difference is {START_TOLERANCE_RAD:g} rad'
                )
        knots[0] = replace(knots[0], angles_rad=start.angles_rad)
    first = 0 if len(knots) > len(points) else 1
    times = np.array([knot.time_s for knot in knots])
    if len(knots) < 2:
        raise ProgramError('the only point is at time 0: a trajectory needs a later one')
    if (np.diff(times) <= 0.0).any():
        n = int(np.argmax(np.diff(times) <= 0.0))
        raise ProgramError(
            f'point {n + 1 + first} is at {times[n + 1]:.9g} s, not after point {n + first} at {times[n]:.9g} s'
        )
    if not ends_in_motion:
        _require_rest(knots[-1], len(points))
    segments = np.zeros((len(times) - 1, SEGMENT_COLUMNS))
    segments[:, 0] = times[:-1]
    segments[:, 1:] = _pieces(knots, np.diff(times)).reshape(len(segments), -1)
    return JointTrajectory(times, np.array([knot.angles_rad for knot in knots]), segments, first)


def _require_rest(last: JointPoint, number: int) -> None:
    for axis, speed in enumerate(last.speeds_rad_s or NOWHERE):
        if not abs(speed) <= REST_RAD_S:
            raise ProgramError(
                f'point {number}, the last one, has a speed of {speed:g} rad/s of arm {axis + 1}, but must be at rest'
            )


def _pieces(knots: Sequence[JointPoint], durations: Floats) -> Floats:
    """Return coefficients of three angles in powers of the time since the previous point, shape (n, 3, 6)."""
    from scipy.interpolate import BPoly, PPoly  # the import takes half a second; other programs avoid it

    given = np.array([1 + (knot.speeds_rad_s is not None) + _has_all(knot) for knot in knots])
    orders = np.minimum(given[:-1], given[1:])  # number of matched derivatives, with the angles
    pieces = np.zeros((len(durations), 3, DEGREE + 1))
    for order in np.unique(orders).tolist():
        chosen = np.flatnonzero(orders == order)
        # pieces of one order together, each in relative time
        shares = durations[chosen] ** np.arange(order)[:, None]
        ends = [_derivatives(knots, chosen + side, order) * shares[..., None] for side in (0, 1)]
        polynomial = PPoly.from_bernstein_basis(BPoly.from_derivatives([0.0, 1.0], ends))
        found = polynomial.c[::-1, 0] / (durations[chosen] ** np.arange(2 * order)[:, None])[..., None]
        pieces[chosen, :, : 2 * order] = np.moveaxis(found, 0, -1)
    return pieces


def _has_all(knot: JointPoint) -> bool:
    return knot.speeds_rad_s is not None and knot.accelerations_rad_s2 is not None


def _derivatives(knots: Sequence[JointPoint], numbers: NDArray[np.int64], order: int) -> Floats:
    """Return angles and ``order`` - 1 of their derivatives at some points, shape (order, points, 3)."""
    rows = [
        (knots[n].angles_rad, knots[n].speeds_rad_s, knots[n].accelerations_rad_s2)[:order]
        for n in numbers.tolist()
    ]
    return np.array(rows, dtype=np.float64).swapaxes(0, 1)


def plan_joints(
    points: Sequence[JointPoint],
    start_m: Floats,
    payload_kg: float,
    name: str,
    parameters: Parameters,
    returning: bool = False,
    smoothed_from: JointPoint | None = None,
) -> PlannedMove:
    """Interpolate points and check all limits; the trajectory is never slowed down.

    A trajectory with ``smoothed_from`` begins with that point, and only its positions are checked: the transformation
    task follows it within the limits of the motors.

    Raises
    ------
    ProgramError
        A limit is exceeded; states quantity, arm or motor, value, limit and point.

    """
    start = smoothed_from or at_rest(kinematics.inverse(start_m, parameters.kinematics))
    path = joint_trajectory(points, start, ends_in_motion=smoothed_from is not None)
    times = path.sample_times()
    where = path.where(times)
    angles = sample_path(times, path.segments)
    samples = legal_tcp(times, angles, where, parameters, returning)

    def place(n: int) -> str:
        x, y, z = samples[n, 0]
        return f'{where(n)}, ({x:.4f}, {y:.4f}, {z:.4f}) m'

    payload = np.zeros(len(times), np.int64)
    coefficients = legal_coefficients(
        times,
        samples,
        payload,
        payloads_kg=(payload_kg,),
        parameters=parameters,
        returning=returning,
        where=place,
    )
    master = np.zeros((len(times), 4))
    master[:, 0], master[:, 1] = times, 1.0
    carried = np.full(len(times), payload_kg)
    d = timed_dynamics(times, master, samples, coefficients, parameters, carried)
    stop = parameters.motion.acceleration_max_m_s2 / max(float(d.tcp_speed_m_s.max()), 1e-6)
    move = Move(
        MoveKind.JOINTS,
        master=np.array([[0.0, 0.0, 1.0, 0.0, 0.0], [path.duration_s, path.duration_s, 0.0, 0.0, 0.0]]),
        segments=path.segments,
        stop_acceleration=stop,
        payload_kg=payload_kg,
        kinematics=parameters.kinematics,
    )
    load = thermal_load(d, np.gradient(times), path.duration_s, parameters)
    if smoothed_from is not None:
        return PlannedMove(move, replace(load, override_max=OVERRIDE_MAX), name)
    found = limit_violation(d, parameters, where=place)
    if found.worst > KEPT:
        raise ProgramError(found.text)
    jumps = _jump_dynamics(path, payload_kg, parameters)
    speeds = path.jumps()

    def jump(n: int) -> str:
        point = n + path.first_number
        at = f'at point {point}' if point else 'at the start'
        return f'for a jump of speed by {np.abs(speeds[n]).max():.4g} rad/s within a bus cycle {at}'

    found = limit_violation(jumps, parameters, where=jump)
    if found.worst > KEPT:
        raise ProgramError(f'{found.text}; between points with speeds there is no jump')
    # the override increases the jumps as well
    room = thermal_load(jumps, np.zeros(len(jumps.time_s)), path.duration_s, parameters).override_max
    return PlannedMove(move, replace(load, override_max=min(load.override_max, room)), name)


def _jump_dynamics(path: JointTrajectory, payload_kg: float, parameters: Parameters) -> PathDynamics:
    """Return the motor demand for changing the speeds at their jumps within a bus cycle."""
    count = len(path.times_s)
    angles = np.zeros((count, 4, 3))
    angles[:, 0], angles[:, 1] = path.angles_rad, path.jumps()
    samples = tcp_samples(angles, parameters.kinematics)
    payload = np.zeros(count, np.int64)
    coefficients = path_coefficients(samples, payload, (payload_kg,), parameters)
    master = np.zeros((count, 4))
    master[:, 0], master[:, 2] = path.times_s, 1.0 / parameters.bus.cycle_time_s
    carried = np.full(count, payload_kg)
    return timed_dynamics(path.times_s, master, samples, coefficients, parameters, carried)
