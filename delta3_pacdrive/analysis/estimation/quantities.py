"""What can be estimated: the parameters of Table 9-1 by their symbols, in groups, and the sums that signals show."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from delta3_pacdrive.errors import EstimationError, ParameterError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters, flatten

ANGLE_SCALE_RAD = math.pi / 3.0  # "all of it" for the azimuth of an arm: half of what lies between two arms
SMALL_LENGTH_M, SMALL_ANGLE_RAD = 1e-2, 1e-2  # the same for offsets that should be zero


@dataclass(frozen=True)
class Quantity:
    """A quantity is one number to be estimated.

    Attributes
    ----------
    symbol
        Of the thesis (Table 9-1); it names the quantity on the command line and in every output.
    unit
        SI.
    meaning
        In words.
    parameter
        Name in a parameter file, with the place for a list; '' for what belongs to the measurement.
    scale
        What a change is compared with; 0: the value itself, or ``typical`` where it is zero.
    lowest, highest
        Bounds of the estimation, as multiples of the start for values that are positive.

    """

    symbol: str
    unit: str
    meaning: str
    parameter: str = ''
    scale: float = 0.0
    typical: float = 1.0
    lowest: float = 0.05
    highest: float = 20.0

    def read(self, parameters: Parameters) -> float:
        """Value [SI] in a set of parameters; 0 for what belongs to the measurement."""
        if not self.parameter:
            return 0.0
        name, _, place = self.parameter.partition('[')
        value = flatten(parameters)[name]
        if place:
            return math.radians(value[int(place[:-1])])
        return float(value)

    def extent(self, value: float) -> float:
        """Return the scale of changes around a value."""
        return self.scale or abs(value) or self.typical

    def bounds(self, start: float) -> tuple[float, float]:
        """Bounds [SI] for an estimation that begins at ``start``."""
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
    Quantity('l_A', 'm', 'upper arm', 'kinematics.upper_arm_length_m'),
    Quantity('l_B', 'm', 'forearm', 'kinematics.forearm_length_m'),
    Quantity('R_A', 'm', 'circle of the motor axes', 'kinematics.base_radius_m'),
    Quantity('R_B', 'm', 'circle of the joints on the plate', 'kinematics.plate_radius_m'),
    *(Quantity(f'alpha_{i}', 'rad', f'azimuth of arm {i}', f'kinematics.arm_azimuth_deg[{i - 1}]', ANGLE_SCALE_RAD)
      for i in (1, 2, 3)),
    *(Quantity(f'theta0_{i}', 'rad', f'zero of the encoder of arm {i}', scale=SMALL_ANGLE_RAD) for i in (1, 2, 3)),
    *(Quantity(f'{axis}_0', 'm', f'{axis} of the measuring frame', scale=SMALL_LENGTH_M) for axis in 'xyz'),
    *(Quantity(f'r_{axis}', 'rad', f'turn of the measuring frame about {axis}', scale=SMALL_ANGLE_RAD)
      for axis in 'xyz'),
)  # fmt: skip
TABLE = {quantity.symbol: quantity for quantity in _TABLE}
OFFSETS = tuple(f'theta0_{i}' for i in (1, 2, 3))
FRAME = ('x_0', 'y_0', 'z_0', 'r_x', 'r_y', 'r_z')


@dataclass(frozen=True)
class Group:
    """A group holds the quantities that one kind of data shows: free by default, or held unless they are freed."""

    name: str
    free: tuple[str, ...]
    held: tuple[str, ...]

    @property
    def possible(self) -> tuple[str, ...]:
        """Symbols of all its quantities."""
        return self.free + self.held

    def chosen(self, free: Iterable[str] = (), known: Iterable[str] = ()) -> tuple[Quantity, ...]:
        """Free quantities after freeing some and holding others at the values of the parameter file.

        Raises
        ------
        EstimationError
            A symbol does not belong to the group, or nothing is left.

        """
        free, known = set(free), set(known)
        for symbol in sorted(free | known):
            if symbol not in self.possible:
                raise EstimationError(
                    f'{symbol!r} is no quantity of the group {self.name}, expected one of {", ".join(self.possible)}'
                )
        if both := sorted(free & known):
            raise EstimationError(f'{both[0]} cannot be free and known at once')
        symbols = [s for s in self.possible if (s in self.free or s in free) and s not in known]
        if not symbols:
            raise EstimationError('nothing is left to be estimated: every quantity is known')
        return tuple(TABLE[symbol] for symbol in symbols)


_MASSES = ('m_b', 'm_c', 'm_fb', 'm_n', 'm_payload')
_AZIMUTHS = ('alpha_1', 'alpha_2', 'alpha_3')
_LENGTHS = ('l_A', 'l_B', 'R_A', 'R_B')
_ELECTRICAL = ('R', 'L', 'K_m')
_FRICTION = ('F_v', 'F_s')
GROUPS = {
    'motor': Group('motor', (*_ELECTRICAL, *_FRICTION, 'I_m'), ('I_brake', 'w_s', *_MASSES)),
    'masses': Group('masses', (*_MASSES, *_FRICTION), ('w_s', 'I_m', 'I_brake', *_ELECTRICAL)),
    'geometry': Group('geometry', (*_LENGTHS, *_AZIMUTHS), (*OFFSETS, *FRAME)),
}


def values_of(parameters: Parameters) -> dict[str, float]:
    """Return every quantity of a set of parameters by its symbol [SI]."""
    return {symbol: quantity.read(parameters) for symbol, quantity in TABLE.items()}


def with_values(parameters: Parameters, values: Mapping[str, float]) -> Parameters:
    """Return parameters with other values of some quantities; raises EstimationError for what no robot can have."""
    changes: dict[str, Any] = {}
    if 'F_s' in values:
        # no robot breaks away below its F_s: a start or a step beyond the break-away torque takes that along
        changes['rich__break_away_torque_n_m'] = max(parameters.rich.break_away_torque_n_m, values['F_s'])
    azimuth = list(parameters.kinematics.arm_azimuth_deg)
    for symbol, value in values.items():
        name, _, place = TABLE[symbol].parameter.partition('[')
        if place:
            azimuth[int(place[:-1])] = math.degrees(value)
            changes['kinematics__arm_azimuth_deg'] = tuple(azimuth)
        elif name:
            changes[name.replace('.', '__')] = value
    try:
        return parameters.replace(**changes)
    except ParameterError as error:
        raise EstimationError(f'the estimation asks for a robot that cannot be: {error}') from error


def start_values(quantities: Sequence[Quantity], parameters: Parameters, off: float) -> Floats:
    """Values to begin with: those of the parameters, ``off`` (0.3: 30 %) beside them.

    Azimuths, which have no zero of their own, start off by that share of 60 degrees, neighbours in opposite
    directions; offsets start at zero.
    """
    start = []
    for quantity in quantities:
        value = quantity.read(parameters)
        if quantity.symbol in _AZIMUTHS:
            start.append(value + off * quantity.scale * (-1.0) ** int(quantity.symbol[-1]))
        else:
            start.append(value * (1.0 + off))
    return np.array(start)


@dataclass(frozen=True)
class Combination:
    """A combination is a function of quantities that signals may show although they do not show each of them."""

    symbol: str
    unit: str
    formula: str
    depends: tuple[str, ...]
    value: Callable[[Mapping[str, float], Parameters], float]
    only_beside: str = ''  # a quantity that must be hidden as well, for ratios to it


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
                ('m_n', 'm_payload', 'm_fb', 'K_m'), lambda v, p: base_constants(v, p)[1] / v['K_m'], 'K_m'),
    Combination('m_br r_Gb / K_m', 'kg m A/(N m)', 'l_A (m_b/2 + m_c + r m_fb) / K_m',
                ('m_b', 'm_c', 'm_fb', 'K_m'), lambda v, p: base_constants(v, p)[2] / v['K_m'], 'K_m'),
    Combination('F_s / K_m', 'A', 'F_s / K_m', ('F_s', 'K_m'), lambda v, p: v['F_s'] / v['K_m'], 'K_m'),
    Combination('F_v / K_m', 'A s/rad', 'F_v / K_m', ('F_v', 'K_m'), lambda v, p: v['F_v'] / v['K_m'], 'K_m'),
    Combination('R_A - R_B', 'm', 'R_A - R_B', ('R_A', 'R_B'), lambda v, p: v['R_A'] - v['R_B']),
    Combination('alpha_2 - alpha_1', 'rad', 'alpha_2 - alpha_1', ('alpha_1', 'alpha_2'),
                lambda v, p: v['alpha_2'] - v['alpha_1']),
    Combination('alpha_3 - alpha_1', 'rad', 'alpha_3 - alpha_1', ('alpha_1', 'alpha_3'),
                lambda v, p: v['alpha_3'] - v['alpha_1']),
)  # fmt: skip
