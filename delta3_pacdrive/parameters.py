"""Parameters P1 to P4 (Table 9-1), bus and motion: frozen groups, and the rules that their values keep."""

import dataclasses
import functools
import hashlib
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from delta3_pacdrive.configuration import parameter_file
from delta3_pacdrive.configuration.checked import Errors, refuse
from delta3_pacdrive.errors import ParameterError, shown

DEFAULT_FILE = 'delta3.yaml'
PLANTS = ('plain', 'rich')
LINEAR, CUBIC = INTERPOLATIONS = ('linear', 'cubic')
# Half of what the robot holds where it is weakest in its workspace: 21.0 kg by the holding brakes, 22.6 kg by the
# nominal currents. The other half is for acceleration and for the loops, which are tuned to the rated 2 kg.
PAYLOAD_MAX_KG = 10.0
CYCLE_TIMES_S = (1.0e-3, 2.0e-3, 4.0e-3)
EXCHANGE_PERIODS_S = (
    125.0e-6,
    250.0e-6,
    500.0e-6,
    1.0e-3,
)  # with older coupling torques the drives oscillate
ELASTIC_EXCHANGE_S = (
    250.0e-6  # behind an elastic gear a rotor escapes an observer that takes it for the whole arm
)


def _quantity(description: str, low: float = -math.inf, high: float = math.inf, **more: Any) -> Any:
    """Declare a field with the text and the closed range that every reader of it enforces.

    A value with a ``default`` may be missing in a file.
    """
    return field(metadata={'description': description, 'low': low, 'high': high}, **more)


def _positive(description: str, high: float = math.inf) -> Any:
    return _quantity(description, math.nextafter(0.0, 1.0), high)


def _switch(description: str) -> Any:
    return _quantity(description, False, True)


def _choice(description: str, choices: tuple[str, ...]) -> Any:
    metadata = {'description': f'{description}: {" or ".join(choices)}', 'choices': choices}
    return field(default=choices[0], metadata=metadata)


PerArm = tuple[float, float, float]
EQUAL: PerArm = (0.0, 0.0, 0.0)


def _correction(description: str, limit: float) -> Any:
    return _quantity(description, -limit, limit, default=EQUAL)


@dataclass(frozen=True)
class ArmDeviations:
    """Each arm deviates from the drawing by these figures: lengths [m] and angles [rad] of arms 1 to 3.

    Attributes
    ----------
    upper_arm_m, forearm_m, radius_m
        Of l_A, of l_B and of R.
    azimuth_rad
        Of alpha.
    angle_rad
        Arm angle beyond that which its shaft, as it was referenced, stands for.

    """

    upper_arm_m: PerArm = EQUAL
    forearm_m: PerArm = EQUAL
    radius_m: PerArm = EQUAL
    azimuth_rad: PerArm = EQUAL
    angle_rad: PerArm = EQUAL


def _radians(degrees: PerArm) -> PerArm:
    first, second, third = degrees
    return math.radians(first), math.radians(second), math.radians(third)


def _sums(value: float, more: PerArm) -> PerArm:
    return value + more[0], value + more[1], value + more[2]


