"""P2 to P4 (Table 9-1), additional effects of a built robot, bus and motion."""

import dataclasses
import functools
import math
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.configuration.fields import choice, positive, quantity, switch
from delta3_pacdrive.parameters.geometry import ArmDeviations, radians

LINEAR, CUBIC = INTERPOLATIONS = ('linear', 'cubic')
EXACT, DECOUPLED = ARM_COUPLINGS = ('exact', 'decoupled')
# the first is not `off`, which readers of YAML take for a boolean
INERTIA, MODEL = FEED_FORWARDS = ('inertia', 'model')
# when a set point takes effect
THESIS, SERCOS_2 = TIMINGS = ('thesis', 'sercos2')
UNSHAPED, ZV, ZVD, SMOOTH, MODES = SHAPINGS = ('none', 'zv', 'zvd', 'smooth', 'modes')
# Half of the capacity at the weakest point of the workspace: 21.0 kg by the holding brakes, 22.6 kg by the
# nominal currents. The other half is for acceleration and for the loops, which are tuned to the rated 2 kg.
PAYLOAD_MAX_KG = 10.0
RATED_PAYLOAD_KG = 2.0


@dataclass(frozen=True)
class Drive:
    """P2: the MC-4's cascade, feed-forwards, filters and supervision."""

    position_period_s: float = positive('T_pos, period of position loop and fine interpolation', 1e-3)
    velocity_period_s: float = positive('T_vel, period of the velocity loop', 1e-3)
    current_period_s: float = positive('T_cur, period of the current loop', 1e-3)
    position_gain_rad_s_rad: float = quantity('K_Ppos', 0.0, 1666.0)
    velocity_gain_a_s_rad: float = quantity('K_Pvel', 0.0, 100.0)
    velocity_integral_gain_a_rad: float = quantity('K_Ivel', 0.0, 1e5)
    current_gain_v_a: float = quantity('K_Pcurr, per phase', 0.0, 1e3)
    current_integral_gain_v_a_s: float = quantity('K_Icurr, per phase', 0.0, 1e7)
    velocity_feedforward: float = quantity('FF_vel', 0.0, 2.0)
    current_feedforward: float = quantity('FF_curr', 0.0, 2.0)
    feedforward_inertia_kg_m2: float = quantity('inertia of the current feed-forward, motor side', 0.0, 1.0)
    observer_arm_inertia_kg_m2: float = positive('A_bar of the shaft observer, arm side', 1e3)
    velocity_filter_s: float = quantity('F_vel, low-pass of the actual velocity', 0.0, 0.1)
    current_reference_filter_s: float = quantity('F_currRef, low-pass of the current reference', 0.0, 0.1)
    current_filter_s: float = quantity('F_curr, low-pass of the actual current', 0.0, 0.1)
    commutation_offset_rad: float = quantity('CO, electrical', -math.pi, math.pi)
    dc_link_voltage_v: float = positive('V_dc', 1e3)
    following_error_limit_rad: float = positive(
        'following error of warning 8132, motor side; eight times as much trips the drive (8111)', 1e3
    )
    velocity_limit_rad_s: float = positive("limit of the speed reference, besides the motor's maximum", 1e4)
    torque_limit_n_m: float = positive("limit of K_m times the current reference, besides i_peak's", 1e4)
    overspeed_factor: float = quantity("speed that trips the drive over the motor's maximum", 1.0, 2.0)
    overload_time_s: float = positive('integral of (I/i_nom)^2 - 1 that trips the drive', 1e3)
    enable_settle_s: float = quantity('time the current loop holds before the brake is released', 0.0, 1.0)
    stop_deceleration_rad_s2: float = positive('ramp of reaction BD2, motor side', 1e6)
    stop_time_max_s: float = positive('longest controlled stop before the brake is applied', 10.0)
    interpolation: str = choice('fine interpolation of set points within a bus cycle', INTERPOLATIONS)
    notch_1_frequency_hz: float = quantity(
        'centre of notch filter 1 of the current reference; 0: off', 0.0, 4e3, default=0.0
    )
    notch_1_damping: float = quantity(
        'D of notch filter 1, which determines its width', 0.01, 2.0, default=0.5
    )
    notch_1_depth: float = quantity(
        'fraction of the amplitude that passes at the centre of notch filter 1', 1e-3, 1.0, default=0.1
    )
    notch_2_frequency_hz: float = quantity(
        'centre of notch filter 2, after filter 1; 0: off', 0.0, 4e3, default=0.0
    )
    notch_2_damping: float = quantity('D of notch filter 2', 0.01, 2.0, default=0.5)
    notch_2_depth: float = quantity(
        'fraction of the amplitude that passes at the centre of notch filter 2', 1e-3, 1.0, default=0.1
    )
    position_window_rad: float = quantity(
        'position window (S-0-0057), motor side: largest following error of a drive in position',
        1e-6,
        1e3,
        default=0.01,
    )
    disturbance_bandwidth_hz: float = quantity(
        'bandwidth of the disturbance observer (P-0-0023); 0: off', 0.0, 500.0, default=0.0
    )
    disturbance_inertia_kg_m2: float = quantity(
        'nominal inertia of the disturbance observer, motor side (P-0-0024); 0: that of the current feed-forward',
        0.0,
        1.0,
        default=0.0,
    )
    excitation_rms_a: float = quantity(
        'effective value of the excitation of a running drive (P-0-0091)', 1e-3, 2.0, default=0.1
    )
    excitation_time_s: float = quantity(
        'duration of the excitation of a running drive (P-0-0092)', 0.25, 60.0, default=3.0
    )


