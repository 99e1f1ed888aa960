"""Quantities that can be estimated: parameters of Table 9-1 by symbol, groups, and identifiable combinations.

Quantities of built robots that the thesis does not model belong to effects, which are switched on if one of them is
free.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from delta3_pacdrive.errors import EstimationError, ParameterError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ELASTIC_EXCHANGE_S, Parameters, flatten

# scales: the change of a quantity that counts as 100 %
ANGLE_SCALE_RAD = math.pi / 3.0  # azimuth of an arm: half the angle between two arms
SMALL_LENGTH_M, SMALL_ANGLE_RAD = 1e-2, 1e-2  # offsets that should be zero
CURRENT_DELAY_S = 62.5e-6  # instant at which a logger samples the current
SMALL_GAIN, SMALL_CURRENT_A = 0.02, 0.05  # errors of current sensors
PRIOR_REACH = 4.0  # standard deviations of a prior within which a quantity stays
BUILT_EXCHANGE_S = 125e-6  # for elastic gears: each step of the velocity loop uses the true shaft

_AZIMUTHS = ('alpha_1', 'alpha_2', 'alpha_3')


@dataclass(frozen=True)
class Quantity:
    """Quantity that can be estimated."""

    symbol: str  # as in Table 9-1; used on the command line and in outputs
    unit: str  # SI
    meaning: str
    parameter: str = ''  # name in a parameter file, with the index in a list; empty for the measurement
    scale: float = 0.0  # reference for changes; 0: the value itself, or 'typical' if it is zero
    typical: float = 1.0
    lowest: float = 0.05  # bound, as a multiple of a positive start value
    highest: float = 20.0  # upper bound
    effect: str = ''  # switch in the group rich on which it depends
    # standard deviation of a normal prior, as a multiple of ``extent``; 0: none
    prior: float = 0.0
    expected: float = 0.0  # mean of the prior of a quantity without a parameter [SI]

    @property
    def is_error(self) -> bool:
        """Whether it is an error or offset that should be zero."""
        return bool(self.scale) and self.symbol not in _AZIMUTHS

    def read(self, parameters: Parameters) -> float:
        """Return its value [SI] in a set of parameters; 0 for quantities of the measurement and errors that are off."""
        if not self.parameter or (self.is_error and not self.is_on(parameters)):
            return 0.0
        name, _, place = self.parameter.partition('[')
        value = flatten(parameters)[name]
        number = float(value[int(place[:-1])] if place else value)
        return math.radians(number) if name.endswith('_deg') else number

    def is_on(self, parameters: Parameters) -> bool:
        """Whether a robot with these parameters has it."""
        return not self.effect or bool(getattr(parameters.rich.effects, self.effect))

    def extent(self, value: float) -> float:
        """Return the scale of changes around a value."""
        return self.scale or abs(value) or self.typical

    def bounds(self, start: float) -> tuple[float, float]:
        """Return the bounds [SI] of an estimation that begins at ``start``."""
        if self.prior:
            reach = PRIOR_REACH * self.prior * self.extent(start)
            return start - reach, start + reach
        if self.scale:
            return start - 3.0 * self.scale, start + 3.0 * self.scale
        return self.lowest * start, self.highest * (start or self.typical)


_TABLE = (
    Quantity('R', 'Ohm', 'winding resistance, phase to phase', 'motor.winding_resistance_ohm'),
    Quantity('L', 'H', 'winding inductance, phase to phase', 'motor.winding_inductance_h'),
    Quantity('K_m', 'N m/A', 'torque constant per ampere rms; a third is the back-EMF constant of a phase',
             'motor.torque_constant_n_m_a'),
    Quantity('F_v', 'N m s/rad', 'viscous friction, motor side', 'motor.viscous_friction_n_m_s_rad', typical=1e-4),
    Quantity('F_s', 'N m', 'static friction, motor side', 'motor.static_friction_n_m', typical=1e-2),
    Quantity('w_s', 'rad/s', 'smoothing of the static friction', 'motor.friction_smoothing_rad_s'),
    Quantity('I_m', 'kg m^2', 'rotor inertia', 'motor.rotor_inertia_kg_m2'),
    Quantity('I_brake', 'kg m^2', 'inertia of the brake', 'motor.brake_inertia_kg_m2', typical=1e-5),
    Quantity('m_b', 'kg', 'upper arm', 'dynamics.upper_arm_mass_kg', typical=0.1),
    Quantity('m_c', 'kg', 'elbow', 'dynamics.elbow_mass_kg', typical=0.1),
    Quantity('m_fb', 'kg', 'forearm, both rods', 'dynamics.forearm_mass_kg', typical=0.1),
    Quantity('m_n', 'kg', 'plate', 'dynamics.plate_mass_kg'),
    Quantity('m_payload', 'kg', 'payload', 'dynamics.payload_mass_kg', typical=0.1),
    Quantity('t_I', 's', 'time from a sample of the current to its AT, beyond that of this robot',
             scale=CURRENT_DELAY_S, prior=1.0, expected=CURRENT_DELAY_S),
    # gains are set in other units and rounded; filters and current loops differ between drives
    Quantity('K_Ppos', 'rad/s/rad', 'position gain of the drives', 'drive.position_gain_rad_s_rad', prior=0.05),
    Quantity('K_Pvel', 'A s/rad', 'velocity gain of the drives', 'drive.velocity_gain_a_s_rad', prior=0.05),
    Quantity('K_Ivel', 'A/rad', 'integral velocity gain of the drives', 'drive.velocity_integral_gain_a_rad',
             prior=0.1),
    Quantity('F_currRef', 's', 'filter of the current reference of the drives', 'drive.current_reference_filter_s',
             typical=62.5e-6, prior=0.2),
    Quantity('K_Pcurr', 'V/A', 'current gain of the drives', 'drive.current_gain_v_a', prior=0.1),
    Quantity('l_A', 'm', 'upper arm', 'kinematics.upper_arm_length_m'),
    Quantity('l_B', 'm', 'forearm', 'kinematics.forearm_length_m'),
    Quantity('R_A', 'm', 'circle of the motor axes', 'kinematics.base_radius_m'),
    Quantity('R_B', 'm', 'circle of the joints on the plate', 'kinematics.plate_radius_m'),
    *(Quantity(f'alpha_{i}', 'rad', f'azimuth of arm {i}', f'kinematics.arm_azimuth_deg[{i - 1}]', ANGLE_SCALE_RAD)
      for i in (1, 2, 3)),
    *(Quantity(f'theta0_{i}', 'rad', f'zero of the encoder of arm {i}', f'rich.arm_angle_error_deg[{i - 1}]',
               SMALL_ANGLE_RAD, effect='geometry') for i in (1, 2, 3)),
    *(Quantity(f'{axis}_0', 'm', f'{axis} of the measuring frame', scale=SMALL_LENGTH_M) for axis in 'xyz'),
    *(Quantity(f'r_{axis}', 'rad', f'turn of the measuring frame about {axis}', scale=SMALL_ANGLE_RAD)
      for axis in 'xyz'),
    Quantity('F_b', 'N m', 'break-away torque, motor side', 'rich.break_away_torque_n_m', effect='friction'),
    Quantity('w_st', 'rad/s', 'Stribeck speed, motor side', 'rich.stribeck_speed_rad_s', effect='friction'),
    Quantity('z_b', 'rad', 'deflection before break-away, motor side', 'rich.presliding_rad', effect='friction'),
    Quantity('c_g', 'N m/rad', 'stiffness of the gears, arm side', 'rich.gear_stiffness_n_m_rad', effect='gear'),
    Quantity('d_g', 'N m s/rad', 'damping of the gears, arm side', 'rich.gear_damping_n_m_s_rad', typical=10.0,
             effect='gear'),
    Quantity('b_g', 'rad', 'backlash of the gears, arm side', 'rich.gear_backlash_rad', typical=1e-4, effect='gear'),
    Quantity('T_c', 'N m', 'amplitude of the cogging torque', 'rich.cogging_torque_n_m', typical=1e-2,
             effect='ripple'),
    Quantity('a_6', '1', 'ripple of K_m', 'rich.torque_ripple', typical=1e-2, effect='ripple'),
    *(Quantity(f'gain_{i}', '1', f'gain error of the current sensors of motor {i}', f'rich.current_gain_error[{i - 1}]',
               SMALL_GAIN, effect='sensors') for i in (1, 2, 3)),
    *(Quantity(f'offset_{i}', 'A', f'offset of a phase current of motor {i}', f'rich.current_offset_a[{i - 1}]',
               SMALL_CURRENT_A, effect='sensors') for i in (1, 2, 3)),
    *(Quantity(f'd{symbol}_{i}', unit, f'error of {symbol} of arm {i}', f'rich.{name}[{i - 1}]', scale,
               effect='geometry')
      for symbol, unit, name, scale in (('l_A', 'm', 'upper_arm_error_m', SMALL_LENGTH_M),
                                        ('l_B', 'm', 'forearm_error_m', SMALL_LENGTH_M),
                                        ('R', 'm', 'radius_error_m', SMALL_LENGTH_M),
                                        ('alpha', 'rad', 'arm_azimuth_error_deg', SMALL_ANGLE_RAD))
      for i in (1, 2, 3)),
)  # fmt: skip
EFFECTS = ('forearm_rods', 'gear', 'friction', 'ripple', 'sensors', 'geometry')  # switches of the group rich
TABLE = {quantity.symbol: quantity for quantity in _TABLE}
OFFSETS = tuple(f'theta0_{i}' for i in (1, 2, 3))
OF_ARMS = tuple(tuple(f'd{name}_{i}' for i in (1, 2, 3)) for name in ('l_A', 'l_B', 'R', 'alpha'))
FRAME = ('x_0', 'y_0', 'z_0', 'r_x', 'r_y', 'r_z')
OF_DRIVES = (
    't_I',
    'K_Ppos',
    'K_Pvel',
    'K_Ivel',
    'F_currRef',
    'K_Pcurr',
)  # nuisance parameters of a third-party log


@dataclass(frozen=True)
class Group:
    """Quantities that one kind of data identifies, free or held by default."""

    name: str
    free: tuple[str, ...]
    held: tuple[str, ...]  # held unless freed
    built: tuple[str, ...] = ()  # quantities of built robots; free by default if the robot has the effect

    @property
    def possible(self) -> tuple[str, ...]:
        """Symbols of all quantities of the group."""
        return self.free + self.held + self.built

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects of built robots with quantities in the group; their names stand for all of them."""
        return tuple(dict.fromkeys(TABLE[symbol].effect for symbol in self.built))

    def named(self, symbols: Iterable[str]) -> tuple[str, ...]:
        """Return the symbols with names of effects replaced by their quantities; raises EstimationError."""
        found: list[str] = []
        for symbol in symbols:
            if symbol in self.effects:
                found += [s for s in self.built if TABLE[s].effect == symbol]
            elif symbol in self.possible:
                found.append(symbol)
            else:
                raise EstimationError(
                    f'{symbol!r} is not a quantity of the group {self.name}, '
                    f'expected one of {", ".join(self.possible + self.effects)}'
                )
        return tuple(dict.fromkeys(found))

    def chosen(
        self, free: Iterable[str] = (), known: Iterable[str] = (), robot: Parameters | None = None
    ) -> tuple[Quantity, ...]:
        """Return the free quantities, given those to be freed and those held at the values of the parameter file.

        Quantities of the effects of ``robot`` are free as well.

        Raises
        ------
        EstimationError
            A symbol does not belong to the group, or no quantity is free.

        """
        free, known = set(self.named(sorted(free))), set(self.named(sorted(known)))
        if both := sorted(free & known):
            raise EstimationError(f'{both[0]} cannot be both free and known')
        if robot is not None:
            free |= {symbol for symbol in self.built if TABLE[symbol].is_on(robot)} - known
        symbols = [s for s in self.possible if (s in self.free or s in free) and s not in known]
        if not symbols:
            raise EstimationError('nothing to estimate: all quantities are known')
        return tuple(TABLE[symbol] for symbol in symbols)


