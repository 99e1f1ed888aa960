"""Least-squares estimation of the arm geometry, restricted to the identifiable directions.

Residuals are scaled by the standard deviation of the noise, parameters by the tolerances of manufacture
(``model.SCALES``). A direction of the parameters with singular value s is then known to 1/s of the tolerance.
Directions that the measurements determine better than the tolerances (s > 1) are estimated; in all others the arms
keep their values. For s < ``FIRM`` the tolerance counts as one more measurement, so that noise is not fitted.

The result corrects the TCP. It equals the true arm geometry only if no other effect has the same shape. Gears that
yield under weight do, and so do lengths if only zero angles are estimated. The intervals include both effects.
"""

import copy
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.errors import CalibrationError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.capability import REACHED, capability
from delta3_pacdrive.studies.calibration import model
from delta3_pacdrive.studies.calibration.model import ALL, ARMS, SCALES, ZEROS, Observation
from delta3_pacdrive.studies.calibration.study import Estimate, Measurements, Residual

MODEL_M = 0.01e-3  # residual without noise: gears yield under weight, joints have backlash
SEEN, FIRM = 1.0, 10.0  # singular values above which a direction is estimated, and without the prior
FREEDOM_MIN = 3
Z_95 = 1.959964
FAR_M = 0.05  # larger than any manufacturing error
NEARER = 0.99  # of two equally likely errors of a table, the first is named
CONTRADICTION = 4.0  # rms of the residuals relative to its expectation
OUTLIER = 6.0  # the same for a single measurement
TOO_LITTLE, TOO_LITTLE_UNPLACED = 0.3, 0.8  # of the uncalibrated uncertainty: useless calibration
NAMED = 0.3  # smallest weight of a parameter that is named in a direction
INWARD = 0.95  # of the workspace, so that the real arms reach it too
GRID, FINE = (5, 12, 3), (8, 17, 6)  # radii, directions and heights that sample the workspace
MM = 1e3


@dataclass(frozen=True)
class Solution:
    """Solution of one set of measurements."""

    x: Floats  # corrections of the arms
    place: Floats  # unknowns of the instrument
    estimates: tuple[Estimate, ...]  # one per free parameter
    combinations: tuple[str, ...]  # directions that are not identifiable
    directions: int  # as in study.Result
    freedom: int
    scatter: float
    expected_m: tuple[float, float]  # expected rms error of the TCP over the workspace, before and after
    residuals: tuple[Floats, Floats]  # before and after, of all measurements [m], each of shape (n, rows)


def workspace(robot: Parameters, grid: tuple[int, int, int] = GRID) -> Floats:
    """Return reachable points that sample the workspace except for its border [m], shape (n, 3)."""
    k = robot.kinematics
    radii, turns, heights = grid
    radius = 0.5 * INWARD * k.workspace_diameter_m * np.linspace(0.0, 1.0, radii)
    turn = np.linspace(0.0, 2.0 * np.pi, turns, endpoint=False)
    height = levels(robot, heights)
    r, a, z = (array.ravel() for array in np.meshgrid(radius, turn, height))
    return within_limits(
        np.unique(np.stack([r * np.cos(a), r * np.sin(a), z], axis=-1).round(9), axis=0), robot
    )


def levels(robot: Parameters, count: int) -> Floats:
    """Return heights in the workspace [m], from top to bottom."""
    k = robot.kinematics
    middle, half = (
        0.5 * (k.workspace_top_m + k.workspace_bottom_m),
        0.5 * (k.workspace_top_m - k.workspace_bottom_m),
    )
    return np.asarray(middle + INWARD * half * np.linspace(1.0, -1.0, count))


def within_limits(points: Floats, robot: Parameters) -> Floats:
    """Return those of the points [m], shape (n, 3), that the robot reaches within its limits."""
    return np.asarray(points[capability(points, robot).limit == REACHED])


def expected_m(covariance: Floats, robot: Parameters, free: Sequence[int], is_placed: bool) -> float:
    """Return the rms error of the TCP over the workspace [m] for a covariance of the scaled free parameters.

    Without ``is_placed`` a rigid motion of all points does not count.
    """
    points = workspace(robot)
    shafts = shafts_of(points, robot)
    moves = model.sensitivity(shafts, robot)[..., list(free)] * SCALES[list(free)]
    flat = moves.reshape(-1, len(free))
    if not is_placed:
        flat = unplaced(flat, points)
    variances = np.einsum('ij,jk,ik->i', flat, covariance, flat)
    return float(np.sqrt(variances.sum() / len(points)))


