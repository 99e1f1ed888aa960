"""Quantities in recordings and tables of measurements, with names, meanings and units.

A column is named after its signal, with ``_1 _2 _3`` for the axes or ``_x _y _z`` for the TCP, followed by the unit in
brackets. The names of Table 10-1 of the thesis are accepted too: ``Actual Arm Angle position 1 [deg]``.
"""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from delta3_pacdrive.recording.signals import (
    CURRENT_SIGNALS,
    DERIVED_SIGNALS,
    OF_DRIVES,
    REQUESTED_SIGNALS,
    ROTARY_SIGNALS,
    SIGNALS,
    SUPPLY_SIGNALS,
    THERMAL_SIGNALS,
    TORQUE_SIGNALS,
    TRUE_SIGNALS,
    columns_of,
)

# additional signals of oscilloscopes and external measurements
MEASURED = {
    'phase_voltage': ('V', 'voltage of a phase [rms], applied from this instant to the next'),
    'phase_current': ('A', 'I1s, I2s, I3s of a single motor'),
    'position_reference': ('rad', 'interpolated set point of the position loop'),
    'speed_reference': ('rad/s', 'set point of the velocity loop'),
    'current_reference': ('A', 'set point of the current loop, before its filter'),
    'position_added': ('rad', 'excitation in the position set point'),
    'current_added': ('A', 'excitation in the current set point'),
    'tcp_measured': ('m', 'TCP by an external measurement, for example a laser tracker, in the frame base'),
}
# arm-side signals of the trace function of a controller (Table 10-1)
OF_ARMS = {
    'arm_position': ('rad', 'arm angle by the encoder'),
    'arm_speed': ('rad/s', 'arm speed by the encoder'),
    'arm_acceleration': ('rad/s2', 'actual arm acceleration'),
    'arm_position_reference': ('rad', 'arm angle that was commanded'),
    'arm_speed_reference': ('rad/s', 'arm speed that was commanded'),
    'arm_acceleration_reference': ('rad/s2', 'arm acceleration that was commanded'),
    'tcp_error_norm': ('m', 'norm of the TCP error'),
}
OF_RUNS = SIGNALS | TORQUE_SIGNALS | CURRENT_SIGNALS | TRUE_SIGNALS | SUPPLY_SIGNALS | ROTARY_SIGNALS
OF_RUNS |= THERMAL_SIGNALS | DERIVED_SIGNALS
QUANTITIES = OF_RUNS | MEASURED | OF_ARMS | REQUESTED_SIGNALS

ONE = '1'  # unit of dimensionless values
# unit in a file: (SI unit, factor)
UNITS = {
    's': ('s', 1.0),
    'ms': ('s', 1e-3),
    'us': ('s', 1e-6),
    'ns': ('s', 1e-9),
    'rad': ('rad', 1.0),
    'deg': ('rad', math.pi / 180.0),
    'rev': ('rad', math.tau),
    'rad/s': ('rad/s', 1.0),
    'deg/s': ('rad/s', math.pi / 180.0),
    'rpm': ('rad/s', math.tau / 60.0),
    'rad/s2': ('rad/s2', 1.0),
    'deg/s2': ('rad/s2', math.pi / 180.0),
    'A': ('A', 1.0),
    'mA': ('A', 1e-3),
    'm': ('m', 1.0),
    'mm': ('m', 1e-3),
    'V': ('V', 1.0),
    'N m': ('N m', 1.0),
    'm/s': ('m/s', 1.0),
    'mm/s': ('m/s', 1e-3),
    'm/s2': ('m/s2', 1.0),
    'mm/s2': ('m/s2', 1e-3),
    'kg': ('kg', 1.0),
    'increments': ('increments', 1.0),
    'bits': ('bits', 1.0),
    'Pa': ('Pa', 1.0),
    'N': ('N', 1.0),
    'W': ('W', 1.0),
}
# alternative spellings
SPELLINGS = {
    'sec': 's', 'µs': 'us', 'μs': 'us', '°': 'deg', '°/s': 'deg/s', 'U/min': 'rpm', '1/min': 'rpm', 'Nm': 'N m',
    **{f'{unit}/s{square}': f'{own}/s2'
       for unit, own in (('rad', 'rad'), ('deg', 'deg'), ('°', 'deg'), ('m', 'm'), ('mm', 'mm'))
       for square in ('^2', '²', '2')},
}  # fmt: skip
# names of Table 10-1, and of the references of chapter 10, in the form of ``plain``
NAMES_OF_THE_THESIS = {
    'actual_arm_angle_position': 'arm_position',
    'actual_arm_angle_velocity': 'arm_speed',
    'actual_arm_angle_acceleration': 'arm_acceleration',
    'reference_arm_angle_position': 'arm_position_reference',
    'reference_arm_angle_velocity': 'arm_speed_reference',
    'reference_arm_angle_acceleration': 'arm_acceleration_reference',
    'current_i_eff_into_the_motors': 'current',
    'current_i_eff': 'current',
    'i_eff': 'current',
    'actual_tcp_position': 'tcp_actual',
    'reference_tcp_position': 'tcp_command',
    'norm_of_tcp_error': 'tcp_error_norm',
    'norm_of_the_tcp_error': 'tcp_error_norm',
}
TIME = 'time'


