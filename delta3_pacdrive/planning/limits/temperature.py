"""Temperature of the motors: winding and housing over a shift in which a motion repeats without a pause.

The heat balance of winding and housing is in ``robot.motor_heat``. A motion is much shorter than their time constants,
so its mean losses act. It needs the same torque at every temperature, so that the current rises as K_m falls, and the
resistance with it:

    P_cu = 3/2 R I^2 (1 + a dT)/(1 + b dT)^2,   dT = T_w - T_ref

with the current I for K_m at T_ref. A loss that grows faster than the heat flow to the ambient has no steady state: the
winding runs away. As the oil of the gears warms up, the viscous friction falls, and with it current and friction loss.
"""

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Motor, Parameters, Thermal
from delta3_pacdrive.planning.paths.path_dynamics import PathDynamics
from delta3_pacdrive.robot.motor_heat import BURNT_DEGC, copper_loss, fill_shift, heat_constants

STEPS_MAX = 20_000  # of a shift
FINE = 20.0  # steps per shortest time constant: errors of the transient below 0.1 %
HOUR_S = 3600.0
SLOWEST = 1e-3  # smallest override that is examined
REST, VISCOUS, MOVING = range(3)  # parts of a current: weight and dry friction, viscous friction, motion


@dataclass(frozen=True)
class Losses:
    """Mean losses of one motor in a motion; mean squares of currents [A^2] for K_m at the reference temperature."""

    rest_a2: float  # of the current without viscous friction
    mixed_a2: float  # of its product with the current of viscous friction
    viscous_a2: float
    iron_w: float
    dry_w: float  # friction loss
    viscous_w: float

    def square_a2(self, share: float) -> float:
        """Return the mean square of the current when the viscous friction has fallen to a share."""
        return self.rest_a2 + 2.0 * share * self.mixed_a2 + share**2 * self.viscous_a2

    def housing_w(self, share: float, thermal: Thermal) -> float:
        """Return the loss that heats the housing directly."""
        return self.iron_w + thermal.motor_friction_share * (self.dry_w + share * self.viscous_w)


@dataclass(frozen=True)
class Course:
    """Temperatures of one motor over a shift, from a cold start."""

    time_s: Floats  # (n,)
    winding_degc: Floats  # (n,), at most ``BURNT_DEGC``
    housing_degc: Floats  # (n,)
    limit_reached_s: float | None  # time until the winding reaches its limit; None if it does not


@dataclass(frozen=True)
class Temperatures:
    """Temperatures of the motors at the end of a shift."""

    ambient_degc: float
    limit_degc: float  # of the windings
    shift_h: float
    winding_degc: Sequence[float]  # at most ``BURNT_DEGC``
    housing_degc: Sequence[float]
    limit_reached_h: Sequence[float | None]  # time until a winding reaches its limit; None if it does not
    steady_winding_degc: Sequence[float | None]  # with warm gears; None if the winding runs away
    override_permanent: float | None  # largest permanent override; None if the motion does not define it

    @property
    def hottest(self) -> int:
        """Index of the motor whose winding reaches its limit first, or is hottest."""
        times = [math.inf if one is None else one for one in self.limit_reached_h]
        return min(range(len(times)), key=lambda n: (times[n], -self.winding_degc[n]))

    @property
    def text(self) -> str:
        """The temperature of the hottest motor as a sentence."""
        n, place = self.hottest, f'{self.shift_h:g} h at {self.ambient_degc:g} degC ambient'
        override = ''
        if self.override_permanent is not None:
            override = f'; permanently possible up to {_percent(self.override_permanent)} % override'
        winding = f'winding of motor {n + 1}'
        if self.winding_degc[n] >= BURNT_DEGC:
            return f'{winding} over {BURNT_DEGC:g} degC (limit {self.limit_degc:g}) within {place}{override}'
        return (
            f'{winding} {self.winding_degc[n]:.0f} degC (limit {self.limit_degc:g}), housing '
            f'{self.housing_degc[n]:.0f} degC after {place}{override}'
        )

    def warnings(self) -> list[str]:
        """Return a warning for each motor whose winding becomes too hot in the shift."""
        return [
            f'the winding of motor {number} reaches {self.limit_degc:g} degC after {_time(hours)} at '
            f'{self.ambient_degc:g} degC ambient if this repeats without a pause'
            for number, hours in enumerate(self.limit_reached_h, start=1)
            if hours is not None
        ]


