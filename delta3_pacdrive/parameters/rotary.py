"""The optional rotary axes of the tool: motor, gear, bar, limits, and parameters of their drives."""

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.axes import ROTARY_AXES_MAX, numbered
from delta3_pacdrive.configuration.fields import positive, quantity
from delta3_pacdrive.parameters.records import Drive, Motor

ANGLE_MAX_DEG = 36_000.0  # a hundred turns
WITH_BAR = ', gear and bar included'
GROUPS = tuple(numbered('rotary', number) for number in range(ROTARY_AXES_MAX))


def _own(group: type[Motor] | type[Drive], name: str, default: float, more: str = '') -> Any:
    """Declare a value that the arms have, too, with the same range and description."""
    about = {f.name: f for f in dataclasses.fields(group)}[name].metadata
    description = about['description'] + more
    return quantity(description, about['low'], about['high'], default=default)


def _angle(description: str, default_deg: float) -> Any:
    return quantity(description, -ANGLE_MAX_DEG, ANGLE_MAX_DEG, default=default_deg)


@dataclass(frozen=True)
class Rotary:
    """Motor on the base plate, gear, telescopic bar and tool (thesis 2.2.4); all absent without ``present``.

    Currents are A rms, R and L phase to phase, as for the other motors. The axis shares with them: periods, filters,
    interpolation and supervision of the drives, friction smoothing, brake times.
    """

    present: bool = quantity('whether the robot has this rotary axis', False, True, default=False)
    peak_current_a: float = _own(Motor, 'peak_current_a', 6.5)
    nominal_current_a: float = _own(Motor, 'nominal_current_a', 1.6)
    max_speed_rpm: float = _own(Motor, 'max_speed_rpm', 6000.0)
    torque_constant_n_m_a: float = _own(Motor, 'torque_constant_n_m_a', 0.6)
    rotor_inertia_kg_m2: float = _own(Motor, 'rotor_inertia_kg_m2', 0.33e-4, ', with the brake')
    winding_resistance_ohm: float = _own(Motor, 'winding_resistance_ohm', 9.0)
    winding_inductance_h: float = _own(Motor, 'winding_inductance_h', 20.0e-3)
    pole_pairs: int = _own(Motor, 'pole_pairs', 3)
    viscous_friction_n_m_s_rad: float = _own(Motor, 'viscous_friction_n_m_s_rad', 1.0e-4, WITH_BAR)
    static_friction_n_m: float = _own(Motor, 'static_friction_n_m', 0.03, WITH_BAR)
    brake_torque_n_m: float = _own(Motor, 'brake_torque_n_m', 1.5)
    gear_ratio: float = quantity('motor revolutions per tool revolution', 1e-3, 1e4, default=10.0)
    tool_inertia_kg_m2: float = positive('inertia of bar and tool about z', 1e2, default=4.0e-3)
    part_gyration_radius_m: float = quantity(
        'radius of gyration of a payload about z', 0.0, 1.0, default=0.05
    )
    backlash_deg: float = quantity(
        'backlash between motor and tool, of a robot with rich.gear', 0.0, 10.0, default=0.03
    )
    bar_stiffness_n_m_rad: float = quantity(
        'torsional stiffness of the bar, of a robot with rich.gear', 1.0, 1e7, default=600.0
    )
    bar_damping_n_m_s_rad: float = quantity('torsional damping of the bar', 0.0, 1e4, default=0.3)
    home_deg: float = _angle('initial tool angle of the plant', 0.0)
    angle_min_deg: float = _angle('smallest angle of the tool', -360.0)
    angle_max_deg: float = _angle('largest angle of the tool', 360.0)
    speed_max_deg_s: float = positive('largest speed of the tool', 1e5, default=2400.0)
    acceleration_max_deg_s2: float = positive('largest acceleration of the tool', 1e7, default=80_000.0)
    jerk_max_deg_s3: float = positive('largest jerk of the tool', 1e10, default=1.2e7)
    position_gain_rad_s_rad: float = _own(Drive, 'position_gain_rad_s_rad', 100.0, ' of its drive')
    velocity_gain_a_s_rad: float = _own(Drive, 'velocity_gain_a_s_rad', 0.12)
    velocity_integral_gain_a_rad: float = _own(Drive, 'velocity_integral_gain_a_rad', 9.0)
    current_gain_v_a: float = _own(Drive, 'current_gain_v_a', 46.0)
    current_integral_gain_v_a_s: float = _own(Drive, 'current_integral_gain_v_a_s', 23_000.0)
    following_error_limit_deg: float = positive(
        'following error of warning 8132 at the tool; eight times as much trips the drive (8111)',
        3600.0,
        default=2.0,
    )
    position_window_deg: float = quantity(
        'position window (S-0-0057) at the tool: largest following error of a drive in position',
        1e-6,
        360.0,
        default=0.05,
    )

    @property
    def home_rad(self) -> float:
        """Initial tool angle of the plant [rad]."""
        return math.radians(self.home_deg)

    @property
    def backlash_rad(self) -> float:
        """Backlash between motor and tool [rad]."""
        return math.radians(self.backlash_deg)

    @property
    def max_speed_rad_s(self) -> float:
        """Largest speed of the motor shaft [rad/s]."""
        return self.max_speed_rpm * math.tau / 60.0

    def inertia_kg_m2(self, payload_kg: float) -> float:
        """Return the inertia about z of bar and tool with the payload."""
        return self.tool_inertia_kg_m2 + payload_kg * self.part_gyration_radius_m**2

    def shaft_inertia_kg_m2(self, payload_kg: float) -> float:
        """Return the total inertia at the motor shaft."""
        return self.rotor_inertia_kg_m2 + self.inertia_kg_m2(payload_kg) / self.gear_ratio**2


