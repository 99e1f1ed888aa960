"""Model that relates measurements of the TCP to the geometry of the arms.

Each arm has five parameters x: corrections of l_A, l_B, R, alpha and of the zero of theta. Forward kinematics with
these corrections gives the TCP at the referenced shaft angles, which is compared with the measurement:

    point                     Q (p - t) - X(x)          Q, t: rotation and origin of its frame, free or known
    touch of a plane          n . X(x) - d              n, d: position of the plane, free or known
    touch of a ball           |X(x) - c| - r            c: centre of the ball, free

Unknowns of the instrument (``place``) are eliminated before x is estimated.

Arguments of the functions and methods base:

``x``
    Corrections [m, rad], shape (15,): parameter by parameter, each for the three arms.
``place``
    Unknowns of the instrument [m, rad], shape (n,).
``robot``
    Parameters of the controller.
"""

import dataclasses
import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import CalibrationError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Kinematics, Parameters
from delta3_pacdrive.studies.calibration.study import Measurements

ARMS = 3
STEP = 1e-6  # of central differences [m, rad]
PLANE_POINTS, BALL_POINTS = 3, 4  # points that determine a plane, a ball
NARROW = 0.02  # smallest ratio of the spread across a line to that along it


@dataclass(frozen=True)
class Figure:
    """Geometric parameter of an arm: symbol, name in the parameter file, unit, and tolerance of manufacture."""

    symbol: str
    parameter: str
    unit: str
    tolerance: float


FIGURES = (
    Figure('l_A', 'upper_arm_correction_m', 'm', 2e-4),
    Figure('l_B', 'forearm_correction_m', 'm', 2e-4),
    Figure('R', 'radius_correction_m', 'm', 2e-4),
    Figure('alpha', 'arm_azimuth_correction_deg', 'rad', 5e-4),
    Figure('theta', 'arm_angle_correction_deg', 'rad', 5e-4),
)
ALL = tuple(range(ARMS * len(FIGURES)))
ZEROS = ALL[-ARMS:]  # the zero angles
SCALES = np.repeat([figure.tolerance for figure in FIGURES], ARMS)


def names() -> list[tuple[str, int, str]]:
    """Return symbol, arm and unit of each element of x."""
    return [(figure.symbol, arm + 1, figure.unit) for figure in FIGURES for arm in range(ARMS)]


def corrections_of(kinematics_: Kinematics) -> Floats:
    """Return the corrections of a controller as x."""
    c = kinematics_.corrections
    return np.concatenate([c.upper_arm_m, c.forearm_m, c.radius_m, c.azimuth_rad, c.angle_rad])


def document_of(x: Floats) -> dict[str, list[float]]:
    """Return x by parameter name, in the units of the parameters and rounded."""
    found = {}
    for figure, values in zip(FIGURES, x.reshape(-1, ARMS), strict=True):
        shown = np.degrees(values) if figure.unit == 'rad' else values
        found[figure.parameter] = [round(float(value), 9) + 0.0 for value in shown]
    return found


def corrected(kinematics_: Kinematics, x: Floats) -> Kinematics:
    """Return kinematics with these corrections."""
    values: dict[str, Any] = {
        figure.parameter: tuple((np.degrees(part) if figure.unit == 'rad' else part).tolist())
        for figure, part in zip(FIGURES, x.reshape(-1, ARMS), strict=True)
    }
    return dataclasses.replace(kinematics_, **values)


def tcp(shafts: Floats, x: Floats, robot: Parameters) -> Floats:
    """Return the TCP [m] at referenced shaft angles [rad], shape (n, 3)."""
    zeros = x.reshape(-1, ARMS)[-1]
    return kinematics.forward(shafts + zeros, corrected(robot.kinematics, x), unreachable='nan')


def sensitivity(shafts: Floats, robot: Parameters, x: Floats | None = None) -> Floats:
    """Return the derivative of the TCP with respect to x [m/m, m/rad], shape (n, 3, 15)."""
    base = corrections_of(robot.kinematics) if x is None else x
    columns = [
        (tcp(shafts, base + step, robot) - tcp(shafts, base - step, robot)) / (2.0 * STEP)
        for step in STEP * np.eye(len(ALL))
    ]
    return np.stack(columns, axis=-1)