def _percent(share: float) -> int:
    """Return per cent, rounded down: a limit."""
    return math.floor(100.0 * share + 1e-6)


def _time(hours: float) -> str:
    minutes = 60.0 * hours
    if minutes < 1.0:
        return f'{60.0 * minutes:.0f} s'
    return f'{hours:.1f} h' if hours >= 1.0 else f'{minutes:.0f} min'


@dataclass(frozen=True)
class HeatLoad:
    """Integrals over a motion from which the losses of equal motors follow: those of the arms, or that of an axis."""

    currents_a2_s: (
        Floats  # of the products of ``REST``, ``VISCOUS`` and ``MOVING`` current, shape (motors, 3, 3)
    )
    iron_s: Floats  # of (|w|/w_max)^n, (motors,)
    dry_j: Floats  # friction losses, (motors,)
    viscous_j: Floats
    duration_s: float

    def __add__(self, other: 'HeatLoad') -> 'HeatLoad':
        """Return the load of both motions."""
        return HeatLoad(
            self.currents_a2_s + other.currents_a2_s,
            self.iron_s + other.iron_s,
            self.dry_j + other.dry_j,
            self.viscous_j + other.viscous_j,
            self.duration_s + other.duration_s,
        )

    def times(self, count: float) -> 'HeatLoad':
        """Return the load of ``count`` repetitions."""
        return HeatLoad(
            count * self.currents_a2_s,
            count * self.iron_s,
            count * self.dry_j,
            count * self.viscous_j,
            count * self.duration_s,
        )

    def losses(self, motor: int, thermal: Thermal, override: float = 1.0) -> Losses:
        """Return the mean losses of a motor, from 0, at an override: speeds scale with it, accelerations by its square.

        Weight and dry friction need the same current at every override.
        """
        scale = 1.0 / self.duration_s if self.duration_s > 0.0 else 0.0
        products, square = scale * self.currents_a2_s[motor], override**2
        rest = products[REST, REST] + 2.0 * square * products[REST, MOVING]
        return Losses(
            rest_a2=float(max(rest + square**2 * products[MOVING, MOVING], 0.0)),
            mixed_a2=float(override * (products[REST, VISCOUS] + square * products[VISCOUS, MOVING])),
            viscous_a2=float(square * products[VISCOUS, VISCOUS]),
            iron_w=thermal.iron_loss_w
            * float(scale * self.iron_s[motor])
            * override**thermal.iron_loss_exponent,
            dry_w=float(scale * override * self.dry_j[motor]),
            viscous_w=float(scale * square * self.viscous_j[motor]),
        )

    def override_permanent(self, parameters: Parameters, largest: float) -> float:
        """Return the largest override, at most ``largest``, at which all windings stay within their limit.

        0 if the weight alone overheats a motor.
        """
        low, high = 0.0, largest
        if self._is_permanent(high, parameters):
            return high
        while high - low > SLOWEST:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._is_permanent(middle, parameters) else (low, middle)
        return low

    def _is_permanent(self, override: float, parameters: Parameters) -> bool:
        thermal = parameters.thermal
        return all(
            steady_state(self.losses(n, thermal, override), parameters)[0] <= thermal.winding_limit_degc
            for n in range(len(self.iron_s))
        )

    def temperatures(self, parameters: Parameters, override_max: float | None = None) -> Temperatures:
        """Return the temperatures after a shift in which the motion repeats without a pause.

        ``override_max`` is the largest override of the motion; None if it cannot be run faster or slower.
        """
        return temperatures([(self, parameters)], override_max)


