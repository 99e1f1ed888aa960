"""Simulated measurements, with the drives, gears and geometry errors of a built robot.

Points: the robot stops at each pose of a program. The mean of its true TCP there, plus noise, is the measured point.
Touches: the robot creeps along a line towards each object. The probe switches where the true TCP, plus noise, meets
the surface; the measurement is the encoder angles at that instant.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from delta3_pacdrive.errors import CalibrationError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.simulation.run import run
from delta3_pacdrive.studies.calibration.estimation import shafts_of
from delta3_pacdrive.studies.calibration.study import Measurements, Method, Poses

DWELL_S, AVERAGED_S = 0.4, 0.1  # dwell at a pose, and its final part that is averaged
LIMITS = {'speed_m_s': 1.0, 'acceleration_m_s2': 10.0, 'jerk_m_s3': 300.0}
CREEP = {'speed_m_s': 0.02, 'acceleration_m_s2': 2.0, 'jerk_m_s3': 200.0}
SETTLE_S = 0.2  # dwell before a probe creeps
OFF_M, TILT_RAD = 0.3e-3, 2e-3  # standard deviations of the position and tilt of an object
STAND_M, TURN_RAD = 1.0, 0.5  # standard deviations of the pose of an instrument


def program(poses: Poses, name: str) -> dict[str, Any]:
    """Return the measuring program that moves to all poses, ready for YAML."""
    moves: list[dict[str, Any]] = []
    for point, direction in zip(poses.points_m, poses.directions, strict=True):
        if not poses.objects:
            moves += [_line(point), {'dwell': {'time_s': DWELL_S}}]
            continue
        before, beyond = point + 2.0 * poses.reach_m * direction, point - poses.reach_m * direction
        moves += [_line(before), {'dwell': {'time_s': SETTLE_S}}, _line(beyond, **CREEP), _line(before)]
    return {'name': name, 'limits': dict(LIMITS), 'moves': moves}


def _line(point: Floats, **limits: float) -> dict[str, Any]:
    return {'move_l': {'to_m': [round(float(value), 6) + 0.0 for value in point], **limits}}


def simulated_trace(poses: Poses, robot: Parameters) -> Trace:
    """Return the trace of the measuring program; raises CalibrationError."""
    document = program(poses, 'calibration')
    trace = run(program_file.parse(document, robot.motion), robot)
    if trace.meta['stopped']:
        raise CalibrationError(f'the robot stopped at a pose: {trace.meta["stopped"]}')
    return trace


def cycles_of_moves(trace: Trace, kind: str) -> list[tuple[int, int]]:
    """Return first and last bus cycle of each move of a kind."""
    begin, period = trace.meta['start_cycle'], trace.meta['cycle_time_s']
    return [
        (begin + round(move['start_s'] / period), begin + round(move['end_s'] / period))
        for move in trace.meta['moves']
        if move['kind'] == kind
    ]


def tcp_at_rest(poses: Poses, robot: Parameters) -> tuple[Floats, Floats]:
    """Return arm angles of the controller [rad] and the true TCP [m] at rest at poses, shapes (n, 3)."""
    trace = simulated_trace(poses, robot)
    count = round(AVERAGED_S / robot.bus.cycle_time_s)
    ends = [end for _, end in cycles_of_moves(trace, 'dwell')]
    if len(ends) != len(poses.points_m):
        raise CalibrationError('the robot did not stop at every pose')
    angles = trace['motor_position'] / robot.dynamics.gear_ratio
    return tuple(
        np.stack([signal[end - count : end].mean(axis=0) for end in ends])
        for signal in (angles, trace['tcp_true'])
    )  # type: ignore[return-value]


def points(poses: Poses, robot: Parameters, method: Method, noise_m: float, seed: int) -> Measurements:
    """Measure points at poses."""
    random = np.random.default_rng(seed)
    angles, seen = tcp_at_rest(poses, robot)
    seen = seen + noise_m * random.standard_normal(seen.shape)
    if method == Method.FRAME:
        turn = Rotation.from_rotvec(TURN_RAD * random.standard_normal(3))
        seen = turn.apply(seen) + STAND_M * random.standard_normal(3)
    return Measurements(
        angles_rad=angles,
        points_m=seen,
        checks=poses.checks,
        objects=(),
        diameters_m=poses.diameters_m,
        checksum=robot.checksum,
    )


def touches(
    poses: Poses, robot: Parameters, noise_m: float, seed: int, height_m: float | None = None
) -> Measurements:
    """Touch the objects of poses; with ``height_m`` all of them are one level plane at exactly this height."""
    random = np.random.default_rng(seed)
    trace = simulated_trace(poses, robot)
    angles = trace['motor_position'] / robot.dynamics.gear_ratio
    places = {name: _place(name, poses, random, height_m) for name in sorted(set(poses.objects))}
    found = []
    creeps = cycles_of_moves(trace, 'line')[1::3]
    for (begin, end), name, noise in zip(
        creeps, poses.objects, noise_m * random.standard_normal(len(creeps)), strict=True
    ):
        normal, reference, radius = places[name]
        away = trace['tcp_true'][begin:end] - reference
        outside = (away @ normal if radius is None else np.linalg.norm(away, axis=1) - radius) - noise
        met = np.flatnonzero((outside[:-1] > 0.0) & (outside[1:] <= 0.0))
        if not len(met):
            raise CalibrationError(
                f'the probe did not reach {name}: the object is too far from its planned position'
            )
        share = outside[met[0]] / (outside[met[0]] - outside[met[0] + 1])
        first, second = angles[begin + met[0]], angles[begin + met[0] + 1]
        found.append(first + share * (second - first))
    return Measurements(
        angles_rad=np.array(found),
        points_m=np.full((len(found), 3), np.nan),
        checks=poses.checks,
        objects=poses.objects,
        diameters_m=poses.diameters_m,
        checksum=robot.checksum,
    )


# normal of a plane, point on it or centre of a ball, radius of the ball
Place = tuple[Floats, Floats, float | None]


def _place(name: str, poses: Poses, random: np.random.Generator, height_m: float | None) -> Place:
    """Return the true position of an object, which deviates from the planned one."""
    n = poses.objects.index(name)
    off = OFF_M * random.standard_normal(3)
    if not np.isnan(poses.diameters_m[n]):
        radius = 0.5 * float(poses.diameters_m[n])
        return poses.directions[n], poses.points_m[n] - radius * poses.directions[n] + off, radius
    if height_m is not None:
        return np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, height_m]), None
    tilt = TILT_RAD * random.standard_normal(2)
    normal = np.array([*tilt, 1.0])
    middle = np.mean([poses.points_m[m] for m, other in enumerate(poses.objects) if other == name], axis=0)
    return normal / np.linalg.norm(normal), middle + off, None


def planned_angles(poses: Poses, robot: Parameters) -> Floats:
    """Return the commanded arm angles at poses [rad]; nan for touches, where they are measured."""
    if poses.objects:
        return np.full_like(poses.points_m, np.nan)
    return np.asarray(shafts_of(poses.points_m, robot) + robot.kinematics.corrections.angle_rad)


def scattered(points_m: Floats, checks: Sequence[bool]) -> Poses:
    """Return poses without objects at points [m]."""
    count = len(points_m)
    unknown = np.full(count, np.nan)
    return Poses(
        points_m=points_m,
        checks=np.array(checks),
        objects=(),
        diameters_m=unknown,
        directions=np.zeros((count, 3)),
        reach_m=0.0,
        expected_m=(np.nan, np.nan),
    )
