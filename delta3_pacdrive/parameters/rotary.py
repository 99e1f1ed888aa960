"""The optional rotary axes of the tool: motor, gear, bar, limits, and parameters of their drives."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.axes import ROTARY_AXES_MAX, numbered
from delta3_pacdrive.configuration.fields import quantity

SMALLEST = math.nextafter(0.0, 1.0)
ANGLE_MAX_DEG = 36_000.0  # a hundred turns

GROUPS = tuple(numbered('rotary', number) for number in range(ROTARY_AXES_MAX))


@dataclass(frozen=True)
class Rotary:
    """Motor on the base plate, gear, telescopic bar and tool (thesis 2.2.4); all absent without ``present``.

    Currents are A rms, R and L phase to phase, as for the other motors. The axis shares with them: periods, filters,
    interpolation and supervision of the drives, friction smoothing, brake times.
    """

    present: bool = quantity('whether the robot has this rotary axis', False, True, default=False)
    peak_current_a: float = quantity('i_peak of its motor', SMALLEST, 1e3, default=6.5)
    nominal_current_a: float = quantity('i_nom', SMALLEST, 1e3, default=1.6)
    max_speed_rpm: float = quantity('RPM_max', SMALLEST, 1e5, default=6000.0)
    torque_constant_n_m_a: float = quantity('K_m', SMALLEST, 1e2, default=0.6)
    rotor_inertia_kg_m2: float = quantity('I_m, with the brake', SMALLEST, 1.0, default=0.33e-4)
    winding_resistance_ohm: float = quantity('R, phase to phase', SMALLEST, 1e3, default=9.0)
    winding_inductance_h: float = quantity('L, phase to phase', SMALLEST, 10.0, default=20.0e-3)
    pole_pairs: int = quantity('z_p', 1, 100, default=3)
    viscous_friction_n_m_s_rad: float = quantity(
        'F_v at the motor, gear and bar included', 0.0, 1.0, default=1.0e-4
    )
    static_friction_n_m: float = quantity('F_s at the motor, gear and bar included', 0.0, 1e2, default=0.03)
    brake_torque_n_m: float = quantity('torque of its holding brake', 0.0, 1e3, default=1.5)
    gear_ratio: float = quantity('motor revolutions per tool revolution', 1e-3, 1e4, default=10.0)
    tool_inertia_kg_m2: float = quantity('inertia of bar and tool about z', SMALLEST, 1e2, default=4.0e-3)
    part_gyration_radius_m: float = quantity(
        'radius of gyration of a payload about z',
        0.0,
        1.0,
        default=0.05,
    )
    backlash_deg: float = quantity(
        'backlash between motor and tool, of a robot with rich.gear', 0.0, 10.0, default=0.03
    )
    bar_stiffness_n_m_rad: float = quantity(
        'torsional stiffness of the bar, of a robot with rich.gear', 1.0, 1e7, default=600.0
    )
    bar_damping_n_m_s_rad: float = quantity('torsional damping of the bar', 0.0, 1e4, default=0.3)
    home_deg: float = quantity('initial tool angle of the plant', -ANGLE_MAX_DEG, ANGLE_MAX_DEG, default=0.0)
    angle_min_deg: float = quantity(
        'smallest angle of the tool', -ANGLE_MAX_DEG, ANGLE_MAX_DEG, default=-360.0
    )
    angle_max_deg: float = quantity('largest angle of the tool', -ANGLE_MAX_DEG, ANGLE_MAX_DEG, default=360.0)
    speed_max_deg_s: float = quantity('largest speed of the tool', SMALLEST, 1e5, default=2400.0)
    acceleration_max_deg_s2: float = quantity(
        'largest acceleration of the tool', SMALLEST, 1e7, default=80_000.0
    )
    jerk_max_deg_s3: float = quantity('largest jerk of the tool', SMALLEST, 1e10, default=1.2e7)
    position_gain_rad_s_rad: float = quantity('K_Ppos of its drive', 0.0, 1666.0, default=100.0)
    velocity_gain_a_s_rad: float = quantity('K_Pvel', 0.0, 100.0, default=0.12)
    velocity_integral_gain_a_rad: float = quantity('K_Ivel', 0.0, 1e5, default=9.0)
    current_gain_v_a: float = quantity('K_Pcurr, per phase', 0.0, 1e3, default=46.0)
    current_integral_gain_v_a_s: float = quantity('K_Icurr, per phase', 0.0, 1e7, default=23_000.0)
    following_error_limit_deg: float = quantity(
        'following error of warning 8132 at the tool; eight times as much trips the drive (8111)',
        SMALLEST,
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


def broken_rotary(rotary: Rotary, rotary_2: Rotary) -> Iterator[tuple[str, str]]:
    """Yield violated rules between values of the rotary axes; absent axes have none."""
    if rotary_2.present and not rotary.present:
        yield violation(
            'rotary_2.present', 'true', 'the robot has no first rotary axis (rotary.present is false)'
        )
    for group, axis in zip(GROUPS, (rotary, rotary_2), strict=True):
        if axis.present:
            yield from _broken_axis(group, axis)


def _broken_axis(group: str, rotary: Rotary) -> Iterator[tuple[str, str]]:
    low, high = rotary.angle_min_deg, rotary.angle_max_deg
    if low >= high:
        yield violation(
            f'{group}.angle_min_deg', f'{low:g}', f'must be less than {group}.angle_max_deg ({high:g})'
        )
    if not low <= rotary.home_deg <= high:
        yield violation(
            f'{group}.home_deg',
            f'{rotary.home_deg:g}',
            f'must lie between {group}.angle_min_deg ({low:g}) and {group}.angle_max_deg ({high:g})',
        )
    fastest = math.degrees(rotary.max_speed_rad_s / rotary.gear_ratio)
    if rotary.speed_max_deg_s > fastest:
        yield violation(
            f'{group}.speed_max_deg_s',
            f'{rotary.speed_max_deg_s:g}',
            f'its motor permits {fastest:g} deg/s at most ({group}.max_speed_rpm over {group}.gear_ratio)',
        )
    if rotary.nominal_current_a > rotary.peak_current_a:
        yield violation(
            f'{group}.nominal_current_a',
            f'{rotary.nominal_current_a:g}',
            f'must not exceed {group}.peak_current_a ({rotary.peak_current_a:g})',
        )
    if rotary.static_friction_n_m >= rotary.peak_current_a * rotary.torque_constant_n_m_a:
        yield (
            f'{group}.static_friction_n_m',
            f'{group}.static_friction_n_m is {rotary.static_friction_n_m:g}, which its motor cannot overcome: it has '
            f'{rotary.peak_current_a * rotary.torque_constant_n_m_a:g} N m at its peak current',
        )