def temperatures(
    loads: Sequence[tuple[HeatLoad, Parameters]], override_max: float | None = None
) -> Temperatures:
    """Return the temperatures of several kinds of motors as ``HeatLoad.temperatures``, each with its parameters."""
    thermal = loads[0][1].thermal
    motors = [(load.losses(n, own.thermal), own) for load, own in loads for n in range(len(load.iron_s))]
    courses = [course(one, own) for one, own in motors]
    steady = [steady_state(one, own)[0] for one, own in motors]
    permanent = None
    if override_max is not None:
        permanent = min(load.override_permanent(own, override_max) for load, own in loads)
    return Temperatures(
        ambient_degc=thermal.ambient_degc,
        limit_degc=thermal.winding_limit_degc,
        shift_h=thermal.shift_h,
        winding_degc=tuple(float(one.winding_degc[-1]) for one in courses),
        housing_degc=tuple(float(one.housing_degc[-1]) for one in courses),
        limit_reached_h=tuple(
            None if one.limit_reached_s is None else one.limit_reached_s / HOUR_S for one in courses
        ),
        steady_winding_degc=tuple(one if math.isfinite(one) else None for one in steady),
        override_permanent=permanent,
    )


def no_heat_load(motors: int) -> HeatLoad:
    """Return the load of a motion without a duration."""
    none = np.zeros(motors)
    return HeatLoad(np.zeros((motors, 3, 3)), none, none, none, 0.0)


def heat_load(d: PathDynamics, parameters: Parameters) -> HeatLoad:
    """Integrate the load of a timed motion over its samples."""
    return motion_heat_load(
        d.time_s, d.motor_speed_rad_s, d.standing_current_a, d.motor_current_a, parameters=parameters
    )


def motion_heat_load(
    time_s: Floats, speed_rad_s: Floats, standing_a: Floats, current_a: Floats, *, parameters: Parameters
) -> HeatLoad:
    """Integrate the load of equal motors over the samples of a motion.

    Parameters
    ----------
    time_s
        Times of the samples [s], shape (n,).
    speed_rad_s, standing_a, current_a
        Motor speeds, currents for weight and friction, and whole currents, (n, motors) each.
    parameters
        Parameters of a robot with these motors in its arms.

    """
    viscous = _viscous_current(speed_rad_s, parameters.motor)
    parts = np.stack([standing_a - viscous, viscous, current_a - standing_a])
    products = np.einsum('ink,jnk->nkij', parts, parts)
    return _integrated(time_s, speed_rad_s, products, parameters)


def sampled_heat_load(
    time_s: Floats,
    speed_rad_s: Floats,
    current_a: Floats,
    square_a2: Floats,
    parameters: Parameters,
    *,
    standing_a: Floats | None = None,
) -> HeatLoad:
    """Integrate the load of an executed motion.

    Parameters
    ----------
    time_s
        Times of the samples [s], shape (n,).
    speed_rad_s, current_a, square_a2
        Motor speeds, currents, and mean squares of the currents, (n, motors) each.
    parameters
        Parameters of a robot with these motors in its arms.
    standing_a
        Currents for weight and friction, shape (n, motors); None: the load is valid for the executed speed only.

    """
    viscous = _viscous_current(speed_rad_s, parameters.motor)
    standing = current_a if standing_a is None else standing_a
    parts = np.stack([standing - viscous, viscous, current_a - standing])
    products = np.einsum('ink,jnk->nkij', parts, parts)
    rest = REST if standing_a is None else MOVING
    products[:, :, rest, rest] += square_a2 - current_a**2
    return _integrated(time_s, speed_rad_s, products, parameters)


def _viscous_current(speed_rad_s: Floats, motor: Motor) -> Floats:
    return motor.viscous_friction_n_m_s_rad / motor.torque_constant_n_m_a * speed_rad_s


def _integrated(time_s: Floats, speed_rad_s: Floats, products: Floats, parameters: Parameters) -> HeatLoad:
    motor = parameters.motor
    dry = motor.static_friction_n_m * np.tanh(speed_rad_s / motor.friction_smoothing_rad_s) * speed_rad_s
    iron = (np.abs(speed_rad_s) / motor.max_speed_rad_s) ** parameters.thermal.iron_loss_exponent
    viscous = motor.viscous_friction_n_m_s_rad * speed_rad_s**2
    currents, irons, dries, viscouses = (
        np.asarray(np.trapezoid(one, time_s, axis=0)) for one in (products, iron, dry, viscous)
    )
    return HeatLoad(currents, irons, dries, viscouses, float(time_s[-1] - time_s[0]))