@dataclass(frozen=True)
class Control:
    """Commands of the transformation task beyond the set points of the thesis."""

    feed_forward: str = choice(
        'torque feed-forward: one constant inertia per axis in the drives, or that of the whole model',
        FEED_FORWARDS,
    )
    gear_stiffness_n_m_rad: float = quantity(
        'torsional gear stiffness compensated by the set points, arm side; 0: rigid',
        0.0,
        1e7,
        default=0.0,
    )
    gear_backlash_rad: float = quantity(
        'gear backlash compensated by the set points, arm side',
        0.0,
        0.1,
        default=0.0,
    )
    shaping: str = choice('input shaping of moves, against vibration after a stop', SHAPINGS)
    shaping_frequency_hz: float = quantity(
        'vibration suppressed by shaped moves; 0: computed for the end of each move',
        0.0,
        500.0,
        default=0.0,
    )
    shaping_damping: float = quantity(
        'damping ratio of the vibration, with its frequency', 0.0, 0.9, default=0.35
    )


@dataclass(frozen=True)
class Dynamics:
    """P3: masses, gear and end stops."""

    upper_arm_mass_kg: float = quantity('m_b', 0.0, 1e3)
    elbow_mass_kg: float = quantity('m_c', 0.0, 1e3)
    forearm_mass_kg: float = quantity('m_fb, both rods of one arm', 0.0, 1e3)
    plate_mass_kg: float = positive('m_n', 1e3)
    payload_mass_kg: float = quantity('m_payload', 0.0, PAYLOAD_MAX_KG)
    forearm_share_at_elbow: float = quantity('r, share of the forearm mass at the elbow (4.8)', 0.0, 1.0)
    gravity_m_s2: float = quantity('g', 0.0, 30.0)
    gear_in: float = positive('GR_in', 1e4)
    gear_out: float = positive('GR_out', 1e4)
    end_stop_min_deg: float = quantity('arm angle of the upper end stop', -90.0, 0.0)
    end_stop_max_deg: float = quantity('arm angle of the lower end stop', 0.0, 170.0)
    end_stop_stiffness_n_m_rad: float = quantity('stiffness of the end stops', 0.0, 1e6)
    end_stop_damping_n_m_s_rad: float = quantity('damping of the end stops', 0.0, 1e4)
    arm_coupling: str = choice(
        'arm coupling of the plant: by the equation of motion, or as three linear ones with d as an input (4.9)',
        ARM_COUPLINGS,
    )

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
class Gear:
    """Limits of a planetary gear between motor and arm, as in a maker's catalogue; torques at its output."""

    limit_moves: bool = quantity(
        'whether moves respect the acceleration torque and the largest input speed of the gears',
        False,
        True,
        default=False,
    )
    nominal_torque_n_m: float = positive(
        'T_2N, equivalent torque with which a gear reaches its nominal life', 1e5, default=100.0
    )
    acceleration_torque_n_m: float = positive('T_2B, largest torque during a move', 1e5, default=160.0)
    emergency_torque_n_m: float = positive(
        'T_2Not, largest torque during an emergency stop, permitted 1000 times', 1e5, default=250.0
    )
    nominal_input_speed_rpm: float = positive(
        'n_1N, mean input speed with which a gear reaches its nominal life', 1e5, default=3000.0
    )
    input_speed_max_rpm: float = positive('n_1max, largest input speed', 1e5, default=6000.0)
    nominal_life_h: float = positive('L_hN, life at nominal torque and nominal speed', 1e6, default=20e3)
    life_exponent: float = quantity('p of the life, T^-p', 1.0, 20.0, default=10.0 / 3.0)