def violation(name: str, value: Any, rule: str) -> tuple[str, str]:
    """Return the name of a value, and the sentence about the rule that it violates."""
    return name, f'{name} is {value}, but {rule}'


def present_axes(*axes: Rotary) -> tuple[tuple[str, Rotary], ...]:
    """Return group and values of those rotary axes that a robot has."""
    return tuple((group, axis) for group, axis in zip(GROUPS, axes, strict=True) if axis.present)


def broken_rotary(rotary: Rotary, rotary_2: Rotary) -> Iterator[tuple[str, str]]:
    """Yield violated rules between values of the rotary axes; absent axes have none."""
    if rotary_2.present and not rotary.present:
        yield violation(
            'rotary_2.present', 'true', 'the robot has no first rotary axis (rotary.present is false)'
        )
    for group, axis in present_axes(rotary, rotary_2):
        for name, rule in _broken_axis(group, axis):
            yield violation(f'{group}.{name}', f'{getattr(axis, name):g}', rule)


def _broken_axis(group: str, axis: Rotary) -> Iterator[tuple[str, str]]:
    """Yield the name of each value that violates a rule, and the rule."""
    low, high = axis.angle_min_deg, axis.angle_max_deg
    if low >= high:
        yield 'angle_min_deg', f'must be less than {group}.angle_max_deg ({high:g})'
    if not low <= axis.home_deg <= high:
        limits = f'{group}.angle_min_deg ({low:g}) and {group}.angle_max_deg ({high:g})'
        yield 'home_deg', f'must lie between {limits}'
    fastest, by = math.degrees(axis.max_speed_rad_s / axis.gear_ratio), f'{group}.max_speed_rpm over'
    if axis.speed_max_deg_s > fastest:
        yield 'speed_max_deg_s', f'its motor permits {fastest:g} deg/s at most ({by} {group}.gear_ratio)'
    if axis.nominal_current_a > axis.peak_current_a:
        yield 'nominal_current_a', f'must not exceed {group}.peak_current_a ({axis.peak_current_a:g})'
    strongest = axis.peak_current_a * axis.torque_constant_n_m_a
    if axis.static_friction_n_m >= strongest:
        yield 'static_friction_n_m', f'its motor has only {strongest:g} N m at its peak current'