def steady_state(losses: Losses, parameters: Parameters) -> tuple[float, float]:
    """Return the final temperatures [degC] of winding and housing with warm gears; inf if the winding runs away.

    The loss is a convex function of the temperature, so that Newton's method from the ambient temperature approaches
    the lower of two equilibria from below. It finds none where the loss grows faster than the heat that leaves.
    """
    thermal = parameters.thermal
    square_a2, heat = losses.square_a2(thermal.warm_friction_share), heat_constants(parameters)[0]
    direct_w = losses.housing_w(thermal.warm_friction_share, thermal)
    outer = thermal.housing_to_ambient_k_w
    whole = thermal.winding_to_housing_k_w + outer
    winding = thermal.ambient_degc
    while winding <= BURNT_DEGC:
        copper, slope = copper_loss(square_a2, winding, heat)
        excess = thermal.ambient_degc + whole * copper + outer * direct_w - winding
        if excess <= 1e-9:
            return winding, thermal.ambient_degc + outer * (copper + direct_w)
        if whole * slope >= 1.0:
            break
        winding += excess / (1.0 - whole * slope)
    return math.inf, math.inf


def course(losses: Losses, parameters: Parameters) -> Course:
    """Integrate the temperatures of a motor over a shift, from the ambient temperature and with cold gears."""
    thermal = parameters.thermal
    duration = thermal.shift_h * HOUR_S
    shortest = min(thermal.winding_time_constant_s, thermal.housing_time_constant_s)
    count = min(math.ceil(FINE * duration / shortest), STEPS_MAX)
    found = np.full((count + 1, 2), thermal.ambient_degc)
    step_s = duration / count
    found = found[: fill_shift(astuple(losses), step_s, BURNT_DEGC, heat_constants(parameters)[0], found)]
    times, values = np.linspace(0.0, step_s * (len(found) - 1), len(found)), found[:, 0]
    return Course(times, values, found[:, 1], _reached(times, values, thermal.winding_limit_degc))


def _reached(times: Floats, values: Floats, limit: float) -> float | None:
    """Return the time at which values reach a limit, interpolated linearly; None if they do not."""
    found = np.flatnonzero(values >= limit)
    if not len(found):
        return None
    n = int(found[0])
    return float(np.interp(limit, values[n - 1 : n + 1], times[n - 1 : n + 1]))


def continuous_torque(speed_rad_s: Floats | float, parameters: Parameters) -> Floats:
    """Return the permissible continuous torque [N m] of a warm motor at constant speeds, friction included: S1 curve.

    It is 0 above the speed at which iron loss and friction alone heat the winding to its limit, and above the largest
    speed of the motor.
    """
    motor, thermal = parameters.motor, parameters.thermal
    speed, limit = np.abs(np.asarray(speed_rad_s, dtype=np.float64)), thermal.winding_limit_degc
    dry = motor.static_friction_n_m * np.tanh(speed / motor.friction_smoothing_rad_s) * speed
    viscous = thermal.warm_friction_share * motor.viscous_friction_n_m_s_rad * speed**2
    iron = thermal.iron_loss_w * (speed / motor.max_speed_rad_s) ** thermal.iron_loss_exponent
    direct_w = iron + thermal.motor_friction_share * (dry + viscous)
    outer = thermal.housing_to_ambient_k_w
    room_k = limit - thermal.ambient_degc - outer * direct_w
    permitted_w = np.maximum(room_k, 0.0) / (thermal.winding_to_housing_k_w + outer)
    # the loss of a current of 1 A for K_m at the reference temperature, and so of the torque K_m there
    per_square_w, _ = copper_loss(1.0, limit, heat_constants(parameters)[0])
    torque = motor.torque_constant_n_m_a * np.sqrt(permitted_w / per_square_w)
    return np.where(speed <= motor.max_speed_rad_s, torque, 0.0)
