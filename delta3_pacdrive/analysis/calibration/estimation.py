"""What measurements tell about the arms: least squares over the combinations of figures that they show, and no others.

With residuals in standard deviations of their noise, and figures in what a workshop may miss (``model.SCALES``), a
direction of figures whose singular value is s is known to 1/s of that. Directions that measurements know better than
the workshop (s > 1) are estimated; in all others the arms stay as they were. Where they know little more (s < ``FIRM``)
the workshop counts as one measurement more, so that noise does not become geometry.

What is found makes the TCP right. It is that of the arms only as far as nothing else looks like them: gears that give
under weight do, and where only zero angles are estimated, so do lengths. Intervals have room for both.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.analysis.calibration import model
from delta3_pacdrive.analysis.calibration.data import Left, Told
from delta3_pacdrive.analysis.calibration.model import ALL, ARMS, SCALES, ZEROS, Observation
from delta3_pacdrive.errors import CalibrationError
from delta3_pacdrive.motion.capability import REACHED, capability
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

MODEL_M = 0.01e-3  # what is left without any noise: gears give under weight, and joints have play
SEEN, FIRM = 1.0, 10.0  # singular values from which on a direction is estimated, and by measurements alone
FREEDOM_MIN = 3
Z_95 = 1.959964
FAR_M = 0.05  # no workshop misses so much
CONTRADICTION = 4.0  # rms of what is left over what was to be expected
OUTLIER = 6.0  # the same of one measurement
TOO_LITTLE, TOO_LITTLE_UNPLACED = 0.3, 0.8  # of what a workshop leaves, from which on a calibration is none
NAMED = 0.3  # weight in a direction from which on a figure is named
INWARD = 0.95  # of the workspace, so that the arms as they are built reach it too
GRID, FINE = (5, 12, 3), (8, 17, 6)  # radii, directions and heights of places that stand for the workspace
MM = 1e3


@dataclass(frozen=True)
class Estimate:
    """What one set of measurements gives.

    Attributes
    ----------
    x, place
        Corrections of the arms, unknowns of the instrument.
    told
        About each free figure.
    combinations
        Directions that are not told.
    directions, freedom, scatter
        As in ``study.Found``.
    expected_m
        Rms over the workspace, before and after.
    residuals
        [m], before and after, each of shape (n, rows), of all measurements.

    """

    x: Floats
    place: Floats
    told: tuple[Told, ...]
    combinations: tuple[str, ...]
    directions: int
    freedom: int
    scatter: float
    expected_m: tuple[float, float]
    residuals: tuple[Floats, Floats]


def workspace(robot: Parameters, grid: tuple[int, int, int] = GRID) -> Floats:
    """Return places all over the workspace, but for its very border, that the robot reaches [m], shape (n, 3)."""
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
    """Return heights in the workspace [m], from its top to its bottom."""
    k = robot.kinematics
    middle, half = (
        0.5 * (k.workspace_top_m + k.workspace_bottom_m),
        0.5 * (k.workspace_top_m - k.workspace_bottom_m),
    )
    return np.asarray(middle + INWARD * half * np.linspace(1.0, -1.0, count))


def within_limits(points: Floats, robot: Parameters) -> Floats:
    """Return those of the places [m], shape (n, 3), at which the robot may be."""
    return np.asarray(points[capability(points, robot).limit == REACHED])


def expected_m(covariance: Floats, robot: Parameters, free: Sequence[int], is_placed: bool) -> float:
    """Return how far the TCP is off [m], rms over the workspace, for a covariance of the free figures in scales.

    Unless the instrument knows where the robot is placed, only the shape of what the TCP does counts.
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
    """Return the arm angles, as the shafts are referenced [rad], at which the controller sees the TCP at places."""
    return kinematics.inverse(points, robot) - robot.kinematics.corrections.angle_rad


def unplaced(columns: Floats, points: Floats) -> Floats:
    """Return how places [m], shape (n, 3), move, columns of shape (3 n, m), less what is a motion of all together."""
    return np.asarray(columns - _projected(columns, _rigid(points)))


def _flat(rows: Floats) -> Floats:
    """Return slopes (n, rows, columns) as rows (n rows, columns), of which there may be none."""
    return rows.reshape(rows.shape[0] * rows.shape[1], rows.shape[2])


