"""Rules between parameter values."""

from collections.abc import Iterator
from typing import Any

from delta3_pacdrive.axes import ARMS
from delta3_pacdrive.errors import shown
from delta3_pacdrive.parameters.bus_timing import BAUD_RATES_MBIT_S, bus_timing, cyclic_bytes, too_short
from delta3_pacdrive.parameters.geometry import Kinematics
from delta3_pacdrive.parameters.notch import NUMBERS, notches
from delta3_pacdrive.parameters.records import (
    DECOUPLED,
    MODEL,
    SERCOS_2,
    Bus,
    Control,
    Drive,
    Dynamics,
    Gear,
    Motion,
    Motor,
    Rich,
)
from delta3_pacdrive.parameters.rotary import Rotary, broken_rotary, present_axes, violation
from delta3_pacdrive.parameters.supply import Supply, broken_supply
from delta3_pacdrive.parameters.thermal import Thermal, broken_thermal

CYCLE_TIMES_S = (1.0e-3, 2.0e-3, 4.0e-3)
# older coupling torques make the drives oscillate
EXCHANGE_PERIODS_S = (125.0e-6, 250.0e-6, 500.0e-6, 1.0e-3)
# behind an elastic gear the rotor departs from an observer with the inertia of the whole arm
ELASTIC_EXCHANGE_S = 250.0e-6
# below, a notch filter is as slow as the loops; above, sampling removes its effect
NOTCH_MIN_HZ, NOTCH_SHARE = 10.0, 0.4
SHAPED_MIN_HZ = 1.0  # a lower frequency would prolong a shaped move by seconds

Rules = Iterator[tuple[str, str]]  # name of a value, and the rule that it violates


def _is_multiple(value: float, unit: float) -> bool:
    ratio = value / unit
    return round(ratio) >= 1 and abs(ratio - round(ratio)) < 1e-9


def broken_rules(
    kinematics: Kinematics,
    dynamics: Dynamics,
    drive: Drive,
    bus: Bus,
    rich: Rich,
    motor: Motor,
    gear: Gear,
    control: Control,
    rotary: Rotary,
    rotary_2: Rotary,
    motion: Motion,
    supply: Supply,
    thermal: Thermal,
    **_: Any,
) -> Rules:
    """Yield violated rules between values."""
    yield from _broken_timing(bus, drive)
    axes = ARMS + len(present_axes(rotary, rotary_2))
    yield from _broken_telegrams(bus, axes, control.feed_forward == MODEL)
    yield from _broken_notches(drive)
    yield from _broken_geometry(kinematics, dynamics)
    yield from _broken_effects(rich, bus, motor)
    yield from _broken_decoupling(dynamics, rich)
    yield from _broken_gear(gear)
    yield from _broken_shaping(control)
    yield from _broken_speeds(motion)
    yield from broken_rotary(rotary, rotary_2)
    yield from broken_supply(supply, drive.dc_link_voltage_v)
    yield from broken_thermal(thermal)


def _broken_timing(bus: Bus, drive: Drive) -> Rules:
    if bus.cycle_time_s not in CYCLE_TIMES_S:
        yield violation('bus.cycle_time_s', bus.cycle_time_s, 'must be 0.001, 0.002 or 0.004')
    if bus.exchange_period_s not in EXCHANGE_PERIODS_S:
        yield violation(
            'bus.exchange_period_s', bus.exchange_period_s, 'must be 125e-6, 250e-6, 500e-6 or 0.001'
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


def _broken_telegrams(bus: Bus, axes: int, sends_torque: bool) -> Rules:
    if bus.baud_rate_mbit_s not in BAUD_RATES_MBIT_S:
        yield violation('bus.baud_rate_mbit_s', bus.baud_rate_mbit_s, 'must be 2, 4, 8 or 16')
    elif bus.timing == SERCOS_2:
        at_bytes, record_bytes = cyclic_bytes(sends_torque)
        sentence = too_short(bus, bus_timing(bus, [at_bytes] * axes, [record_bytes] * axes))
        if sentence:
            yield 'bus.cycle_time_s', sentence


def _broken_notches(drive: Drive) -> Rules:
    high = NOTCH_SHARE / drive.velocity_period_s
    for number, notch in zip(NUMBERS, notches(drive), strict=True):
        name, frequency = f'drive.notch_{number}_frequency_hz', notch.frequency_hz
        if frequency != 0.0 and not NOTCH_MIN_HZ <= frequency <= high:
            yield (
                name,
                f'{name} is {frequency:g} Hz, but must be 0 (off) or between {NOTCH_MIN_HZ:g} Hz and {high:g} Hz, '
                f'{NOTCH_SHARE:g} of the rate of the velocity loop',
            )


def _broken_geometry(kinematics: Kinematics, dynamics: Dynamics) -> Rules:
    k = kinematics
    if k.plate_radius_m > k.base_radius_m:
        yield violation(
            'kinematics.plate_radius_m',
            k.plate_radius_m,
            f'must not exceed base_radius_m ({k.base_radius_m})',
        )
    if k.workspace_bottom_m >= k.workspace_top_m:
        yield violation(
            'kinematics.workspace_bottom_m',
            k.workspace_bottom_m,
            f'must lie below workspace_top_m ({k.workspace_top_m})',
        )
    if len({round(angle % 360.0, 6) for angle in k.arm_azimuth_deg}) < 3:
        yield violation(
            'kinematics.arm_azimuth_deg', shown(k.arm_azimuth_deg), 'the arms must differ in direction'
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
    # effects that are off must not limit the friction of the nominal robot
    if rich.effects.friction and rich.break_away_torque_n_m < motor.static_friction_n_m:
        yield violation(
            'rich.break_away_torque_n_m',
            rich.break_away_torque_n_m,
            f'must not be less than motor.static_friction_n_m ({motor.static_friction_n_m})',
        )
    if rich.effects.gear and bus.exchange_period_s > ELASTIC_EXCHANGE_S:
        yield (
            'bus.exchange_period_s',
            f'rich.gear needs a bus.exchange_period_s of at most {ELASTIC_EXCHANGE_S}, not {bus.exchange_period_s}',
        )


def _broken_shaping(control: Control) -> Rules:
    frequency = control.shaping_frequency_hz
    if 0.0 < frequency < SHAPED_MIN_HZ:
        yield violation(
            'control.shaping_frequency_hz', frequency, f'must be 0 (computed) or at least {SHAPED_MIN_HZ}'
        )


def _broken_gear(gear: Gear) -> Rules:
    for name, other in (
        ('acceleration_torque_n_m', 'nominal_torque_n_m'),
        ('emergency_torque_n_m', 'acceleration_torque_n_m'),
        ('input_speed_max_rpm', 'nominal_input_speed_rpm'),
    ):
        value, least = getattr(gear, name), getattr(gear, other)
        if value < least:
            yield violation(f'gear.{name}', value, f'must not be less than gear.{other} ({least})')


def _broken_speeds(motion: Motion) -> Rules:
    if motion.speed_max_m_s > motion.tcp_speed_limit_m_s:
        yield violation(
            'motion.speed_max_m_s',
            motion.speed_max_m_s,
            f'must not exceed motion.tcp_speed_limit_m_s ({motion.tcp_speed_limit_m_s})',
        )


def _broken_decoupling(dynamics: Dynamics, rich: Rich) -> Rules:
    if dynamics.arm_coupling != DECOUPLED:
        return
    for name in ('gear', 'friction', 'ripple'):
        if getattr(rich.effects, name):
            yield violation(
                'dynamics.arm_coupling', DECOUPLED, f'a robot with rich.{name} has no linear decoupled part'
            )