def shafts_of(points: Floats, robot: Parameters) -> Floats:
    """Return the shaft angles [rad] at which the controller computes these TCP positions."""
    return kinematics.inverse(points, robot) - robot.kinematics.corrections.angle_rad


def unplaced(columns: Floats, points: Floats) -> Floats:
    """Return displacements of points, columns of shape (3 n, m), without their common rigid motion."""
    return np.asarray(columns - _projected(columns, _rigid(points)))


def _flat(rows: Floats) -> Floats:
    """Reshape slopes (n, rows, columns) to (n rows, columns)."""
    return rows.reshape(rows.shape[0] * rows.shape[1], rows.shape[2])


def _rigid(points: Floats) -> Floats:
    """Return the displacements of points under the six rigid motions, shape (3 n, 6)."""
    turned = np.stack([np.cross(axis, points) for axis in np.eye(3)], axis=-1)
    shifted = np.broadcast_to(np.eye(3), (len(points), 3, 3))
    return np.concatenate([shifted, turned], axis=-1).reshape(-1, 6)


def _projected(columns: Floats, onto: Floats) -> Floats:
    """Return the projection of columns onto the space of others."""
    basis, _ = np.linalg.qr(onto)
    return np.asarray(basis @ (basis.T @ columns))


def estimate(
    observation: Observation, noise_m: float, free: Sequence[int] = ALL, is_placed: bool = True
) -> Solution:
    """Estimate the free parameters.

    Parameters
    ----------
    observation
        The measurements and the measured robot.
    noise_m
        Standard deviation of the measurements [m].
    free
        Elements of x to be estimated.
    is_placed
        Whether the instrument measures in the frame of the robot.

    Raises
    ------
    CalibrationError
        The measurements are too few, insufficient, contradictory, or cannot be of this robot.

    """
    robot, columns = observation.robot, list(free)
    used, sigma = observation.used, float(np.hypot(noise_m, MODEL_M))
    begin = model.corrections_of(robot.kinematics)
    _require_reached(observation, begin)
    place = _placed(observation, begin, observation.start(begin), sigma)
    before = observation.residuals(begin, place)
    _require_near(observation, before)
    by_x, by_place = (_flat(part[used]) for part in model.slopes(observation, begin, place))
    shown = by_x[:, columns] * SCALES[columns] / sigma
    if by_place.shape[1]:
        shown = shown - _projected(shown, by_place)
    rows = len(shown)
    if rows < len(columns):
        raise CalibrationError(_too_few(len(used), rows, by_place.shape[1], len(columns)))
    left, values, directions = np.linalg.svd(shown, full_matrices=False)
    kept = int((values >= SEEN).sum())
    freedom = rows - by_place.shape[1] - kept
    if freedom < (0 if len(columns) <= ARMS else FREEDOM_MIN):
        raise CalibrationError(_too_few(len(used), rows, by_place.shape[1], len(columns)))
    basis, hidden = directions[:kept], directions[kept:]
    # homing discards all prior knowledge of the zero angles
    held = np.where((values[:kept] < FIRM) & (len(columns) > ARMS), 1.0, 0.0)
    covariance = basis.T @ np.diag(1.0 / (values[:kept] ** 2 + held)) @ basis + hidden.T @ hidden
    uncertain = (np.eye(len(columns)), covariance)
    off_m = (
        expected_m(uncertain[0], robot, free, is_placed),
        expected_m(uncertain[1], robot, free, is_placed),
    )
    if kept == 0 or off_m[1] > (TOO_LITTLE if is_placed else TOO_LITTLE_UNPLACED) * off_m[0]:
        raise CalibrationError(_too_little(observation, off_m[0], off_m[1]))
    x, place = _solved(
        observation=observation,
        begin=begin,
        place=place,
        sigma=sigma,
        columns=columns,
        basis=basis,
        held=held,
    )
    after = observation.residuals(x, place)
    scatter = float(np.sqrt((after[used] ** 2).sum() / max(freedom, 1))) / sigma
    if freedom:
        _require_agreement(observation, after, np.hstack([shown @ basis.T, by_place]), sigma, scatter)
    # with few degrees of freedom the specified noise is used
    quantile = Z_95 if freedom < FREEDOM_MIN else float(student.ppf(0.975, freedom))
    spread = quantile * max(1.0, scatter) * np.sqrt(np.diag(covariance))

    def response(change: Floats) -> Floats:
        """Return the response of the scaled free parameters to changed residuals [m], a column per cause."""
        own = change / sigma
        if by_place.shape[1]:
            own = own - _projected(own, by_place)
        shares = values[:kept] / (values[:kept] ** 2 + held)
        return np.asarray(basis.T @ (shares[:, None] * (left[:, :kept].T @ own)))

    spread = spread + np.abs(response(_wind_up(observation, begin, place)))[:, 0]
    others = [j for j in ALL if j not in columns and j not in ZEROS]
    if len(columns) < len(ALL) and not begin[others].any():
        spread = np.hypot(spread, Z_95 * np.linalg.norm(response(by_x[:, others] * SCALES[others]), axis=1))
    estimates = tuple(
        Estimate(*model.names()[j], float(begin[j]), float(x[j]), float(spread[n] * SCALES[j]), float(share))
        for n, (j, share) in enumerate(zip(columns, np.diag(covariance), strict=True))
    )
    return Solution(
        x=x,
        place=place,
        estimates=estimates,
        combinations=tuple(_words(row, columns) for row in hidden),
        directions=kept,
        freedom=freedom,
        scatter=scatter,
        expected_m=off_m,
        residuals=(before, after),
    )