@dataclass(frozen=True)
class Kinematics:
    """P1: geometry of the arms and the limits of the workspace."""

    upper_arm_length_m: float = _positive('l_A, upper arm', 2.0)
    forearm_length_m: float = _positive('l_B, forearm', 4.0)
    base_radius_m: float = _positive('R_A, circle of the motor axes', 2.0)
    plate_radius_m: float = _positive('R_B, circle of the forearm joints on the plate', 2.0)
    arm_azimuth_deg: tuple[float, float, float] = _quantity('alpha_i, direction of each arm', -360.0, 360.0)
    arm_angle_min_deg: float = _quantity('smallest arm angle under control', -90.0, 0.0)
    arm_angle_max_deg: float = _quantity('largest arm angle under control', 0.0, 150.0)
    forearm_swing_max_deg: float = _positive('largest sideways swing of a forearm', 90.0)
    workspace_diameter_m: float = _positive('diameter of the workspace cylinder', 8.0)
    workspace_top_m: float = _quantity('z of the top of the workspace', -8.0, 0.0)
    workspace_bottom_m: float = _quantity('z of the bottom of the workspace', -8.0, 0.0)
    serial_singularity_min: float = _quantity('smallest s.b/(l_A l_B) a move may reach', 0.0, 1.0)
    parallel_singularity_min: float = _quantity('smallest |det S|/l_B^3 a move may reach', 0.0, 1.0)
    upper_arm_correction_m: tuple[float, float, float] = _correction(
        'calibrated l_A of each arm, less that of the drawing', 0.02
    )
    forearm_correction_m: tuple[float, float, float] = _correction(
        'calibrated l_B of each arm, less that of the drawing', 0.02
    )
    radius_correction_m: tuple[float, float, float] = _correction(
        'calibrated R of each arm, less that of the drawing', 0.02
    )
    arm_azimuth_correction_deg: tuple[float, float, float] = _correction(
        'calibrated alpha of each arm, less that of the drawing', 5.0
    )
    arm_angle_correction_deg: tuple[float, float, float] = _correction(
        'calibrated arm angle, less that of the shaft as it was referenced', 5.0
    )

    @property
    def corrections(self) -> ArmDeviations:
        """How the arms deviate from the drawing, as far as the controller knows: what a calibration has found."""
        return ArmDeviations(
            self.upper_arm_correction_m,
            self.forearm_correction_m,
            self.radius_correction_m,
            _radians(self.arm_azimuth_correction_deg),
            _radians(self.arm_angle_correction_deg),
        )

    @property
    def radius_difference_m(self) -> float:
        """R = R_A - R_B of the drawing (4.2)."""
        return self.base_radius_m - self.plate_radius_m

    @property
    def upper_arm_lengths_m(self) -> PerArm:
        """l_A of each arm, calibrated."""
        return _sums(self.upper_arm_length_m, self.upper_arm_correction_m)

    @property
    def forearm_lengths_m(self) -> PerArm:
        """l_B of each arm, calibrated."""
        return _sums(self.forearm_length_m, self.forearm_correction_m)

    @property
    def base_radii_m(self) -> PerArm:
        """R_A of each arm, calibrated; R_B is that of the drawing."""
        return _sums(self.base_radius_m, self.radius_correction_m)

    @property
    def arm_azimuth_rad(self) -> PerArm:
        """The three azimuths alpha_i [rad], calibrated."""
        one, two, three = self.drawn_azimuth_rad
        more = self.corrections.azimuth_rad
        return one + more[0], two + more[1], three + more[2]

    @property
    def drawn_azimuth_rad(self) -> PerArm:
        """The three azimuths alpha_i [rad] of the drawing."""
        return _radians(self.arm_azimuth_deg)

    @property
    def arm_angle_min_rad(self) -> float:
        """Smallest arm angle under control [rad]."""
        return math.radians(self.arm_angle_min_deg)

    @property
    def arm_angle_max_rad(self) -> float:
        """Largest arm angle under control [rad]."""
        return math.radians(self.arm_angle_max_deg)


