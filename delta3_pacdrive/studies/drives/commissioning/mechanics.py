"""Inertia, resonance, dead time and friction of one axis at a pose, with 95 % intervals.

The inertia is fitted to y = K_m I / (-w^2 Theta), for a rigid axis and for one with an elastic gear:

    rigid    y = (J + b/(j w)) e^(j w T)
    elastic  y = (J_m + J_a K/(K - w^2 J_a) + b/(j w)) e^(j w T),  K = c + j w d

The drives of the other arms hold them; their small motion Theta_j is measured, and its torque A_ij Theta_j of the model
is subtracted. T absorbs the time between the instants of current and position. Friction follows from pairs of strokes:
half the difference of the torques there and back, in which weight and cogging cancel, is F_s + F_v w.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy import optimize, stats

from delta3_pacdrive import dynamics
from delta3_pacdrive.errors import TuningError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.studies.drives.commissioning.responses import AxisResponse
from delta3_pacdrive.studies.drives.commissioning.robot import AxisRecord
from delta3_pacdrive.studies.drives.commissioning.strokes import Strokes
from delta3_pacdrive.studies.drives.loops.identification import Measured
from delta3_pacdrive.studies.drives.loops.response import Complex

CONFIDENCE = 0.95
LOWEST_HZ, RIGID_HZ, HIGHEST_HZ = (
    8.0,
    100.0,
    800.0,
)  # of the fits; the lowest line contains the change of the load
EXCHANGE_SHARE = (
    0.2  # highest frequency of the fit with an elastic gear, times the exchange period with the plant
)
LINES_MIN = 6  # in the band of a fit
FRICTION_HALF_RAD, FRICTION_SPEEDS_RAD_S = 3.0, (12.0, 25.0, 40.0)  # above the Stribeck effect
BINS = 12  # of the position, each with its own difference of torques
ELASTIC = (
    0.3  # residual of the elastic model, relative to the rigid one, up to which the gear counts as elastic
)
FLOOR = 0.01  # standard deviation of a line beyond that of its coherence, relative to the median inertia
CENTRE = 1e-3  # relative standard deviation: the inertia changes along a stroke, whose middle is not exactly the pose
SMALL_ARM = 0.1  # smallest inertia of an arm, relative to its rotor
DELAY_HZ = (30.0, 200.0)  # of the dead time


@dataclass(frozen=True)
class Interval:
    """An estimate with its 95 % interval."""

    value: float
    low: float
    high: float

    def contains(self, value: float) -> bool:
        """Return whether a value is in the interval."""
        return self.low <= value <= self.high


@dataclass(frozen=True)
class Gear:
    """Identified elastic gear, motor side."""

    rotor_kg_m2: float
    resonance_hz: float  # of rotor against arm
    antiresonance_hz: float  # of the arm with a held rotor


class Curve(Protocol):
    """Fitted inertia y over the frequency."""

    def __call__(self, frequencies_hz: Floats, share: float = 1.0) -> Complex:
        """Return y [kg m2]; with the arm changed so that the total is ``share`` of the identified inertia."""


@dataclass(frozen=True)
class Mechanics:
    """Identified mechanics of an axis at a pose, motor side."""

    axis: int  # 0 to 2
    inertia_kg_m2: Interval
    model_inertia_kg_m2: float  # A_ii / k_r^2 of the parameters
    gear: Gear | None  # None: rigid
    dead_time_s: float  # from the current reference to the measured speed
    static_friction_n_m: Interval
    viscous_friction_n_m_s_rad: Interval
    curve: Curve


def friction_strokes(axis: int) -> Strokes:
    """Return the strokes for the friction of an axis, 0 to 2."""
    return Strokes(axis, FRICTION_HALF_RAD, FRICTION_SPEEDS_RAD_S)


def identify(
    response: AxisResponse, friction: AxisRecord, angles_rad: Sequence[float], parameters: Parameters
) -> Mechanics:
    """Return the mechanics of an axis.

    Parameters
    ----------
    response
        Measured responses of the axis.
    friction
        Record of ``friction_strokes``.
    angles_rad
        Arm angles of the pose, shape (3,).
    parameters
        K_m, payload and model of the robot.

    Raises
    ------
    TuningError
        The trusted band is too narrow, or strokes are missing.

    """
    axis, ratio = response.axis, parameters.dynamics.gear_ratio
    masses = dynamics.mass_matrix(np.array(angles_rad), parameters) / ratio**2
    own = response.inertia
    measured = replace(own, values=own.values - np.delete(masses[axis], axis) @ response.others)
    inertia, gear, curve = _inertia(measured, EXCHANGE_SHARE / parameters.bus.exchange_period_s)
    static, viscous = _friction(friction, ratio * angles_rad[axis], parameters)
    return Mechanics(
        axis=axis,
        inertia_kg_m2=inertia,
        model_inertia_kg_m2=float(masses[axis, axis]),
        gear=gear,
        dead_time_s=_dead_time(response, parameters),
        static_friction_n_m=static,
        viscous_friction_n_m_s_rad=viscous,
        curve=curve,
    )


def _inertia(measured: Measured, highest_hz: float) -> tuple[Interval, Gear | None, Curve]:
    rigid = _Fit(_rigid, measured, RIGID_HZ, [float(np.median(measured.values.real)), 0.0, 0.0])
    fits = [
        _Fit(
            _elastic, measured, min(highest_hz, HIGHEST_HZ), [rotor, rigid.point[0], resonance, 0.1, 0.0, 0.0]
        )
        for rotor in (0.1 * abs(rigid.point[0]), 0.3 * abs(rigid.point[0]))
        for resonance in (30.0, 60.0, 120.0)
    ]
    elastic = min(fits, key=lambda fit: fit.scatter)
    rotor, arm, hertz, *_ = np.abs(elastic.point)
    if elastic.scatter > ELASTIC * elastic.scatter_of(_rigid, rigid.point):
        return rigid.interval(np.array([1.0, 0.0, 0.0])), None, rigid.curve
    total = elastic.interval(np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0]))
    gear = Gear(float(rotor), float(hertz * np.sqrt(1.0 + arm / rotor)), float(hertz))
    return total, gear, elastic.curve


def _rigid(point: Floats, omega: Floats) -> Complex:
    inertia, friction, time = point * UNITS[[0, 4, 5]]
    return np.asarray((inertia - 1j * friction / omega) * np.exp(1j * omega * time))


def _elastic(point: Floats, omega: Floats) -> Complex:
    rotor, arm, hertz, damping, friction, time = point * UNITS
    own = 2.0 * np.pi * hertz
    stiffness = arm * (own**2 + 2j * damping * own * omega)
    carried = arm * stiffness / (stiffness - omega**2 * arm)
    return np.asarray((rotor + carried - 1j * friction / omega) * np.exp(1j * omega * time))


# of J_m, J_a [kg m2], antiresonance [Hz], its damping, b [N m s/rad], T [s]: the fit works with numbers near 1
UNITS = np.array([1.0, 1.0, 1.0, 1.0, 1e-3, 1e-5])


class _Fit:
    """Robust least squares of a model of y in a band; raises TuningError."""

    def __init__(
        self,
        model: Callable[[Floats, Floats], Complex],
        measured: Measured,
        highest_hz: float,
        start: list[float],
    ) -> None:
        frequencies = measured.frequencies_hz
        kept = measured.trusted & (frequencies >= LOWEST_HZ) & (frequencies <= highest_hz)
        if kept.sum() < LINES_MIN:
            raise TuningError(
                f'only {int(kept.sum())} lines of the excitation between {LOWEST_HZ:g} and {highest_hz:g} Hz can be '
                f'trusted, {LINES_MIN} are needed: raise drive.excitation_rms_a (P-0-0091)'
            )
        self._omega, self._values = 2.0 * np.pi * frequencies[kept], measured.values[kept]
        size = np.abs(self._values)
        self._spread = size * measured.error[kept] + FLOOR * float(np.median(size))
        scale = np.where(np.array(start) == 0.0, 1.0, np.abs(start))
        found = optimize.least_squares(
            lambda point: self._residuals(model, point), start, loss='soft_l1', x_scale=scale, max_nfev=2000
        )
        self.point: Floats = found.x
        self._model = model
        self.scatter = self.scatter_of(model, found.x)
        self._jacobian = found.jac

    def _residuals(self, model: Callable[[Floats, Floats], Complex], point: Floats) -> Floats:
        gap = (model(point, self._omega) - self._values) / self._spread
        return np.concatenate([gap.real, gap.imag])

    def scatter_of(self, model: Callable[[Floats, Floats], Complex], point: Floats) -> float:
        """Return the root mean square of the weighted residuals of a model with the lines of this fit."""
        return float(np.sqrt(np.mean(self._residuals(model, point) ** 2)))

    def curve(self, frequencies_hz: Floats, share: float = 1.0) -> Complex:
        """Return the fitted model over the frequency, as ``Curve``."""
        point = self.point.copy()
        if self._model is _rigid:
            point[0] *= share
        else:
            # stiffness and damping of the gear stay
            point[1] = max(share * (point[0] + point[1]) - point[0], SMALL_ARM * point[0])
            point[2:4] *= np.sqrt(self.point[1] / point[1])
        return self._model(point, 2.0 * np.pi * frequencies_hz)

    def interval(self, weights: Floats) -> Interval:
        """Return a weighted sum of the estimates with its interval."""
        free = 2 * len(self._omega) - len(self.point)
        covariance = np.linalg.pinv(self._jacobian.T @ self._jacobian) * max(self.scatter, 1e-12) ** 2
        value = float(weights @ self.point)
        deviation = np.hypot(np.sqrt(weights @ covariance @ weights), CENTRE * value)
        spread = float(deviation * stats.t.ppf(0.5 + 0.5 * CONFIDENCE, free))
        return Interval(value, value - spread, value + spread)


def _dead_time(response: AxisResponse, parameters: Parameters) -> float:
    """Return the time [s] by which the measured speed lags behind the integral of the current reference."""
    speed = response.speed
    low, high = DELAY_HZ
    kept = speed.trusted & (speed.frequencies_hz >= low) & (speed.frequencies_hz <= high)
    omega = 2.0 * np.pi * speed.frequencies_hz[kept]
    # the mechanics from current to position are those of y, so that also those of an elastic gear are removed
    mechanics = parameters.motor.torque_constant_n_m_a / (1j * omega * response.inertia.values[kept])
    lag = -np.unwrap(np.angle(speed.values[kept] / mechanics))
    return float(np.median(lag / omega)) if kept.any() else float('nan')


def _friction(record: AxisRecord, pose_rad: float, parameters: Parameters) -> tuple[Interval, Interval]:
    """Return static and viscous friction from pairs of strokes; raises TuningError."""
    strokes = friction_strokes(record.axis)
    position = record.own('encoder_position') - pose_rad
    torque = parameters.motor.torque_constant_n_m_a * record.own('current')
    edges = np.linspace(-strokes.half_rad, strokes.half_rad, BINS + 1)
    speeds, frictions = [], []
    for speed, pair in zip(strokes.speeds_rad_s, strokes.pieces(position, record.sample_s), strict=True):
        if len(pair) != 2:
            raise TuningError(
                f'axis{record.axis + 1} made {len(pair)} of 2 strokes at {speed:g} rad/s for its friction'
            )
        there, back = (_binned(position[piece], torque[piece], edges) for piece in pair)
        frictions.append(0.5 * np.abs(there - back))
        speeds.append(np.full(BINS, speed))
    return _line(np.concatenate(speeds), np.concatenate(frictions))


def _binned(position: Floats, torque: Floats, edges: Floats) -> Floats:
    place = np.clip(np.digitize(position, edges) - 1, 0, BINS - 1)
    return np.asarray(np.bincount(place, torque, BINS) / np.maximum(np.bincount(place, minlength=BINS), 1))


def _line(x: Floats, y: Floats) -> tuple[Interval, Interval]:
    """Return intercept and slope of a straight line with their intervals."""
    fit = stats.linregress(x, y)
    share = stats.t.ppf(0.5 + 0.5 * CONFIDENCE, len(x) - 2)

    def interval(value: float, error: float) -> Interval:
        return Interval(float(value), float(value - share * error), float(value + share * error))

    return interval(fit.intercept, fit.intercept_stderr), interval(fit.slope, fit.stderr)