class Observation(ABC):
    """Measurements of one kind, compared with the robot.

    Parameters
    ----------
    measured
        All measurements, including checks.
    robot
        Parameters of the controller that reported the angles.

    Attributes
    ----------
    shafts
        Referenced shaft angles [rad], shape (n, 3).

    """

    def __init__(self, measured: Measurements, robot: Parameters) -> None:
        self.measured, self.robot = measured, robot
        self.shafts: Floats = measured.angles_rad - robot.kinematics.corrections.angle_rad

    @abstractmethod
    def start(self, x: Floats) -> Floats:
        """Return rough instrument unknowns for x; raises CalibrationError."""

    @abstractmethod
    def residuals(self, x: Floats, place: Floats) -> Floats:
        """Return the residuals [m], one row of one or three values per measurement."""

    def with_measured(self, measured: Measurements) -> 'Observation':
        """Return the same comparison with other measurements."""
        return type(self)(measured, self.robot)

    @property
    def used(self) -> NDArray[np.int64]:
        """Indices of the measurements used for the estimation."""
        return np.flatnonzero(~self.measured.checks)


class PointsInBase(Observation):
    """Points measured in the frame base of the robot."""

    def start(self, x: Floats) -> Floats:
        """Return an empty array: the pose of the instrument is known."""
        return np.zeros(0)

    def residuals(self, x: Floats, place: Floats) -> Floats:
        """Return measured points less those of the robot, shape (n, 3)."""
        return self.measured.points_m - tcp(self.shafts, x, self.robot)


class PointsInFrame(Observation):
    """Points measured in the frame of an instrument at an unknown pose."""

    def start(self, x: Floats) -> Floats:
        """Return position and rotation of the instrument: the best rigid fit (Kabsch)."""
        own, seen = tcp(self.shafts, x, self.robot)[self.used], self.measured.points_m[self.used]
        if len(own) < PLANE_POINTS:
            raise CalibrationError(
                f'{len(own)} measured point(s) do not determine the pose of the instrument, which needs {PLANE_POINTS}'
            )
        for points in (own, seen):
            spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
            if spread[1] <= NARROW * spread[0]:
                raise CalibrationError(
                    'the measured points lie on a line and do not determine the rotation of the instrument'
                )
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', UserWarning)  # points of another robot are rejected afterwards
            turn, _ = Rotation.align_vectors(own - own.mean(axis=0), seen - seen.mean(axis=0))
        return np.concatenate([own.mean(axis=0) - turn.apply(seen.mean(axis=0)), turn.as_rotvec()])

    def residuals(self, x: Floats, place: Floats) -> Floats:
        """Return measured points, transformed to the frame base, less those of the robot, shape (n, 3)."""
        seen = Rotation.from_rotvec(place[3:]).apply(self.measured.points_m) + place[:3]
        return np.asarray(seen - tcp(self.shafts, x, self.robot))