_MASSES = ('m_b', 'm_c', 'm_fb', 'm_n', 'm_payload')
_LENGTHS = ('l_A', 'l_B', 'R_A', 'R_B')
_ELECTRICAL = ('R', 'L', 'K_m')
_FRICTION = ('F_v', 'F_s')
_DRIVEN = tuple(q.symbol for q in _TABLE if q.effect and q.effect != 'geometry')
GROUPS = {
    'motor': Group(
        'motor', (*_ELECTRICAL, *_FRICTION, 'I_m'), ('I_brake', 'w_s', *_MASSES, *OF_DRIVES), _DRIVEN
    ),
    'masses': Group(
        'masses', (*_MASSES, *_FRICTION), ('w_s', 'I_m', 'I_brake', *_ELECTRICAL, *OF_DRIVES), _DRIVEN
    ),
    'geometry': Group(
        'geometry', (*_LENGTHS, *_AZIMUTHS), FRAME, (*OFFSETS, *(s for own in OF_ARMS for s in own))
    ),
}


def values_of(parameters: Parameters) -> dict[str, float]:
    """Return all quantities of a set of parameters by symbol [SI]."""
    return {symbol: quantity.read(parameters) for symbol, quantity in TABLE.items()}


def with_values(parameters: Parameters, values: Mapping[str, float]) -> Parameters:
    """Return parameters with other values of some quantities; raises EstimationError for impossible ones."""
    changes: dict[str, Any] = {}
    if 'F_s' in values:
        # the break-away torque is at least F_s: raise it together with F_s
        break_away = values.get('F_b', parameters.rich.break_away_torque_n_m)
        values = {**values, 'F_b': max(break_away, values['F_s'])}
    flat = flatten(parameters)
    for symbol, value in values.items():
        name, _, place = TABLE[symbol].parameter.partition('[')
        if not name:
            continue
        key, number = name.replace('.', '__'), math.degrees(value) if name.endswith('_deg') else value
        if place:
            numbers = list(changes.get(key, flat[name]))
            numbers[int(place[:-1])] = number
            changes[key] = tuple(numbers)
        else:
            changes[key] = number
    try:
        return parameters.replace(**changes)
    except ParameterError as error:
        raise EstimationError(f'the estimation requires impossible parameters: {error}') from error