def _wind_up(observation: Observation, x: Floats, place: Floats) -> Floats:
    """Return the change of the residuals due to gears that yield under the weight of the arms [m], shape (rows, 1)."""
    robot = observation.robot
    weight = dynamics.gravity(observation.measured.angles_rad, robot)
    twist = weight / robot.rich.gear_stiffness_n_m_rad + 0.5 * robot.rich.gear_backlash_rad * np.sign(weight)
    wound = copy.copy(observation)
    wound.shafts = observation.shafts + twist
    change = wound.residuals(x, place) - observation.residuals(x, place)
    return np.asarray(change[observation.used].reshape(-1, 1))


def _solved(
    observation: Observation,
    begin: Floats,
    place: Floats,
    sigma: float,
    columns: Sequence[int],
    basis: Floats,
    held: Floats,
) -> tuple[Floats, Floats]:
    """Return corrections and instrument unknowns of best fit within the identifiable directions."""
    count, used = len(basis), observation.used

    def at(y: Floats) -> Floats:
        x = begin.copy()
        x[columns] += SCALES[columns] * (basis.T @ y[:count])
        return x

    def left(y: Floats) -> Floats:
        found = observation.residuals(at(y), y[count:])[used].ravel() / sigma
        return np.concatenate([found, held * y[:count]])

    found = least_squares(
        left, np.concatenate([np.zeros(count), place]), jac='3-point', x_scale='jac', method='lm'
    )
    if not found.success:
        raise CalibrationError(f'no arms fit the measurements: {found.message}')
    return at(found.x), found.x[count:]


def _placed(observation: Observation, x: Floats, place: Floats, sigma: float) -> Floats:
    """Return the instrument unknowns of best fit for given arms."""
    if not len(place):
        return place
    used = observation.used
    found = least_squares(lambda p: observation.residuals(x, p)[used].ravel() / sigma, place, x_scale='jac')
    return np.asarray(found.x)


def compared(estimated: Solution, observation: Observation) -> tuple[Residual, ...]:
    """Return the residuals of the measurements used for the estimation, and of the others."""
    checks = observation.measured.checks
    groups = (('used', ~checks), ('not used', checks))
    return tuple(
        residual_of(what, *(r[rows] for r in estimated.residuals)) for what, rows in groups if rows.any()
    )


def residual_of(what: str, before: Floats, after: Floats) -> Residual:
    """Return rms and largest residual of rows of coordinates [m]."""
    lengths = [np.linalg.norm(rows, axis=1) for rows in (before, after)]
    figures = [value for one in lengths for value in (float(np.sqrt(np.mean(one**2))), float(one.max()))]
    return Residual(what, len(before), *figures)


def _words(direction: Floats, columns: Sequence[int]) -> str:
    """Return the parameters that dominate a direction."""
    strong = [n for n in np.argsort(-np.abs(direction)) if abs(direction[n]) > NAMED]
    sign = np.sign(direction[strong[0]]) if strong else 1.0
    names = model.names()
    terms = [
        f'{"+" if sign * direction[n] > 0.0 else "-"} {names[columns[n]][0]}_{names[columns[n]][1]}'
        for n in strong
    ]
    return ' '.join(terms).removeprefix('+ ') or 'many parameters'


def _require_reached(observation: Observation, x: Floats) -> None:
    lost = np.isnan(model.tcp(observation.shafts, x, observation.robot)).any(axis=1)
    if lost.any():
        n = int(np.argmax(lost))
        angles = ', '.join(f'{angle:.3f}' for angle in np.degrees(observation.measured.angles_rad[n]))
        cause = _likely_cause(observation)
        advice = f': all measurements agree {cause}' if cause else ''
        raise CalibrationError(
            f'measurement {n + 1}: the forearms do not meet at arm angles ({angles}) deg{advice}'
        )