@dataclass(frozen=True)
class Drive:
    """P2: the MC-4's cascade, feed-forwards, filters and supervision."""

    position_period_s: float = _positive('T_pos, period of position loop and fine interpolation', 1e-3)
    velocity_period_s: float = _positive('T_vel, period of the velocity loop', 1e-3)
    current_period_s: float = _positive('T_cur, period of the current loop', 1e-3)
    position_gain_rad_s_rad: float = _quantity('K_Ppos', 0.0, 1666.0)
    velocity_gain_a_s_rad: float = _quantity('K_Pvel', 0.0, 100.0)
    velocity_integral_gain_a_rad: float = _quantity('K_Ivel', 0.0, 1e5)
    current_gain_v_a: float = _quantity('K_Pcurr, per phase', 0.0, 1e3)
    current_integral_gain_v_a_s: float = _quantity('K_Icurr, per phase', 0.0, 1e7)
    velocity_feedforward: float = _quantity('FF_vel', 0.0, 2.0)
    current_feedforward: float = _quantity('FF_curr', 0.0, 2.0)
    feedforward_inertia_kg_m2: float = _quantity('inertia of the current feed-forward, motor side', 0.0, 1.0)
    observer_arm_inertia_kg_m2: float = _positive('A_bar of the shaft observer, arm side', 1e3)
    velocity_filter_s: float = _quantity('F_vel, low-pass of the actual velocity', 0.0, 0.1)
    current_reference_filter_s: float = _quantity('F_currRef, low-pass of the current reference', 0.0, 0.1)
    current_filter_s: float = _quantity('F_curr, low-pass of the actual current', 0.0, 0.1)
    commutation_offset_rad: float = _quantity('CO, electrical', -math.pi, math.pi)
    dc_link_voltage_v: float = _positive('V_dc', 1e3)
    following_error_limit_rad: float = _positive(
        'following error of warning 8132, motor side; eight times as much trips the drive (8111)', 1e3
    )
    velocity_limit_rad_s: float = _positive("limit of the speed reference, besides the motor's maximum", 1e4)
    torque_limit_n_m: float = _positive("limit of K_m times the current reference, besides i_peak's", 1e4)
    overspeed_factor: float = _quantity("speed that trips the drive over the motor's maximum", 1.0, 2.0)
    overload_time_s: float = _positive('integral of (I/i_nom)^2 - 1 that trips the drive', 1e3)
    enable_settle_s: float = _quantity('time the current loop holds before the brake is released', 0.0, 1.0)
    stop_deceleration_rad_s2: float = _positive('ramp of reaction BD2, motor side', 1e6)
    stop_time_max_s: float = _positive('longest controlled stop before the brake is applied', 10.0)
    interpolation: str = _choice('fine interpolation of set points within a bus cycle', INTERPOLATIONS)


@dataclass(frozen=True)
class Dynamics:
    """P3: masses, gear and end stops."""

    upper_arm_mass_kg: float = _quantity('m_b', 0.0, 1e3)
    elbow_mass_kg: float = _quantity('m_c', 0.0, 1e3)
    forearm_mass_kg: float = _quantity('m_fb, both rods of one arm', 0.0, 1e3)
    plate_mass_kg: float = _positive('m_n', 1e3)
    payload_mass_kg: float = _quantity('m_payload', 0.0, PAYLOAD_MAX_KG)
    forearm_share_at_elbow: float = _quantity('r, share of the forearm mass at the elbow (4.8)', 0.0, 1.0)
    gravity_m_s2: float = _quantity('g', 0.0, 30.0)
    gear_in: float = _positive('GR_in', 1e4)
    gear_out: float = _positive('GR_out', 1e4)
    end_stop_min_deg: float = _quantity('arm angle of the upper end stop', -90.0, 0.0)
    end_stop_max_deg: float = _quantity('arm angle of the lower end stop', 0.0, 170.0)
    end_stop_stiffness_n_m_rad: float = _quantity('stiffness of the end stops', 0.0, 1e6)
    end_stop_damping_n_m_s_rad: float = _quantity('damping of the end stops', 0.0, 1e4)

    @property
    def gear_ratio(self) -> float:
        """k_r = GR_in / GR_out (4.17)."""
        return self.gear_in / self.gear_out

    @property
    def plate_total_mass_kg(self) -> float:
        """m_nt: plate, payload and the forearms' share at the plate (4.8.1)."""
        return (
            self.plate_mass_kg
            + self.payload_mass_kg
            + 3.0 * (1.0 - self.forearm_share_at_elbow) * self.forearm_mass_kg
        )