def with_effects_of(parameters: Parameters, quantities: Iterable[Quantity]) -> Parameters:
    """Return parameters with the effects to which the quantities belong switched on; errors start at zero."""
    missing = {q.effect for q in quantities if q.effect and not q.is_on(parameters)}
    if not missing:
        return parameters
    effects = parameters.rich.effects
    changes: dict[str, Any] = {'rich__enabled': True}
    for name in EFFECTS:
        changes[f'rich__{name}'] = bool(getattr(effects, name)) or name in missing
    if 'gear' in missing and parameters.bus.exchange_period_s > ELASTIC_EXCHANGE_S:
        changes['bus__exchange_period_s'] = BUILT_EXCHANGE_S
    on = parameters.replace(**changes)
    errors = {q.symbol: 0.0 for q in TABLE.values() if q.is_error and q.effect in missing}
    return with_values(on, errors)


def start_values(quantities: Sequence[Quantity], parameters: Parameters, off: float) -> Floats:
    """Return start values: those of the parameters, changed by the share ``off`` (0.3: 30 %).

    Azimuths, which have no natural zero, are shifted by that share of 60 degrees, neighbours in opposite directions.
    With a share errors start at zero. Quantities with a prior start at its mean.
    """
    start = []
    for quantity in quantities:
        value = quantity.read(parameters)
        if quantity.prior:
            start.append(value or quantity.expected)
        elif quantity.symbol in _AZIMUTHS:
            start.append(value + off * quantity.scale * (-1.0) ** int(quantity.symbol[-1]))
        elif quantity.is_error and off:
            start.append(0.0)
        else:
            start.append(value * (1.0 + off))
    return np.array(start)