class Touches(Observation):
    """Touches of named planes and balls.

    Parameters
    ----------
    measured, robot
        As for ``Observation``.
    level
        Whether planes are level, such as a levelled surface plate.
    height_m
        Height of a level plane, if known.

    """

    def __init__(
        self, measured: Measurements, robot: Parameters, level: bool = False, height_m: float | None = None
    ) -> None:
        super().__init__(measured, robot)
        self._level, self._height_m = level or height_m is not None, height_m
        self._objects = sorted(set(measured.objects))
        self._rows = {name: np.array([n == name for n in measured.objects]) for name in self._objects}
        self._normals: dict[str, Floats] = {}

    def with_measured(self, measured: Measurements) -> 'Observation':
        """Return the same comparison with other measurements."""
        return Touches(measured, self.robot, self._level, self._height_m)

    def start(self, x: Floats) -> Floats:
        """Return the position of each object: the best plane, the best ball."""
        points = tcp(self.shafts, x, self.robot)
        found = []
        for name in self._objects:
            own = points[self._rows[name] & ~self.measured.checks]
            diameter = self.measured.diameters_m[self._rows[name]][0]
            found.append(self._plane(name, own) if np.isnan(diameter) else _ball(name, own, 0.5 * diameter))
        return np.concatenate(found)

    def _plane(self, name: str, points: Floats) -> Floats:
        if self._height_m is not None:
            return np.zeros(0)
        if self._level:
            return np.array([points[:, 2].mean()])
        if len(points) <= PLANE_POINTS:
            raise CalibrationError(
                f'{len(points)} touch(es) of {name} determine no more than its position, at least {PLANE_POINTS + 1} '
                'are needed'
            )
        middle = points.mean(axis=0)
        _, spread, axes = np.linalg.svd(points - middle)
        if spread[1] <= NARROW * spread[0]:
            raise CalibrationError(f'the touches of {name} lie on a line and do not determine its tilt')
        self._normals[name] = normal = axes[2] * np.sign(axes[2, 2] or 1.0)
        return np.array([0.0, 0.0, float(normal @ middle)])

    def residuals(self, x: Floats, place: Floats) -> Floats:
        """Return the distance of the TCP outside the surface of each touched object, shape (n, 1)."""
        points = tcp(self.shafts, x, self.robot)
        out, begin = np.zeros((len(points), 1)), 0
        for name in self._objects:
            rows = self._rows[name]
            diameter = self.measured.diameters_m[rows][0]
            if not np.isnan(diameter):
                centre, begin = place[begin : begin + 3], begin + 3
                out[rows, 0] = np.linalg.norm(points[rows] - centre, axis=1) - 0.5 * diameter
            elif self._level:
                height = self._height_m if self._height_m is not None else place[begin]
                begin += self._height_m is None
                out[rows, 0] = points[rows, 2] - height
            else:
                (a, b, distance), begin = place[begin : begin + 3], begin + 3
                normal = self._normals[name] + a * _across(self._normals[name])[0]
                normal = normal + b * _across(self._normals[name])[1]
                out[rows, 0] = points[rows] @ (normal / np.linalg.norm(normal)) - distance
        return out


def _ball(name: str, points: Floats, radius_m: float) -> Floats:
    """Return the centre of a ball from points on its upper half."""
    if len(points) <= BALL_POINTS - 1:
        raise CalibrationError(
            f'{len(points)} touch(es) of {name} determine no more than its position, at least {BALL_POINTS} are needed'
        )
    centre = points.mean(axis=0) - [0.0, 0.0, 0.5 * radius_m]
    for _ in range(50):
        away = points - centre
        distance = np.linalg.norm(away, axis=1)
        if not distance.min() > 0.0:
            break
        step, *_ = np.linalg.lstsq(away / distance[:, None], distance - radius_m, rcond=None)
        centre = centre + step
        if np.linalg.norm(step) < 1e-9:
            return np.asarray(centre)
    raise CalibrationError(f'the touches of {name} do not lie on a ball of {2e3 * radius_m:g} mm')


def _across(normal: Floats) -> tuple[Floats, Floats]:
    """Return two orthogonal directions in a plane."""
    first = np.cross(normal, [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


def slopes(observation: Observation, x: Floats, place: Floats) -> tuple[Floats, Floats]:
    """Return the derivatives of the residuals by x and by place, shapes (n, rows, 15) and (n, rows, places)."""

    def column(of_x: Floats, of_place: Floats) -> Floats:
        ahead = observation.residuals(x + of_x, place + of_place)
        return (ahead - observation.residuals(x - of_x, place - of_place)) / (2.0 * STEP)

    no_x, no_place = np.zeros_like(x), np.zeros_like(place)
    by_x = [column(step, no_place) for step in STEP * np.eye(len(x))]
    by_place = [column(no_x, step) for step in STEP * np.eye(len(place))]
    shape = (*observation.residuals(x, place).shape, 0)
    return np.stack(by_x, axis=-1), np.stack(by_place, axis=-1) if by_place else np.zeros(shape)