@dataclass(frozen=True)
class Motor:
    """P4: motor, winding, friction and holding brake; currents A rms, R and L phase to phase."""

    peak_current_a: float = _positive('i_peak', 1e3)
    nominal_current_a: float = _positive('i_nom', 1e3)
    max_speed_rpm: float = _positive('RPM_max', 1e5)
    torque_constant_n_m_a: float = _positive('K_m', 1e2)
    rotor_inertia_kg_m2: float = _positive('I_m', 1.0)
    brake_inertia_kg_m2: float = _quantity('I_brake', 0.0, 1.0)
    winding_resistance_ohm: float = _positive('R, phase to phase', 1e3)
    winding_inductance_h: float = _positive('L, phase to phase', 10.0)
    pole_pairs: int = _quantity('z_p', 1, 100)
    viscous_friction_n_m_s_rad: float = _quantity('F_v', 0.0, 1.0)
    static_friction_n_m: float = _quantity('F_s', 0.0, 1e2)
    friction_smoothing_rad_s: float = _quantity('w_s of F_s tanh(w/w_s)', 0.05, 1e2)
    brake_torque_n_m: float = _quantity('torque of the holding brake', 0.0, 1e3)
    brake_release_s: float = _quantity('time from command to released brake', 0.0, 1.0)
    brake_apply_s: float = _quantity('time from command to applied brake', 0.0, 1.0)

    @property
    def max_speed_rad_s(self) -> float:
        """Largest shaft speed [rad/s]."""
        return self.max_speed_rpm * math.tau / 60.0


@dataclass(frozen=True)
class Rich:
    """What the thesis leaves out: the plant, and the drives' sensors, as those of a built robot."""

    enabled: bool = _switch(
        'whether any of the effects below is on; without it the plant is that of the thesis'
    )
    forearm_rods: bool = _switch('forearms as uniform rods instead of split masses')
    gear: bool = _switch('elastic gears with backlash; needs an exchange period of at most 250e-6')
    gear_stiffness_n_m_rad: float = _quantity('torsional stiffness of a gear, arm side', 1e2, 1e7)
    gear_damping_n_m_s_rad: float = _quantity('its damping, arm side', 0.0, 1e4)
    gear_backlash_rad: float = _quantity('lost motion between the flanks, arm side', 0.0, 0.1)
    friction: bool = _switch(
        'Coulomb friction F_s with stiction and Stribeck effect instead of F_s tanh(w/w_s)'
    )
    break_away_torque_n_m: float = _positive('torque that sets a standing shaft in motion', 1e2)
    stribeck_speed_rad_s: float = _quantity('speed w_st of the fall from break-away to F_s', 1e-2, 1e3)
    presliding_rad: float = _quantity(
        'deflection of the bristles under the break-away torque, motor side', 1e-5, 1.0
    )
    ripple: bool = _switch('cogging and torque ripple of the motors')
    cogging_torque_n_m: float = _quantity('amplitude of the cogging torque', 0.0, 1e2)
    cogging_periods: int = _quantity('its periods in a revolution', 1, 1000)
    torque_ripple: float = _quantity('ripple of K_m, sixth harmonic of the electrical angle', 0.0, 1.0)
    sensors: bool = _switch('errors of current sensors and encoders')
    sensor_seed: int = _quantity('seed of their noise', 0, 2**31 - 1)
    current_gain_error: tuple[float, float, float] = _quantity('error of measured currents', -0.5, 0.5)
    current_offset_a: tuple[float, float, float] = _quantity(
        'offset of a phase: turns with z_p w', -10.0, 10.0
    )
    current_noise_a: float = _quantity('amplitude of the noise of measured currents', 0.0, 10.0)
    encoder_noise_rad: float = _quantity('amplitude of the noise of encoders, motor side', 0.0, 0.1)
    encoder_error_rad: float = _quantity('amplitude of the error within a sine period, motor side', 0.0, 0.1)
    encoder_periods: int = _quantity('sine periods of an encoder in a revolution', 1, 2**16)
    geometry: bool = _switch('geometric errors of the arms')
    upper_arm_error_m: tuple[float, float, float] = _quantity('error of l_A', -0.02, 0.02)
    forearm_error_m: tuple[float, float, float] = _quantity('error of l_B', -0.02, 0.02)
    radius_error_m: tuple[float, float, float] = _quantity('error of R', -0.02, 0.02)
    arm_azimuth_error_deg: tuple[float, float, float] = _quantity('error of alpha', -5.0, 5.0)
    arm_angle_error_deg: tuple[float, float, float] = _quantity(
        'arm angle beyond the referenced one', -5.0, 5.0
    )

    @property
    def effects(self) -> 'Rich':
        """The effects that are on: their switches, all off without ``enabled``."""
        if self.enabled:
            return self
        switches: dict[str, Any] = {f.name: False for f in dataclasses.fields(self) if f.type is bool}
        return dataclasses.replace(self, **switches)

    @property
    def deviations(self) -> ArmDeviations:
        """How the arms as they are built deviate from the drawing: not at all without ``geometry``."""
        if not self.effects.geometry:
            return ArmDeviations()
        return ArmDeviations(
            self.upper_arm_error_m,
            self.forearm_error_m,
            self.radius_error_m,
            _radians(self.arm_azimuth_error_deg),
            _radians(self.arm_angle_error_deg),
        )