@dataclass(frozen=True)
class Combination:
    """Function of quantities that may be identifiable although the quantities are not."""

    symbol: str
    unit: str
    formula: str
    depends: tuple[str, ...]
    value: Callable[[Mapping[str, float], Parameters], float]
    only_beside: str = ''  # for ratios: quantity that must be hidden as well


def base_constants(v: Mapping[str, float], parameters: Parameters) -> tuple[float, float, float]:
    """I_b [kg m^2], m_nt [kg] and m_br r_Gb [kg m] of ``dynamics.inertia`` for other masses (4.8.1)."""
    share, ratio = parameters.dynamics.forearm_share_at_elbow, parameters.dynamics.gear_ratio
    l_a = parameters.kinematics.upper_arm_length_m
    at_elbow = v['m_c'] + share * v['m_fb']
    return (
        ratio**2 * (v['I_m'] + v['I_brake']) + l_a**2 * (v['m_b'] / 3.0 + at_elbow),
        v['m_n'] + v['m_payload'] + 3.0 * (1.0 - share) * v['m_fb'],
        l_a * (v['m_b'] / 2.0 + at_elbow),
    )


def _seen_constant(gain: str, v: Mapping[str, float], _: Parameters) -> float:
    """Return the apparent K_m through a current sensor."""
    return v['K_m'] / (1.0 + v[gain])


