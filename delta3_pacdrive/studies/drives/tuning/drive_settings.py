"""Parser of drive settings: ``NAME=VALUE`` and ``NAME=LOW:HIGH:N``.

A name is a parameter of the group ``drive``, its symbol in Table 9-1, or the IDN of a drive. An integral action time
(S-0-0101, S-0-0107) sets the integral gain of its loop.
"""

import dataclasses
import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.axes import ARMS, numbered
from delta3_pacdrive.errors import ParameterError, TuningError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Drive, Parameters, Rotary, flatten
from delta3_pacdrive.robot.drive.operation_data import TABLE
from delta3_pacdrive.robot.sercos.service_channel import format_idn

POINTS = (2, 200)  # of a sweep
# integral action time: (proportional gain, integral gain)
ACTION_TIMES = {
    'S-0-0101': ('velocity_gain_a_s_rad', 'velocity_integral_gain_a_rad'),
    'S-0-0107': ('current_gain_v_a', 'current_integral_gain_v_a_s'),
}


def _names() -> dict[str, str]:
    """Return the parameter of the group ``drive`` for each of its names."""
    names: dict[str, str] = {}
    for field in dataclasses.fields(Drive):
        symbol = field.metadata['description'].split(',')[0].split(' ')[0]
        # descriptions of parameters with a symbol begin with the symbol
        symbols = (symbol,) if symbol[0].isupper() else ()
        for name in (field.name, f'drive.{field.name}', *symbols):
            names.setdefault(name, field.name)
    for row in TABLE.values():
        group, _, name = row.sources[0].partition('.') if len(row.sources) == 1 else ('', '', '')
        if group == 'drive' and row.writable_in:
            names[format_idn(row.idn)] = name
    return names


NAMES = _names()
OF_TOOL = {field.name for field in dataclasses.fields(Rotary)}


@dataclass(frozen=True)
class Setting:
    """Value of one parameter of a drive."""

    name: str  # field of the group drive, or an IDN of ACTION_TIMES
    value: float  # [SI], in the unit of the field
    axis: int = 1  # number of the drive; a rotary axis has some values of its own

    @property
    def text(self) -> str:
        """Name and value as text."""
        return f'{self.name} = {self.value:g}'

    def apply(self, parameters: Parameters) -> Parameters:
        """Return parameters with this value; raises ParameterError with name and limits."""
        name, value = self.name, self.value
        if name in ACTION_TIMES:
            gain, name = ACTION_TIMES[name]
            if not value > 0.0:
                raise ParameterError(f'{self.name} is {shown(value)} s, but an action time must be positive')
            value = getattr(getattr(parameters, self._group_of(gain)), gain) / value
        return parameters.replace(**{f'{self._group_of(name)}__{name}': value})

    def _group_of(self, name: str) -> str:
        """Return the group of a parameter; a rotary axis uses the group ``drive`` for values it does not have."""
        number = self.axis - 1 - ARMS
        return numbered('rotary', number) if number >= 0 and name in OF_TOOL else 'drive'


def parse(text: str, axis: int = 1) -> Setting:
    """Parse ``NAME=VALUE`` for the drive of an axis; raises TuningError."""
    name, equals, value = text.partition('=')
    if not equals:
        raise TuningError(f'{shown(text)} is not a setting: expected NAME=VALUE, such as K_Ppos=80')
    return Setting(_resolve(name.strip()), _number(value, text), axis)


def parse_sweep(text: str, axis: int = 1) -> tuple[Setting, ...]:
    """Parse ``NAME=LOW:HIGH:N`` into N equidistant settings; raises TuningError."""
    name, equals, rest = text.partition('=')
    parts = rest.split(':')
    if not equals or len(parts) != 3:
        raise TuningError(
            f'{shown(text)} is not a sweep: expected NAME=LOW:HIGH:N, such as velocity_gain_a_s_rad=0.1:1:10'
        )
    low, high, count = (_number(part, text) for part in parts)
    if not (POINTS[0] <= count <= POINTS[1] and count == int(count)):
        raise TuningError(f'a sweep has {POINTS[0]} to {POINTS[1]} points, not {parts[2]}')
    if not low < high:
        raise TuningError(f'the sweep {shown(text)} must go from a smaller value to a larger one')
    resolved = _resolve(name.strip())
    values: Floats = np.linspace(low, high, int(count))
    return tuple(Setting(resolved, float(value), axis) for value in values)


def apply(settings: Sequence[Setting], parameters: Parameters) -> Parameters:
    """Return parameters with all settings; action times are applied last because they depend on gains."""
    for setting in sorted(settings, key=lambda s: s.name in ACTION_TIMES):
        parameters = setting.apply(parameters)
    return parameters


def changes(before: Parameters, after: Parameters) -> list[dict[str, float | str]]:
    """Return the parameters that differ, by dotted name."""
    flat = flatten(after)
    return [
        {'parameter': name, 'before': value, 'after': flat[name]}
        for name, value in flatten(before).items()
        if flat[name] != value
    ]


def _resolve(name: str) -> str:
    if name in ACTION_TIMES:
        return name
    if name in NAMES:
        return NAMES[name]
    near = difflib.get_close_matches(name, [*NAMES, *ACTION_TIMES], 3, 0.5)
    hint = (
        f'did you mean {" or ".join(near)}?' if near else 'names are those of the group drive, such as K_Ppos'
    )
    raise TuningError(f'no drive has a parameter {shown(name)}; {hint}')


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TuningError(f'{shown(text)} in {shown(where)} is not a finite number')
    return value