@dataclass(frozen=True)
class Bus:
    """SERCOS timing (2.2.3, 8.1)."""

    cycle_time_s: float = _quantity('CT: 0.001, 0.002 or 0.004', 1e-3, 4e-3)
    exchange_period_s: float = _quantity(
        'T_x between drives and plant: 0.001, 500e-6, 250e-6 or 125e-6', 125e-6, 1e-3
    )
    increments_per_rev: int = _quantity('increments per motor revolution', 1024, 2**24)
    outstanding_cycles_max: int = _quantity('cycles started before their answers are back', 1, 16)


@dataclass(frozen=True)
class Motion:
    """Defaults of moves and the fixed cycles of a run."""

    home_m: tuple[float, float, float] = _quantity('TCP where the plant starts', -8.0, 8.0)
    speed_max_m_s: float = _positive('default TCP speed of a move', 20.0)
    acceleration_max_m_s2: float = _positive('default TCP acceleration of a move', 1e3)
    jerk_max_m_s3: float = _positive('default TCP jerk of a move')
    fault_stop_acceleration_m_s2: float = _positive(
        'TCP deceleration of a stop for an axis that is lost', 1e3
    )
    following_error_delay_cycles: float = _quantity(
        'dead time the following error is freed of (7.3), -1 = from the timing', -1.0, 16.0
    )
    enable_cycle: int = _quantity('bus cycle at which the drives are enabled, -1 on request', -1, 10**9)
    start_cycle: int = _quantity('bus cycle at which a loaded program starts, -1 on request', -1, 10**9)


@dataclass(frozen=True)
class Parameters:
    """All groups of one robot."""

    kinematics: Kinematics
    drive: Drive
    dynamics: Dynamics
    motor: Motor
    rich: Rich
    bus: Bus
    motion: Motion

    def __post_init__(self) -> None:
        """Check the rules that join several values."""
        broken = [sentence for _, sentence in _broken_rules(**vars(self))]
        if broken:
            raise ParameterError('; '.join(broken))

    @property
    def set_point_delay_cycles(self) -> float:
        """Latency of a set point [cycles]: one of the bus, and the fine interpolation up to its last step.

        The cubic interpolation goes through the same points at the same times. Beside them it takes the set point that
        is due in the next cycle, which the drive has got when it begins this one, and so no time.
        """
        return 2.0 - self.drive.position_period_s / self.bus.cycle_time_s

    @property
    def following_error_delay_cycles(self) -> float:
        """Dead time of the following error [cycles]: feedback and set point, unless it was prescribed."""
        prescribed = self.motion.following_error_delay_cycles
        return prescribed if prescribed >= 0.0 else 1.0 + self.set_point_delay_cycles

    @functools.cached_property
    def checksum(self) -> str:
        """Digest of every value: two participants agree exactly if theirs are equal."""
        text = repr(sorted(flatten(self).items()))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def replace(self, **values: Any) -> 'Parameters':
        """Return a copy with values replaced by dotted name, dots written as ``__``."""
        flat = flatten(self)
        for key, value in values.items():
            name = key.replace('__', '.')
            if name not in flat:
                raise ParameterError(f'unknown parameter {name}')
            flat[name] = value
        return from_flat(flat)