@dataclass(frozen=True)
class Joints:
    """Limits of rods, ball joints and plate."""

    limit_moves: bool = quantity(
        'whether moves respect the limits of rods, ball joints and plate', False, True, default=False
    )
    spring_force_n: float = positive(
        'force of a spring that holds the two rods of a forearm on their balls', 1e5, default=200.0
    )
    socket_angle_deg: float = quantity(
        'angle from the axis of a ball up to which its socket encloses it', 1.0, 89.0, default=60.0
    )
    rod_force_max_n: float = positive('largest axial force of a rod', 1e6, default=400.0)
    plate_moment_max_n_m: float = positive(
        'largest tilting moment of tool and payload on the plate', 1e4, default=20.0
    )


@dataclass(frozen=True)
class Motor:
    """P4: motor, winding, friction and holding brake; currents A rms, R and L phase to phase."""

    peak_current_a: float = positive('i_peak', 1e3)
    nominal_current_a: float = positive('i_nom', 1e3)
    max_speed_rpm: float = positive('RPM_max', 1e5)
    torque_constant_n_m_a: float = positive('K_m', 1e2)
    rotor_inertia_kg_m2: float = positive('I_m', 1.0)
    brake_inertia_kg_m2: float = quantity('I_brake', 0.0, 1.0)
    winding_resistance_ohm: float = positive('R, phase to phase', 1e3)
    winding_inductance_h: float = positive('L, phase to phase', 10.0)
    pole_pairs: int = quantity('z_p', 1, 100)
    viscous_friction_n_m_s_rad: float = quantity('F_v', 0.0, 1.0)
    static_friction_n_m: float = quantity('F_s', 0.0, 1e2)
    friction_smoothing_rad_s: float = quantity('w_s of F_s tanh(w/w_s)', 0.05, 1e2)
    brake_torque_n_m: float = quantity('torque of the holding brake', 0.0, 1e3)
    brake_release_s: float = quantity('time from command to released brake', 0.0, 1.0)
    brake_apply_s: float = quantity('time from command to applied brake', 0.0, 1.0)
    load_inertia_kg_m2: float = quantity(
        'I_Load after the gear of a single motor (simulate --one-motor)', 0.0, 1e3, default=0.86
    )
    load_torque_n_m: float = quantity(
        'tau_load after its gear, opposing forward rotation', -1e4, 1e4, default=0.0
    )
    coupling_effect: float = quantity(
        'CE, fraction of the coupling torque d of the robot that acts on it', 0.0, 1.0, default=0.0
    )

    @property
    def max_speed_rad_s(self) -> float:
        """Largest shaft speed [rad/s]."""
        return self.max_speed_rpm * math.tau / 60.0


