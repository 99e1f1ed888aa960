"""D-optimal selection of measuring poses among many that the robot reaches.

Poses are removed and exchanged one by one to maximise the determinant of the information about the arms, with the
unknowns of the instrument eliminated (Fedorov 1972). The tolerances of manufacture (``model.SCALES``) count as prior
information.

Poses are restricted to those where the weight loads each gear against the same flank with at least ``PRESSED_N_M``.
Elsewhere the arm is undetermined within the backlash, which no geometric model can represent.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.errors import CalibrationError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.capability import REACHED, capability
from delta3_pacdrive.studies.calibration import estimation, model
from delta3_pacdrive.studies.calibration.model import ALL, SCALES, ZEROS
from delta3_pacdrive.studies.calibration.study import Method, Poses, Requirements

CANDIDATES = (5, 12, 4)  # radii, directions and heights
PLANES = 3  # heights of a touched plate
BALLS = (1, 6, 2)  # radii, directions and heights of ball positions, in addition to the centre
BALL_RADIUS = 0.6  # radius of the ball positions, of the workspace
TILTS_DEG = (0.0, 45.0, 75.0)  # of the touches, from the top of a ball
AROUND = 6  # directions of touches at each tilt
UNKNOWN = 1e3  # prior uncertainty of the instrument, in scales of the parameters
EXCHANGES_MAX = 200
PER_OBJECT, PER_OBJECT_MIN = 6, 5  # intended and minimum touches per object
PRESSED_N_M = 1.0  # torque of the weight on each arm
# travel of a probe beyond the planned surface: for objects set up by eye; for arms homed anew
REACH_M, FAR_REACH_M = 0.002, 0.01
LEAST = {Method.BASE: 6, Method.FRAME: 8, Method.PLANE: 20, Method.BALL: 20, Method.LEVEL: 1}
PLACED = (Method.BASE, Method.LEVEL)  # methods that measure in the frame of the robot


@dataclass(frozen=True)
class Candidates:
    """Candidate poses in the format of ``Poses``, with their information about the arms and the instrument."""

    points_m: Floats
    objects: tuple[str, ...]
    diameters_m: Floats
    directions: Floats
    rows: Floats  # shape (n, rows, unknowns), in standard deviations of the noise per scale


def plan(requirements: Requirements, robot: Parameters) -> Poses:
    """Select the poses of a calibration; raises CalibrationError."""
    number, least = requirements.number, LEAST[requirements.method]
    if number < least:
        raise CalibrationError(
            f'{number} poses are too few for the method {requirements.method}, at least {least} are needed'
        )
    found = (
        _level_candidates(requirements, robot)
        if requirements.method == Method.LEVEL
        else _candidates(requirements, robot)
    )
    if len(found.points_m) < number + requirements.checks:
        raise CalibrationError(
            f'{number} poses and {requirements.checks} checks are more than the {len(found.points_m)} candidates'
        )
    chosen = _exchanged(found.rows, number, found.objects)
    checks = _spread(found, chosen, requirements.checks)
    order = _tour(found, [*chosen, *checks])
    return Poses(
        points_m=found.points_m[order],
        checks=np.isin(order, checks),
        objects=tuple(found.objects[n] for n in order) if found.objects else (),
        diameters_m=found.diameters_m[order],
        directions=found.directions[order],
        reach_m=FAR_REACH_M if requirements.method == Method.LEVEL else REACH_M,
        expected_m=_expected(found.rows[chosen], requirements, robot),
    )


def free_of(requirements: Requirements) -> tuple[int, ...]:
    """Return the elements of x to be estimated."""
    if requirements.method != Method.LEVEL:
        return ALL
    return ZEROS if requirements.arm is None else (ZEROS[requirements.arm - 1],)


def _expected(rows: Floats, requirements: Requirements, robot: Parameters) -> tuple[float, float]:
    information, free = _information(rows) + _prior(rows.shape[-1]), free_of(requirements)
    covariance = np.linalg.inv(information)[: len(free), : len(free)]
    is_placed = requirements.method in PLACED
    before = estimation.expected_m(np.eye(len(free)), robot, free, is_placed)
    after = estimation.expected_m(np.asarray(covariance), robot, free, is_placed)
    return after, before


def _candidates(requirements: Requirements, robot: Parameters) -> Candidates:
    sigma = float(np.hypot(requirements.noise_m, estimation.MODEL_M))
    if requirements.method == Method.BALL:
        return _ball_candidates(robot, sigma, requirements.diameter_m)
    k = robot.kinematics
    radii, turns, levels = CANDIDATES
    heights = estimation.levels(robot, PLANES if requirements.method == Method.PLANE else levels)
    points = _rings(
        0.5 * estimation.INWARD * k.workspace_diameter_m * np.linspace(0.0, 1.0, radii), turns, heights
    )
    points = points[_measurable(points, robot)]
    moves = model.sensitivity(estimation.shafts_of(points, robot), robot) * SCALES / sigma
    count, objects = len(points), tuple[str, ...]()
    directions = np.zeros((count, 3))
    if requirements.method == Method.FRAME:
        rigid = np.concatenate(
            [np.broadcast_to(np.eye(3), (count, 3, 3)),
             np.stack([np.cross(axis, points) for axis in np.eye(3)], axis=-1)],
            axis=-1,
        )  # fmt: skip
        moves = np.concatenate([moves, UNKNOWN * rigid * SCALES[0] / sigma], axis=-1)
    if requirements.method == Method.PLANE:
        level = np.abs(points[:, 2, None] - heights).argmin(axis=1)
        objects = tuple(f'plane{n + 1}' for n in level)
        directions[:, 2] = 1.0
        place = np.zeros((count, 1, 3 * len(heights)))
        for axis, value in enumerate((np.ones(count), points[:, 0], points[:, 1])):
            place[np.arange(count), 0, 3 * level + axis] = value
        moves = np.concatenate([moves[:, 2:], UNKNOWN * place * SCALES[0] / sigma], axis=-1)
    return Candidates(points, objects, np.full(count, np.nan), directions, moves)


def _level_candidates(requirements: Requirements, robot: Parameters) -> Candidates:
    k = robot.kinematics
    radii, turns, _ = CANDIDATES
    if requirements.height_m is None:
        raise CalibrationError('touches of a level plane require its height')
    sigma = float(np.hypot(requirements.noise_m, estimation.MODEL_M))
    rings = 0.5 * estimation.INWARD * k.workspace_diameter_m * np.linspace(0.0, 1.0, radii)
    points = _rings(rings, turns, np.array([requirements.height_m]))
    points = points[_measurable(points, robot)]
    free = list(free_of(requirements))
    moves = model.sensitivity(estimation.shafts_of(points, robot), robot)[:, 2:, free] * SCALES[free] / sigma
    away = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    return Candidates(points, ('plane',) * len(points), np.full(len(points), np.nan), away, moves)


def _rings(radii: Floats, turns: int, heights: Floats) -> Floats:
    """Return points on rings around the axis of the robot, one at the centre, shape (n, 3)."""
    found = []
    for z in heights:
        for n, radius in enumerate(radii):
            angles = 2.0 * np.pi * (np.arange(turns if radius else 1) + 0.5 * (n % 2)) / turns
            found += [(radius * np.cos(a), radius * np.sin(a), z) for a in angles]
    return np.array(found).round(6)


def _ball_candidates(robot: Parameters, sigma: float, diameter_m: float) -> Candidates:
    k = robot.kinematics
    radii, turns, levels = BALLS
    ring = 0.5 * BALL_RADIUS * k.workspace_diameter_m * np.linspace(0.0, 1.0, radii + 1)
    low = estimation.levels(robot, levels) - [0.0 if n else diameter_m for n in range(levels)]
    centres = _rings(ring, turns, low)
    tilts = np.radians(TILTS_DEG)
    directions = np.array(
        [
            (np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt))
            for tilt in tilts
            for turn in 2.0 * np.pi * np.arange(AROUND if tilt else 1) / AROUND
        ]
    )
    number = np.repeat(np.arange(len(centres)), len(directions))
    away = np.tile(directions, (len(centres), 1))
    points = centres[number] + 0.5 * diameter_m * away
    kept = np.isin(np.arange(len(points)), _measurable(points, robot))
    points, away, number = points[kept], away[kept], number[kept]
    moves = model.sensitivity(estimation.shafts_of(points, robot), robot) * SCALES / sigma
    place = np.zeros((len(points), 3 * len(centres)))
    for axis in range(3):
        place[np.arange(len(points)), 3 * number + axis] = away[:, axis]
    rows = np.concatenate(
        [np.einsum('na,naj->nj', away, moves), UNKNOWN * place * SCALES[0] / sigma], axis=-1
    )
    names = tuple(f'ball{n + 1}' for n in number)
    return Candidates(points, names, np.full(len(points), diameter_m), away, rows[:, None])


def _measurable(points: Floats, robot: Parameters) -> NDArray[np.int64]:
    """Return the indices of the points that are reachable with all gears loaded on their usual flank."""
    reached = np.flatnonzero(capability(points, robot).limit == REACHED)
    return reached[pressed(points[reached], robot)]


def pressed(points: Floats, robot: Parameters) -> NDArray[np.bool_]:
    """Return at which points [m], shape (n, 3), the weight loads all gears on the same flank as at home."""
    usual = np.sign(dynamics.gravity(kinematics.inverse(robot.motion.home_m, robot), robot))
    torque = dynamics.gravity(kinematics.inverse(points, robot), robot)
    return np.asarray((torque * usual > PRESSED_N_M).all(axis=-1))


def _prior(unknowns: int) -> Floats:
    return np.eye(unknowns)


def _information(rows: Floats) -> Floats:
    flat = rows.reshape(-1, rows.shape[-1])
    return np.asarray(flat.T @ flat)


def _exchanged(rows: Floats, number: int, objects: tuple[str, ...]) -> list[int]:
    """Return the indices of the most informative candidates: the least informative are removed, then exchanged."""
    chosen = _of_best_objects(rows, number, objects)
    total = _prior(rows.shape[-1]) + _information(rows[chosen])
    least_each = PER_OBJECT_MIN if rows.shape[-1] > len(ALL) else 1
    while len(chosen) > number:
        losses = -_gains(rows[chosen], total, -1.0)
        if objects:
            counts = Counter(objects[n] for n in chosen)
            losses[[counts[objects[n]] <= least_each for n in chosen]] = np.inf
        least = chosen.pop(int(np.argmin(losses)))
        total = total - rows[least].T @ rows[least]
    for _ in range(EXCHANGES_MAX):
        gain, place, other = 1e-6, -1, -1
        for n, one in enumerate(chosen):
            without = total - rows[one].T @ rows[one]
            gains = _gains(rows, without, 1.0)
            more = gains - gains[one]
            more[chosen] = -np.inf
            if objects:  # exchange within an object, so that each keeps enough touches
                more[[objects[m] != objects[one] for m in range(len(rows))]] = -np.inf
            if more.max() > gain:
                gain, place, other = float(more.max()), n, int(np.argmax(more))
        if place < 0:
            break
        old = rows[chosen[place]]
        total = total - old.T @ old + rows[other].T @ rows[other]
        chosen[place] = other
    return chosen


def _of_best_objects(rows: Floats, number: int, objects: tuple[str, ...]) -> list[int]:
    """Return the candidates of as many objects as the number of touches allows; the least informative are removed."""
    chosen = list(range(len(rows)))
    names = sorted(set(objects))
    while len(names) > max(1, number // PER_OBJECT):
        left = {name: [n for n in chosen if objects[n] != name] for name in names}
        value = {name: _value(rows[kept]) for name, kept in left.items()}
        names.remove(least := max(value, key=lambda name: value[name]))
        chosen = left[least]
    return chosen


def _value(rows: Floats) -> float:
    """Return the logarithm of the determinant of the information about the arms."""
    total, arms = _prior(rows.shape[-1]) + _information(rows), len(ALL)
    return float(np.linalg.slogdet(total)[1] - np.linalg.slogdet(total[arms:, arms:])[1])


def _gains(rows: Floats, total: Floats, sign: float) -> Floats:
    """Return the change of the log determinant by adding each candidate, or by removing it (``sign`` -1).

    The determinant is that of the arms with the unknowns of the instrument eliminated: total over instrument.
    """
    arms = len(ALL)
    own = _change(rows, total, sign)
    return own - _change(rows[..., arms:], total[arms:, arms:], sign) if rows.shape[-1] > arms else own


def _change(rows: Floats, total: Floats, sign: float) -> Floats:
    spread = rows @ np.linalg.solve(total, np.swapaxes(rows, 1, 2))
    return np.asarray(np.linalg.slogdet(np.eye(rows.shape[1]) + sign * spread)[1])


def _spread(found: Candidates, chosen: list[int], count: int) -> list[int]:
    """Return candidates for validation: those of known objects farthest from all others, one by one."""
    known = {found.objects[n] for n in chosen} if found.objects else set()
    free = [
        n for n in range(len(found.points_m)) if n not in chosen and (not known or found.objects[n] in known)
    ]
    taken: list[int] = []
    for _ in range(min(count, len(free))):
        near = found.points_m[[*chosen, *taken]]
        apart = [float(np.linalg.norm(near - found.points_m[n], axis=1).min()) for n in free]
        taken.append(free.pop(int(np.argmax(apart))))
    return taken


def _tour(found: Candidates, numbers: list[int]) -> list[int]:
    """Return poses in an order with short distances, grouped by object."""
    order: list[int] = []
    position = np.zeros(3)
    left = list(numbers)
    while left:
        own = [
            n for n in left if order and found.objects and found.objects[n] == found.objects[order[-1]]
        ] or left
        distances = np.linalg.norm(found.points_m[own] - position, axis=1)
        order.append(own[int(np.argmin(distances))])
        left.remove(order[-1])
        position = found.points_m[order[-1]]
    return order