_GROUPS: dict[str, Any] = {f.name: f.type for f in dataclasses.fields(Parameters)}


def groups() -> dict[str, Any]:
    """Return the group classes by name, in the order of the file."""
    return dict(_GROUPS)


def _is_multiple(value: float, unit: float) -> bool:
    ratio = value / unit
    return round(ratio) >= 1 and abs(ratio - round(ratio)) < 1e-9


Rules = Iterator[tuple[str, str]]  # the name of a value, and which rule it breaks with others


def _broken_rules(
    kinematics: Kinematics, dynamics: Dynamics, drive: Drive, bus: Bus, rich: Rich, motor: Motor, **_: Any
) -> Rules:
    """Tell which rules that join several values are broken."""
    yield from _broken_timing(bus, drive)
    yield from _broken_geometry(kinematics, dynamics)
    yield from _broken_effects(rich, bus, motor)


def _broken_timing(bus: Bus, drive: Drive) -> Rules:
    if bus.cycle_time_s not in CYCLE_TIMES_S:
        yield (
            'bus.cycle_time_s',
            f'bus.cycle_time_s is {bus.cycle_time_s}, but must be 0.001, 0.002 or 0.004',
        )
    if bus.exchange_period_s not in EXCHANGE_PERIODS_S:
        yield (
            'bus.exchange_period_s',
            f'bus.exchange_period_s is {bus.exchange_period_s}, but must be 125e-6, 250e-6, 500e-6 or 0.001',
        )
    velocity = 'drive.velocity_period_s', drive.velocity_period_s
    position = 'drive.position_period_s', drive.position_period_s
    current = 'drive.current_period_s', drive.current_period_s
    for (name, value), (unit_name, unit) in (
        (velocity, current),
        (position, velocity),
        (('bus.cycle_time_s', bus.cycle_time_s), position),
        (('bus.exchange_period_s', bus.exchange_period_s), velocity),
    ):
        if not _is_multiple(value, unit):
            yield name, f'{name} is {value}, but must be a whole multiple of {unit_name} ({unit})'


def _broken_geometry(kinematics: Kinematics, dynamics: Dynamics) -> Rules:
    k = kinematics
    if k.plate_radius_m > k.base_radius_m:
        yield (
            'kinematics.plate_radius_m',
            f'kinematics.plate_radius_m is {k.plate_radius_m}, '
            f'but must not exceed base_radius_m ({k.base_radius_m})',
        )
    if k.workspace_bottom_m >= k.workspace_top_m:
        yield (
            'kinematics.workspace_bottom_m',
            f'kinematics.workspace_bottom_m is {k.workspace_bottom_m}, '
            f'but must lie below workspace_top_m ({k.workspace_top_m})',
        )
    if len({round(angle % 360.0, 6) for angle in k.arm_azimuth_deg}) < 3:
        yield (
            'kinematics.arm_azimuth_deg',
            f'kinematics.arm_azimuth_deg is {shown(k.arm_azimuth_deg)}, but the arms must differ in direction',
        )
    if dynamics.end_stop_min_deg > k.arm_angle_min_deg:
        yield (
            'dynamics.end_stop_min_deg',
            'dynamics.end_stop_min_deg must not lie above kinematics.arm_angle_min_deg',
        )
    if dynamics.end_stop_max_deg < k.arm_angle_max_deg:
        yield (
            'dynamics.end_stop_max_deg',
            'dynamics.end_stop_max_deg must not lie below kinematics.arm_angle_max_deg',
        )


def _broken_effects(rich: Rich, bus: Bus, motor: Motor) -> Rules:
    # what is switched off must not limit the friction of the nominal robot
    if rich.effects.friction and rich.break_away_torque_n_m < motor.static_friction_n_m:
        yield (
            'rich.break_away_torque_n_m',
            f'rich.break_away_torque_n_m is {rich.break_away_torque_n_m}, '
            f'but must not be less than motor.static_friction_n_m ({motor.static_friction_n_m})',
        )
    if rich.effects.gear and bus.exchange_period_s > ELASTIC_EXCHANGE_S:
        yield (
            'bus.exchange_period_s',
            f'rich.gear needs a bus.exchange_period_s of at most {ELASTIC_EXCHANGE_S}, not {bus.exchange_period_s}',
        )