@dataclass(frozen=True)
class Rich:
    """Effects of a built robot beyond the thesis, in the plant and in the drives' sensors."""

    enabled: bool = switch('whether the effects below are on; otherwise the plant is that of the thesis')
    forearm_rods: bool = switch('forearms as uniform rods instead of split masses')
    gear: bool = switch('elastic gears with backlash; needs an exchange period of at most 250e-6')
    gear_stiffness_n_m_rad: float = quantity('torsional stiffness of a gear, arm side', 1e2, 1e7)
    gear_damping_n_m_s_rad: float = quantity('torsional damping of a gear, arm side', 0.0, 1e4)
    gear_backlash_rad: float = quantity('gear backlash, arm side', 0.0, 0.1)
    friction: bool = switch(
        'Coulomb friction F_s with stiction and Stribeck effect instead of F_s tanh(w/w_s)'
    )
    break_away_torque_n_m: float = positive('torque that sets a shaft at rest in motion', 1e2)
    stribeck_speed_rad_s: float = quantity('speed w_st of the fall from break-away to F_s', 1e-2, 1e3)
    presliding_rad: float = quantity(
        'deflection of the bristles under the break-away torque, motor side', 1e-5, 1.0
    )
    ripple: bool = switch('cogging and torque ripple of the motors')
    cogging_torque_n_m: float = quantity('amplitude of the cogging torque', 0.0, 1e2)
    cogging_periods: int = quantity('periods of the cogging torque per revolution', 1, 1000)
    torque_ripple: float = quantity('ripple of K_m, sixth harmonic of the electrical angle', 0.0, 1.0)
    sensors: bool = switch('errors of current sensors and encoders')
    sensor_seed: int = quantity('seed of the sensor noise', 0, 2**31 - 1)
    current_gain_error: tuple[float, float, float] = quantity('error of measured currents', -0.5, 0.5)
    current_offset_a: tuple[float, float, float] = quantity(
        'offset of a phase: rotates with z_p w', -10.0, 10.0
    )
    current_noise_a: float = quantity('amplitude of the noise of measured currents', 0.0, 10.0)
    encoder_noise_rad: float = quantity('amplitude of the noise of encoders, motor side', 0.0, 0.1)
    encoder_error_rad: float = quantity('amplitude of the error within a sine period, motor side', 0.0, 0.1)
    encoder_periods: int = quantity('sine periods of an encoder in a revolution', 1, 2**16)
    geometry: bool = switch('geometric errors of the arms')
    upper_arm_error_m: tuple[float, float, float] = quantity('error of l_A', -0.02, 0.02)
    forearm_error_m: tuple[float, float, float] = quantity('error of l_B', -0.02, 0.02)
    radius_error_m: tuple[float, float, float] = quantity('error of R', -0.02, 0.02)
    arm_azimuth_error_deg: tuple[float, float, float] = quantity('error of alpha', -5.0, 5.0)
    arm_angle_error_deg: tuple[float, float, float] = quantity(
        'true arm angle less the referenced one', -5.0, 5.0
    )

    parallelogram: bool = quantity(
        'plate on six rods, which may tilt, instead of a point (12)', False, True, default=False
    )
    rod_spacing_m: float = quantity('distance of the two rods of a forearm', 1e-3, 1.0, default=0.08)
    rod_difference_m: tuple[float, float, float] = quantity(
        'length of the left rod of a forearm less that of the right one',
        -0.02,
        0.02,
        default=(1e-4, -0.6e-4, 0.8e-4),
    )
    plate_joint_height_m: tuple[float, float, float] = quantity(
        'height of the joints at the plate above its plane', -0.02, 0.02, default=(0.5e-4, -1e-4, 0.3e-4)
    )
    tool_length_m: float = quantity(
        'distance of the TCP below the joints of the plate', 0.0, 1.0, default=0.1
    )

    frame: bool = quantity(
        'machine frame that oscillates horizontally, on which the base stands', False, True, default=False
    )
    frame_mass_kg: float = quantity('mass of frame and robot', 10.0, 1e5, default=400.0)
    frame_frequency_hz: float = quantity('natural frequency of the frame', 1.0, 500.0, default=20.0)
    frame_damping: float = quantity('damping ratio of the frame', 0.0, 1.0, default=0.03)
    elastic_rods: bool = quantity('rods that stretch under their force', False, True, default=False)
    rod_stiffness_n_m: float = quantity(
        'axial stiffness of a rod with its ball joints', 1e4, 1e9, default=4e6
    )

    @property
    def effects(self) -> 'Rich':
        """Effects that are on; all are off without ``enabled``."""
        return self if self.enabled else self._without_effects

    @functools.cached_property
    def _without_effects(self) -> 'Rich':
        switches: dict[str, Any] = {f.name: False for f in dataclasses.fields(self) if f.type is bool}
        return dataclasses.replace(self, **switches)

    @property
    def deviations(self) -> ArmDeviations:
        """Deviations of the built arms from the drawing; zero without ``geometry``."""
        if not self.effects.geometry:
            return ArmDeviations()
        return ArmDeviations(
            self.upper_arm_error_m,
            self.forearm_error_m,
            self.radius_error_m,
            radians(self.arm_azimuth_error_deg),
            radians(self.arm_angle_error_deg),
        )