COMBINATIONS = (
    Combination('m_nt', 'kg', 'm_n + m_payload + 3 (1 - r) m_fb', ('m_n', 'm_payload', 'm_fb'),
                lambda v, p: base_constants(v, p)[1]),
    Combination('m_br r_Gb', 'kg m', 'l_A (m_b/2 + m_c + r m_fb)', ('m_b', 'm_c', 'm_fb'),
                lambda v, p: base_constants(v, p)[2]),
    Combination('I_b', 'kg m^2', 'k_r^2 (I_m + I_brake) + l_A^2 (m_b/3 + m_c + r m_fb)',
                ('m_b', 'm_c', 'm_fb', 'I_m', 'I_brake'), lambda v, p: base_constants(v, p)[0]),
    Combination('m_c + r m_fb', 'kg', 'm_c + r m_fb', ('m_c', 'm_fb'),
                lambda v, p: v['m_c'] + p.dynamics.forearm_share_at_elbow * v['m_fb']),
    Combination('I_m + I_brake', 'kg m^2', 'I_m + I_brake', ('I_m', 'I_brake'),
                lambda v, p: v['I_m'] + v['I_brake']),
    Combination('m_nt / K_m', 'kg A/(N m)', '(m_n + m_payload + 3 (1 - r) m_fb) / K_m',
                ('m_n', 'm_payload', 'm_fb', 'K_m'), lambda v, p: base_constants(v, p)[1] / v['K_m'],
                only_beside='K_m'),
    Combination('m_br r_Gb / K_m', 'kg m A/(N m)', 'l_A (m_b/2 + m_c + r m_fb) / K_m',
                ('m_b', 'm_c', 'm_fb', 'K_m'), lambda v, p: base_constants(v, p)[2] / v['K_m'],
                only_beside='K_m'),
    Combination('F_s / K_m', 'A', 'F_s / K_m', ('F_s', 'K_m'), lambda v, p: v['F_s'] / v['K_m'], only_beside='K_m'),
    Combination('F_v / K_m', 'A s/rad', 'F_v / K_m', ('F_v', 'K_m'),
                lambda v, p: v['F_v'] / v['K_m'], only_beside='K_m'),
    Combination('m_n + m_payload', 'kg', 'm_n + m_payload', ('m_n', 'm_payload'),
                lambda v, p: v['m_n'] + v['m_payload']),
    Combination('m_b/3 + m_c', 'kg', 'm_b/3 + m_c', ('m_b', 'm_c'), lambda v, p: v['m_b'] / 3.0 + v['m_c']),
    *(Combination(f'K_m / (1 + gain_{i})', 'N m/A', f'K_m / (1 + gain_{i})', ('K_m', f'gain_{i}'),
                  partial(_seen_constant, f'gain_{i}')) for i in (1, 2, 3)),
    Combination('R_A - R_B', 'm', 'R_A - R_B', ('R_A', 'R_B'), lambda v, p: v['R_A'] - v['R_B']),
    Combination('alpha_2 - alpha_1', 'rad', 'alpha_2 - alpha_1', ('alpha_1', 'alpha_2'),
                lambda v, p: v['alpha_2'] - v['alpha_1']),
    Combination('alpha_3 - alpha_1', 'rad', 'alpha_3 - alpha_1', ('alpha_1', 'alpha_3'),
                lambda v, p: v['alpha_3'] - v['alpha_1']),
)  # fmt: skip
