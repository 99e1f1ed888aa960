"""Heat of a motor: winding and housing as two bodies, for the temperatures of a shift and of running motors.

    C_w dT_w/dt = P_cu - (T_w - T_h)/R_wh,   C_h dT_h/dt = (T_w - T_h)/R_wh + P_fe + P_fr - (T_h - T_a)/R_ha

    P_cu = 3/2 R I^2 (1 + a dT),   K_m(T) = K_m (1 + b dT),   P_fe = P_fe,max (|w|/w_max)^n,   dT = T_w - T_ref

The magnets are assumed to be as hot as the winding. As the oil of the gears warms up, the viscous friction falls from
F_v to a share of it.

Arguments of the kernels here:

``h``
    Record ``HEAT``.
``winding``, ``housing``
    Temperatures [degC].
``square``
    Mean square of the current [A^2] with which a motor with K_m at the reference temperature has the same torque.
``speed``
    Speed of the motor shaft [rad/s].
``period``
    Time step [s].
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.parameters import Parameters

PHASES = 3
BURNT_DEGC = 300.0  # highest temperature: no insulation survives it

# name and formula of each constant
_CONSTANTS: tuple[tuple[str, Callable[[Parameters], float]], ...] = (
    ('ambient', lambda p: p.thermal.ambient_degc),
    ('reference', lambda p: p.thermal.reference_degc),
    ('copper_coefficient', lambda p: p.thermal.copper_coefficient_1_k),
    ('magnet_coefficient', lambda p: p.thermal.magnet_coefficient_1_k),
    ('resistance', lambda p: PHASES * p.motor.winding_resistance_ohm / 2.0),  # of all phases [ohm]
    ('inner', lambda p: p.thermal.winding_to_housing_k_w),
    ('outer', lambda p: p.thermal.housing_to_ambient_k_w),
    # [K/s per W]
    ('of_winding', lambda p: p.thermal.winding_to_housing_k_w / p.thermal.winding_time_constant_s),
    ('of_housing', lambda p: p.thermal.housing_to_ambient_k_w / p.thermal.housing_time_constant_s),
    ('iron_loss', lambda p: p.thermal.iron_loss_w),
    ('iron_exponent', lambda p: p.thermal.iron_loss_exponent),
    ('speed_max', lambda p: p.motor.max_speed_rad_s),
    ('motor_share', lambda p: p.thermal.motor_friction_share),
    ('warm_share', lambda p: p.thermal.warm_friction_share),
    ('warm_up', lambda p: p.thermal.warm_up_time_constant_s),
)
HEAT = np.dtype([(name, 'f8') for name, _ in _CONSTANTS])


def heat_constants(parameters: Parameters) -> NDArray[Any]:
    """Return one record of ``HEAT``."""
    record = np.zeros(1, HEAT)
    for name, value in _CONSTANTS:
        record[name] = value(parameters)
    return record


@kernel
def resistance_share(winding, h):
    """Resistance of the winding relative to that at the reference temperature."""
    return 1.0 + h.copper_coefficient * (winding - h.reference)


@kernel
def torque_share(winding, h):
    """K_m relative to that at the reference temperature."""
    return 1.0 + h.magnet_coefficient * (winding - h.reference)


@kernel
def copper_loss(square, winding, h):
    """Copper loss [W] for the torque of a motion, and its derivative [W/K]."""
    cold, magnet = h.resistance * square, torque_share(winding, h)
    loss = cold * resistance_share(winding, h) / (magnet * magnet)
    slope = cold * h.copper_coefficient / (magnet * magnet)
    return loss, slope - 2.0 * h.magnet_coefficient / magnet * loss


@kernel
def iron_share(speed, h):
    """Iron loss relative to that at the largest speed."""
    return (abs(speed) / h.speed_max) ** h.iron_exponent


@kernel
def warmer_gear(share, period, h):
    """Viscous friction of a gear relative to F_v, ``share`` before and the result after a ``period`` [s]."""
    return h.warm_share + (share - h.warm_share) * math.exp(-period / h.warm_up)


@kernel
def warmed(winding, housing, square, direct, period, h):
    """Temperatures of winding and housing after a time, with a loss ``direct`` [W] of the housing.

    The step is that of the linearly implicit trapezoidal rule, which is stable for any time constants.
    """
    half = 0.5 * period
    copper, slope = copper_loss(square, winding, h)
    flow, left = (winding - housing) / h.inner, (housing - h.ambient) / h.outer
    rate_w = h.of_winding * (copper - flow)
    rate_h = h.of_housing * (flow + direct - left)
    # (I - half J) step = 2 half rate
    a, b = 1.0 - half * h.of_winding * (slope - 1.0 / h.inner), -half * h.of_winding / h.inner
    c, d = -half * h.of_housing / h.inner, 1.0 + half * h.of_housing * (1.0 / h.inner + 1.0 / h.outer)
    scale = period / (a * d - b * c)
    return winding + scale * (d * rate_w - b * rate_h), housing + scale * (a * rate_h - c * rate_w)


@kernel
def fill_shift(losses, period, burnt, h, found):
    """Fill the temperatures over a shift with cold gears at its start; return the number of rows filled.

    Parameters
    ----------
    losses
        Mean squares of the current without viscous friction, of its product with the current of viscous friction, and
        of the latter [A^2]; iron loss, dry and viscous friction loss [W].
    period, h
        As above.
    burnt
        Temperature of the winding [degC] at which the calculation ends.
    found
        Winding and housing [degC], shape (n, 2); the first row is given.

    """
    rest, mixed, viscous, iron, dry, rubbing = losses
    for n in range(1, found.shape[0]):
        share = warmer_gear(1.0, (n - 0.5) * period, h)
        square = rest + 2.0 * share * mixed + share * share * viscous
        direct = iron + h.motor_share * (dry + share * rubbing)
        found[n, 0], found[n, 1] = warmed(found[n - 1, 0], found[n - 1, 1], square, direct, period, h)
        if found[n, 0] >= burnt:
            found[n, 0] = burnt
            return n + 1
    return found.shape[0]