def _require_near(observation: Observation, left: Floats) -> None:
    far = np.linalg.norm(left, axis=1)
    if (n := int(np.argmax(far))) >= 0 and far[n] > FAR_M:
        cause = _likely_cause(observation)
        advice = (
            f'all measurements agree {cause}' if cause else 'check that robot, frame and units are correct'
        )
        raise CalibrationError(
            f'measurement {n + 1} is {MM * far[n]:.1f} mm from the TCP computed from the arm angles, the limit is '
            f'{MM * FAR_M:g} mm: {advice}'
        )


def _likely_cause(observation: Observation) -> str:
    """Return the change of axes, signs or units that brings all measurements nearest to the robot, or an empty text."""
    x = model.corrections_of(observation.robot.kinematics)
    best, found = FAR_M, ''
    for text, measured in _changes(observation.measured):
        other = observation.with_measured(measured)
        try:
            far = float(np.linalg.norm(other.residuals(x, other.start(x)), axis=1).max())
        except CalibrationError:
            continue
        if far < NEARER * best:  # false for nan
            best, found = far, text
    return found


def _changes(measured: Measurements) -> Iterator[tuple[str, Measurements]]:
    """Yield usual errors of tables, with the measurements without that error."""
    angles, points = measured.angles_rad, measured.points_m
    orders = list(permutations(range(3)))[1:]
    for order in orders:
        names = ', '.join(str(n + 1) for n in order)
        yield f'with the arm angles in the order {names}', replace(measured, angles_rad=angles[:, order])
    yield 'with the opposite sign of the arm angles', replace(measured, angles_rad=-angles)
    for factor, text in ((math.degrees(1.0), 'radians'), (math.radians(1.0), 'degrees')):
        yield f'with the arm angles as {text}', replace(measured, angles_rad=factor * angles)
    if measured.objects:
        return
    for order in orders:
        names = ', '.join('xyz'[n] for n in order)
        yield (
            f'with the measured coordinates in the order {names}',
            replace(measured, points_m=points[:, order]),
        )
    for axis, name in enumerate('xyz'):
        sign = np.where(np.arange(3) == axis, -1.0, 1.0)
        yield f'with the opposite sign of the measured {name}', replace(measured, points_m=sign * points)
    for factor in (1e3, 1e-3, 25.4, 1.0 / 25.4):
        text = f'with the measured coordinates multiplied by {factor:.4g}'
        yield text, replace(measured, points_m=factor * points)


def _too_few(count: int, rows: int, places: int, figures: int) -> str:
    more = f' and {places} of the instrument' if places else ''
    return (
        f'{count} measurements are too few: they give {rows} equations for {figures} parameters of the arms{more} '
        f'and leave no degrees of freedom'
    )


def _too_little(observation: Observation, before_m: float, after_m: float) -> str:
    points = model.tcp(
        observation.shafts, model.corrections_of(observation.robot.kinematics), observation.robot
    )
    spread = float(np.linalg.norm(np.ptp(points[observation.used], axis=0)))
    return (
        f'the measurements are insufficient: the uncertainty of the TCP over the workspace is {MM * after_m:.2f} mm '
        f'with and {MM * before_m:.2f} mm without them; their poses span {MM * spread:.0f} mm: measure at the poses '
        f'of delta3 calibrate plan'
    )


def _require_agreement(
    observation: Observation, left: Floats, shown: Floats, sigma: float, scatter: float
) -> None:
    """Reject contradictory measurements, and name the one that deviates most from the others."""
    used = observation.used
    basis, _ = np.linalg.qr(shown)
    own = 1.0 - (basis**2).sum(axis=1)
    # residual of a measurement in a fit to all others
    off = (left[used].ravel() / np.maximum(own, 1e-6)).reshape(len(used), -1)
    likely = np.abs(left[used].ravel()) / np.sqrt(np.maximum(own, 1e-6)) / sigma
    worst = int(np.argmax(likely)) // off.shape[1]
    if scatter > CONTRADICTION or likely.max() > OUTLIER:
        rms = scatter * sigma
        raise CalibrationError(
            f'the measurements contradict one another: the residual is {MM * rms:.3f} mm, expected '
            f'{MM * sigma:.3f} mm, and measurement {int(used[worst]) + 1} deviates by '
            f'{MM * np.linalg.norm(off[worst]):.2f} mm from the others; remove it, or set the noise of the instrument '
            f'with --noise'
        )