class Column(NamedTuple):
    """Column of a signal in an SI unit; number 0 for the time."""

    signal: str
    number: int
    unit: str


def of_drives() -> dict[str, tuple[str, str]]:
    """Return the signals of drive channels, sampled once per bus cycle, with unit and meaning."""
    from delta3_pacdrive.robot.drive.channels import CHANNELS  # imports the compiler

    return {OF_DRIVES + name: (row.unit, row.what) for name, row in CHANNELS.items()}


def unit_of(name: str) -> str | None:
    """Return the unit of a signal, None if it does not exist."""
    known = of_drives() if name.startswith(OF_DRIVES) else QUANTITIES
    return known[name][0] if name in known else None


def meaning_of(name: str) -> str:
    """Return the meaning of a signal."""
    return (of_drives() if name.startswith(OF_DRIVES) else QUANTITIES)[name][1]


def named_columns(name: str) -> list[tuple[str, str]]:
    """Return name and unit of each column of a signal."""
    suffixed = columns_of(name, unit_of(name) or ONE)
    return [('_'.join(filter(None, (name, suffix))), unit) for suffix, unit in suffixed]


def columns(with_drives: bool = False) -> dict[str, Column]:
    """Return all possible columns by plain name."""
    found = {TIME: Column(TIME, 0, 's')}
    for name, (units, _) in (QUANTITIES | (of_drives() if with_drives else {})).items():
        for number, (suffix, unit) in enumerate(columns_of(name, units)):
            found['_'.join(filter(None, (name, suffix)))] = Column(name, number, unit)
    for alias, name in NAMES_OF_THE_THESIS.items():
        for own in [key for key, column in found.items() if column.signal == name]:
            found[alias + own.removeprefix(name)] = found[own]
    return found


def width(signal: str) -> int:
    """Return the number of columns of a signal."""
    return 1 if signal == TIME else len(columns_of(signal, ''))


def plain(label: str) -> str:
    """Return a name in lower case with words separated by underscores."""
    return re.sub(r'[^0-9a-z]+', '_', label.strip().lower()).strip('_')


def unit_named(text: str) -> str:
    """Return the spelling of a unit in ``UNITS``, or the text itself if it is unknown."""
    text = ' '.join(text.split())
    return SPELLINGS.get(text, text)


def split_heading(heading: str) -> tuple[str, str | None]:
    """Return name and unit of a heading ``name [unit]``; None without a unit."""
    label, bracket, rest = heading.partition('[')
    return label.strip(), unit_named(rest.strip().removesuffix(']')) if bracket else None


def possible_units(unit: str) -> str:
    """Return the allowed units of a quantity as text."""
    return ', '.join(f'[{text}]' for text, (si, _) in UNITS.items() if si == unit)