def _rigid(points: Floats) -> Floats:
    """Return how places move when all of them are moved and turned, shape (3 n, 6)."""
    turned = np.stack([np.cross(axis, points) for axis in np.eye(3)], axis=-1)
    shifted = np.broadcast_to(np.eye(3), (len(points), 3, 3))
    return np.concatenate([shifted, turned], axis=-1).reshape(-1, 6)


def _projected(columns: Floats, onto: Floats) -> Floats:
    """Return the part of columns that lies in the space of others."""
    basis, _ = np.linalg.qr(onto)
    return np.asarray(basis @ (basis.T @ columns))


def estimate(
    observation: Observation, noise_m: float, free: Sequence[int] = ALL, is_placed: bool = True
) -> Estimate:
    """Estimate the free figures.

    Parameters
    ----------
    observation
        The measurements, and the robot that was measured.
    noise_m
        Standard deviation of what is measured [m].
    free
        Elements of x that may be wrong.
    is_placed
        Whether the instrument knows where the robot is.

    Raises
    ------
    CalibrationError
        The measurements are too few, tell too little, contradict one another, or cannot be of this robot.

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
    # who has homed anew knows nothing of zero angles before
    held = np.where((values[:kept] < FIRM) & (len(columns) > ARMS), 1.0, 0.0)
    covariance = basis.T @ np.diag(1.0 / (values[:kept] ** 2 + held)) @ basis + hidden.T @ hidden
    uncertain = (np.eye(len(columns)), covariance)
    off_m = (
        expected_m(uncertain[0], robot, free, is_placed),
        expected_m(uncertain[1], robot, free, is_placed),
    )
    if kept == 0 or off_m[1] > (TOO_LITTLE if is_placed else TOO_LITTLE_UNPLACED) * off_m[0]:
        raise CalibrationError(_too_little(observation, off_m[0], off_m[1]))
    x, place = _solved(observation, begin, place, sigma, columns, basis, held)
    after = observation.residuals(x, place)
    scatter = float(np.sqrt((after[used] ** 2).sum() / max(freedom, 1))) / sigma
    if freedom:
        _require_agreement(observation, after, np.hstack([shown @ basis.T, by_place]), sigma, scatter)
    # with few degrees of freedom the noise is taken for what it was told to be
    quantile = Z_95 if freedom < FREEDOM_MIN else float(student.ppf(0.975, freedom))
    spread = quantile * max(1.0, scatter) * np.sqrt(np.diag(covariance))

    def response(change: Floats) -> Floats:
        """Return what the free figures make of residuals that have changed [m], rows by cause; in scales."""
        own = change / sigma
        if by_place.shape[1]:
            own = own - _projected(own, by_place)
        shares = values[:kept] / (values[:kept] ** 2 + held)
        return np.asarray(basis.T @ (shares[:, None] * (left[:, :kept].T @ own)))

    spread = spread + np.abs(response(_wind_up(observation, begin, place)))[:, 0]
    others = [j for j in ALL if j not in columns and j not in ZEROS]
    if len(columns) < len(ALL) and not begin[others].any():
        spread = np.hypot(spread, Z_95 * np.linalg.norm(response(by_x[:, others] * SCALES[others]), axis=1))
    told = tuple(
        Told(*model.names()[j], float(begin[j]), float(x[j]), float(spread[n] * SCALES[j]), float(share))
        for n, (j, share) in enumerate(zip(columns, np.diag(covariance), strict=True))
    )
    return Estimate(
        x, place, told, tuple(_words(row, columns) for row in hidden), kept, freedom, scatter, off_m,
        (before, after),
    )  # fmt: skip


def _wind_up(observation: Observation, x: Floats, place: Floats) -> Floats:
    """Return how residuals change by what gears give under the weight of the arms [m], shape (rows, 1)."""
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
    """Return corrections and place that fit best, within the directions that are shown."""
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
    """Return the unknowns of the instrument that fit best for given arms."""
    if not len(place):
        return place
    used = observation.used
    found = least_squares(lambda p: observation.residuals(x, p)[used].ravel() / sigma, place, x_scale='jac')
    return np.asarray(found.x)


def compared(estimated: Estimate, observation: Observation) -> tuple[Left, ...]:
    """Return what is left on the measurements that were used, and on those that were not."""
    checks = observation.measured.checks
    groups = (('used', ~checks), ('not used', checks))
    return tuple(
        left_of(what, *(r[rows] for r in estimated.residuals)) for what, rows in groups if rows.any()
    )


def left_of(what: str, before: Floats, after: Floats) -> Left:
    """Return rms and largest of what is left, of rows of coordinates [m]."""
    lengths = [np.linalg.norm(rows, axis=1) for rows in (before, after)]
    figures = [value for one in lengths for value in (float(np.sqrt(np.mean(one**2))), float(one.max()))]
    return Left(what, len(before), *figures)


def _words(direction: Floats, columns: Sequence[int]) -> str:
    """Return the figures that a direction consists of."""
    strong = [n for n in np.argsort(-np.abs(direction)) if abs(direction[n]) > NAMED]
    sign = np.sign(direction[strong[0]]) if strong else 1.0
    names = model.names()
    told = [
        f'{"+" if sign * direction[n] > 0.0 else "-"} {names[columns[n]][0]}_{names[columns[n]][1]}'
        for n in strong
    ]
    return ' '.join(told).removeprefix('+ ') or 'many figures at once'


def _require_reached(observation: Observation, x: Floats) -> None:
    lost = np.isnan(model.tcp(observation.shafts, x, observation.robot)).any(axis=1)
    if lost.any():
        n = int(np.argmax(lost))
        angles = ', '.join(f'{angle:.3f}' for angle in np.degrees(observation.measured.angles_rad[n]))
        raise CalibrationError(f'measurement {n + 1}: the forearms do not meet at arm angles ({angles}) deg')


def _require_near(observation: Observation, left: Floats) -> None:
    far = np.linalg.norm(left, axis=1)
    if (n := int(np.argmax(far))) >= 0 and far[n] > FAR_M:
        raise CalibrationError(
            f'measurement {n + 1} is {MM * far[n]:.1f} mm from where the arms are, and no calibration makes up for '
            f'more than {MM * FAR_M:g} mm: is it of this robot, and in the frame and the units that are told?'
        )


def _too_few(count: int, rows: int, places: int, figures: int) -> str:
    more = f' and {places} of the instrument' if places else ''
    return (
        f'{count} measurements are too few: they give {rows} numbers for {figures} figures of the arms{more}, and '
        f'nothing is left to judge them by'
    )


def _too_little(observation: Observation, before_m: float, after_m: float) -> str:
    points = model.tcp(
        observation.shafts, model.corrections_of(observation.robot.kinematics), observation.robot
    )
    spread = float(np.linalg.norm(np.ptp(points[observation.used], axis=0)))
    return (
        f'the measurements tell too little: with them the TCP is known to {MM * after_m:.2f} mm over the workspace, '
        f'without them to {MM * before_m:.2f} mm; their poses span {MM * spread:.0f} mm: measure where '
        f'delta3 calibrate plan says'
    )


def _require_agreement(
    observation: Observation, left: Floats, shown: Floats, sigma: float, scatter: float
) -> None:
    """Refuse measurements that contradict one another, and name the one that the others contradict most."""
    used = observation.used
    basis, _ = np.linalg.qr(shown)
    own = 1.0 - (basis**2).sum(axis=1)
    # what a measurement would be off if only the others had been used
    off = (left[used].ravel() / np.maximum(own, 1e-6)).reshape(len(used), -1)
    likely = np.abs(left[used].ravel()) / np.sqrt(np.maximum(own, 1e-6)) / sigma
    worst = int(np.argmax(likely)) // off.shape[1]
    if scatter > CONTRADICTION or likely.max() > OUTLIER:
        rms = scatter * sigma
        raise CalibrationError(
            f'the measurements contradict one another: {MM * rms:.3f} mm are left where {MM * sigma:.3f} mm were to be '
            f'expected, and measurement {int(used[worst]) + 1} is {MM * np.linalg.norm(off[worst]):.2f} mm from where '
            f'the others have it; leave it out, or tell the noise of the instrument with --noise'
        )