def flatten(parameters: Parameters) -> dict[str, Any]:
    """Return every value by its dotted name, for example ``motor.peak_current_a``."""
    return {
        f'{group}.{f.name}': getattr(getattr(parameters, group), f.name)
        for group, cls in _GROUPS.items()
        for f in dataclasses.fields(cls)
    }


def flat_document(parameters: Parameters) -> dict[str, Any]:
    """Return every value by its dotted name as JSON has it; ``from_flat`` reads it."""
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in flatten(parameters).items()
    }


def write(parameters: Parameters, path: Path, head: Iterable[str] = ()) -> Path:
    """Write a parameter file that ``load`` and every node read, below comments, ``head``; return its path."""
    document: dict[str, Any] = {group: {} for group in _GROUPS}
    for name, value in flat_document(parameters).items():
        group, _, key = name.partition('.')
        document[group][key] = value
    parameter_file.write(document, path, head)
    return path


def from_flat(values: dict[str, Any], where: str = 'parameters') -> Parameters:
    """Build parameters from dotted names; every name must be there, and no other.

    Raises
    ------
    ParameterError
        A name is unknown or missing, or a value has the wrong type or breaks a rule; names the key and the rule.

    """
    tree: dict[str, Any] = {}
    for name, value in values.items():
        group, dot, key = name.partition('.')
        if not dot:
            raise ParameterError(f'{where}: unknown parameter {name}')
        tree.setdefault(group, {})[key] = value
    return _from_tree(tree, where)


def load(path: str | Path | None = None) -> Parameters:
    """Read a parameter file, the packaged default without a path; a bare name means a packaged file as well.

    The packaged file ``rich`` holds only what differs from the default, as a file for nodes may; any other is complete.

    Raises
    ------
    ParameterError
        The file is not there, is no ROS parameter file, or holds an unknown, missing, mistyped or forbidden value.

    """
    default = config_directory() / DEFAULT_FILE
    path = find(path) if path is not None else default
    tree = parameter_file.read(path)
    if path != default and path.parent.resolve() == default.parent.resolve():
        complete = parameter_file.read(default)
        tree = complete | {group: complete.get(group, {}) | values for group, values in tree.items()}
    return _from_tree(tree, str(path))


def find(path: str | Path) -> Path:
    """Return the parameter file that ``path`` means: itself, else the packaged one of that name."""
    path = Path(path)
    for packaged in config_directory().glob('*.yaml'):
        if str(path) in (packaged.name, packaged.stem) and not path.exists():
            return packaged
    return path


def config_directory() -> Path:
    """Return the folder of packaged configuration files, installed or in the source tree."""
    installed = Path(str(resources.files('delta3_pacdrive'))) / 'config'
    return installed if installed.is_dir() else Path(__file__).parent.parent / 'config'


def is_rich(plant: Any, where: str) -> bool:
    """Whether ``plant``, which may stand in a file for ``rich.enabled``, is the built robot; raises ParameterError."""
    if plant not in PLANTS:
        raise ParameterError(f'{where}: plant is {shown(plant)}, but must be {" or ".join(PLANTS)}')
    return bool(plant == PLANTS[1])


def _from_tree(tree: parameter_file.Tree, where: str) -> Parameters:
    if 'plant' in tree and isinstance(tree.get('rich'), dict):
        tree = tree | {'rich': tree['rich'] | {'enabled': is_rich(tree['plant'], where)}}
        del tree['plant']
    errors = Errors(where)
    with errors.raised_as(ParameterError):
        built = parameter_file.checked_groups(tree, _GROUPS, errors)
        if len(built) == len(_GROUPS):
            for name, sentence in _broken_rules(**built):
                with errors.noted(parameter_file.place_of(tree, name)):
                    refuse(sentence)
    return Parameters(**built)