@dataclass(frozen=True)
class Bus:
    """SERCOS timing (2.2.3, 8.1), and the ring of ``sercos2`` (IEC 61491)."""

    cycle_time_s: float = quantity('CT: 0.001, 0.002 or 0.004', 1e-3, 4e-3)
    exchange_period_s: float = quantity(
        'T_x between drives and plant: 0.001, 500e-6, 250e-6 or 125e-6', 125e-6, 1e-3
    )
    increments_per_rev: int = quantity('increments per motor revolution', 1024, 2**24)
    outstanding_cycles_max: int = quantity('largest number of cycles without their ATs', 1, 16)
    timing: str = choice('when a set point takes effect: one bus cycle after its MDT, or two', TIMINGS)
    baud_rate_mbit_s: int = quantity('baud rate of the ring: 2, 4, 8 or 16', 2, 16, default=16)
    fibre_length_m: float = quantity('length of all fibres of the ring', 0.0, 2e3, default=10.0)
    slave_delay_s: float = quantity('delay of a telegram in a drive', 0.0, 1e-4, default=1e-6)
    jitter_s: float = quantity('largest jitter of a telegram', 0.0, 1e-5, default=1e-6)


@dataclass(frozen=True)
class Motion:
    """Defaults of moves, and fixed bus cycles of a run."""

    home_m: tuple[float, float, float] = quantity('initial TCP of the plant', -8.0, 8.0)
    speed_max_m_s: float = positive('default TCP speed of a move', 20.0)
    acceleration_max_m_s2: float = positive('default TCP acceleration of a move', 1e3)
    jerk_max_m_s3: float = positive('default TCP jerk of a move')
    fault_stop_acceleration_m_s2: float = positive(
        'TCP deceleration of a stop after the loss of an axis', 1e3
    )
    following_error_delay_cycles: float = quantity(
        'dead time removed from the following error (7.3), -1 = from the timing', -1.0, 16.0
    )
    enable_cycle: int = quantity('bus cycle at which the drives are enabled, -1 on request', -1, 10**9)
    start_cycle: int = quantity('bus cycle at which a loaded program starts, -1 on request', -1, 10**9)
    in_position_time_s: float = quantity(
        'time that every drive must be within its position window to be in position', 0.0, 10.0, default=0.01
    )
    in_position_timeout_s: float = quantity(
        'longest time from the end of a program, or an exact stop, until the robot is in position',
        0.0,
        60.0,
        default=0.5,
    )
    tcp_speed_limit_m_s: float = positive(
        'limit of the TCP speed: moves, overrides and belts together', 20.0, default=15.0
    )
