"""Oscilloscope channels of a drive as one table, by name; every IDN with a numeric value is a channel, too.

A sample is the state after a period of the current loop (62.5 us). Its time is the end of that period: the last sample
of bus cycle k-1 has the time and the current of AT(k).

speed loop, current loop
    ``robot/drive/cascade.py``. Values stay until the next period of the loop: 250 us (position) or 125 us (speed).
shaft between exchanges
    ``robot/drive/shaft_observer.py``. It is reset to the plant's shaft at every exchange.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from delta3_pacdrive.configuration.strict_reader import nearest_of
from delta3_pacdrive.errors import ParameterError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.drive.operation_data import ONE, PHASE, TABLE, OperationData
from delta3_pacdrive.robot.motor import phase_columns
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES
from delta3_pacdrive.robot.sercos.service_channel import format_idn, parse_idn

SCOPE_CHANNELS_MAX = 8  # of one oscilloscope
_IDN = re.compile('[SP]-[0-9]-[0-9]{4}', re.IGNORECASE)

Formula = Callable[..., Floats]  # of parameters, drive constants, and one column per source


def _is(_: Parameters, __: Any, value: Floats) -> Floats:
    return value


def _torque(_: Parameters, constants: Any, current: Floats) -> Floats:
    return np.asarray(constants['torque_constant'] * current)


def _angle(_: Parameters, constants: Any, increments: Floats) -> Floats:
    return np.asarray(increments / constants['increments_per_rad'])


def _of_phase(number: int) -> Formula:
    """Return the formula of an instantaneous phase value, 1 to 3; voltage and current have the same angle."""

    def value(_: Parameters, constants: Any, effective: Floats, position: Floats) -> Floats:
        phases = np.empty((len(effective), 3))
        phase_columns(effective, position, constants['motor'], phases)
        return phases[:, number - 1]

    return value


@dataclass(frozen=True)
class Channel:
    """One row of the table.

    Attributes
    ----------
    formula
        Computes the value from parameters, the drive's ``CONSTANTS`` and the sources, each a column of samples.

    """

    name: str
    unit: str
    what: str
    sources: tuple[str, ...]  # fields of the drive's ``STATE`` record
    formula: Formula = _is


# fmt: off
_ROWS = (
    Channel('position_command', 'rad', 'set point that is valid in this bus cycle', ('command',)),
    Channel('torque_command', 'N m', 'additive torque command that is valid in this bus cycle', ('torque',)),
    Channel('position_reference', 'rad', 'set point of the position loop, interpolated every 250 us', ('reference',)),
    Channel('following_error', 'rad', 'monitored following error, once per bus cycle', ('following_error',)),
    Channel('speed_reference', 'rad/s', 'output of the position loop, with feed-forward', ('speed_reference',)),
    Channel('speed_filtered', 'rad/s', 'filtered actual speed in the speed loop', ('speed_filtered',)),
    Channel('speed_integral', 'A', 'integrator of the speed loop', ('velocity_integral',)),
    Channel('disturbance_torque', 'N m', 'estimate of the disturbance observer, motor side', ('disturbance',)),
    Channel('current_added', 'A', 'added by the generator', ('current_added',)),
    Channel('current_asked', 'A', 'I_eff requested by the speed loop, with feed-forward', ('current_asked',)),
    Channel('current_reference', 'A', 'the same after the notch filters, limited',
            ('current_reference',)),
    Channel('current_reference_filtered', 'A', 'the same after its filter, in the current loop',
            ('current_reference_filtered',)),
    Channel('current', 'A', 'measured I_eff of the power stage', ('current',)),
    Channel('current_filtered', 'A', 'the same after its filter, in the current loop', ('current_filtered',)),
    Channel('motor_current', 'A', "true I_eff in the motor's winding", ('motor_current',)),
    Channel('current_integral', 'V', 'integrator of the current loop', ('current_integral',)),
    Channel('voltage', 'V', 'voltage command of a phase, effective value; applied in the next period', ('voltage',)),
    Channel('phase_voltage_1', 'V', 'voltage command of phase 1, instantaneous', ('voltage', 'position'),
            _of_phase(1)),
    Channel('phase_voltage_2', 'V', 'of phase 2', ('voltage', 'position'), _of_phase(2)),
    Channel('phase_voltage_3', 'V', 'of phase 3', ('voltage', 'position'), _of_phase(3)),
    Channel('phase_current_1', 'A', 'I1s, instantaneous (Fig. 8.3)', ('current', 'position'), _of_phase(1)),
    Channel('phase_current_2', 'A', 'I2s', ('current', 'position'), _of_phase(2)),
    Channel('phase_current_3', 'A', 'I3s', ('current', 'position'), _of_phase(3)),
    Channel('motor_torque', 'N m', "K_m times the true current in the motor's winding", ('motor_current',), _torque),
    Channel('encoder_position', 'rad', 'in the last period of the speed loop, on the grid of increments',
            ('increments',), _angle),
    Channel('encoder_increments', 'increments', 'the same in encoder counts', ('increments',)),
    Channel('position', 'rad', 'motor shaft between exchanges', ('position',)),
    Channel('speed', 'rad/s', 'motor shaft between exchanges', ('speed',)),
    Channel('coupling_torque', 'N m', 'd (4.31), from the plant at the last exchange', ('coupling',)),
    Channel('overload', 's', 'integral of the I2t monitoring, once per bus cycle', ('overload',)),
    Channel('dc_link', 'V', 'voltage of the DC link', ('dc_link',)),
    Channel('resistor_load', ONE, 'heat of the brake resistor relative to its continuous power', ('resistor_load',)),
    Channel('winding_temperature', 'degC', 'temperature of the winding', ('winding_degc',)),
    Channel('housing_temperature', 'degC', "temperature of the motor's housing", ('housing_degc',)),
    Channel('sink_temperature', 'degC', 'temperature of the heat sink', ('sink_degc',)),
    Channel('brake_release', ONE, 'brake output, 1 = release', ('brake_release',)),
    Channel('state', ONE, 'state of the drive, as P-0-0081', ('state',)),
    Channel('status', 'bits', 'status word S-0-0135', ('status',)),
    Channel('control', 'bits', 'control word S-0-0134 that is valid', ('control',)),
    Channel('fault', ONE, 'latched cause of a fault, 0 without one', ('fault',)),
    Channel('warning', 'bits', 'present warnings', ('warning',)),
    Channel('lost_telegrams', ONE, 'lost MDTs', ('mdt_losses',)),
    Channel('program', ONE, 'program bit of the master, S-0-0302', ('program',)),
)
# fmt: on
CHANNELS = {row.name: row for row in _ROWS}
FAULT, PROGRAM = CHANNELS['fault'], CHANNELS['program']


def _of_operation_data(row: OperationData) -> Channel:
    """Return the channel of operation data, computed with the parameters at the time of the sample."""
    # without a state field, any field provides the number of samples
    fields = tuple(source for source in row.sources if '.' not in source) or ('state',)

    def value(parameters: Parameters, _: Any, *columns: Floats) -> Floats:
        def value_of(source: str, sample: dict[str, float]) -> Any:
            group, dot, name = source.partition('.')
            return getattr(getattr(parameters, group), name) if dot else sample[source]

        samples = zip(*(column.tolist() for column in columns), strict=True)
        named = [dict(zip(fields, sample, strict=True)) for sample in samples]
        return np.array(
            [float(row.formula(*(value_of(source, one) for source in row.sources))) for one in named]
        )

    return Channel(format_idn(row.idn), row.unit, row.name, fields, value)


@cache
def channel_named(name: str) -> Channel:
    """Return a channel by its name or IDN; raises ParameterError."""
    if name in CHANNELS:
        return CHANNELS[name]
    if _IDN.fullmatch(name):
        row = TABLE.get(parse_idn(name.upper()))
        if row is None or PHASE in row.sources:
            raise ParameterError(f'an oscilloscope cannot show {name.upper()}: see delta3 drive list')
        return _of_operation_data(row)
    raise ParameterError(
        f'a drive has no channel {shown(name)}{nearest_of(name, CHANNELS)}: see delta3 scope list'
    )


def chosen(texts: Sequence[str]) -> tuple[tuple[int, Channel], ...]:
    """Return axis (0 to 3) and channel for texts such as ``axis1.current_reference``, at most eight.

    Raises
    ------
    ParameterError
        An axis or a channel is unknown or duplicated, or the number of channels is invalid.

    """
    found = []
    for text in texts:
        axis, _, name = text.partition('.')
        if axis not in ALL_DRIVES:
            names = f'{", ".join(ALL_DRIVES)}, a point, and a channel'
            raise ParameterError(
                f'{shown(text)} is not a valid channel: expected {names}, such as axis1.current_reference'
            )
        found.append((ALL_DRIVES.index(axis), channel_named(name)))
    for place, (one, text) in enumerate(zip(found, texts, strict=True)):
        if one in found[:place]:
            raise ParameterError(f'{text} is given twice')
    if not 1 <= len(found) <= SCOPE_CHANNELS_MAX:
        raise ParameterError(f'an oscilloscope shows 1 to {SCOPE_CHANNELS_MAX} channels, not {len(found)}')
    return tuple(found)


def full_name(axis: int, channel: Channel) -> str:
    """Return the full name of a channel of an axis, 0 to 3."""
    return f'{ALL_DRIVES[axis]}.{channel.name}'


def is_full_name(text: str) -> bool:
    """Whether a text has the form of a full channel name."""
    axis, point, _ = text.partition('.')
    return axis in ALL_DRIVES and bool(point)
