"""Plots of a page: signals that share a plot, and their displayed units."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.axes import ARMS, ROTARY_AXES_MAX, numbered
from delta3_pacdrive.recording.signals import (
    CURRENT_SIGNALS,
    DERIVED_SIGNALS,
    SIGNALS,
    SUPPLY_SIGNALS,
    THERMAL_SIGNALS,
    TORQUE_SIGNALS,
    TRUE_SIGNALS,
    columns_of,
)
from delta3_pacdrive.recording.tables import quantities

AXES, XYZ = ('axis 1', 'axis 2', 'axis 3'), ('x', 'y', 'z')
ACTUAL, COMMAND, TRUE = 'actual', 'command', 'true'
DEG = math.degrees(1.0)
# signals computed for a page: (unit, meaning)
DERIVED = {
    'tcp_speed': ('m/s', 'speed of the actual TCP'),
    'tcp_error_norm': ('m', 'norm of the TCP error'),
    'master_distance': ('m', 'distance of the virtual master: of the command along its path'),
    'master_speed': ('m/s', 'speed of the virtual master'),
    'master_acceleration': ('m/s2', 'acceleration of the virtual master'),
    'tcp_acceleration_norm': ('m/s2', 'acceleration of the actual TCP, norm'),
    'gear_torque': DERIVED_SIGNALS['gear_torque'],
    'jacobian_condition': ('1', 'condition number of J at the TCP of the command'),
    'jacobian_speed': ('m/s', 'speed of the TCP of the command'),
    'jacobian_acceleration': ('m/s2', 'acceleration of the TCP of the command'),
}
# signals whose columns have different units and are shown separately
APART = {'master': ('distance', 'speed', 'acceleration'), 'jacobian': ('condition', 'speed', 'acceleration')}
USUAL = SIGNALS | TORQUE_SIGNALS | CURRENT_SIGNALS | TRUE_SIGNALS | SUPPLY_SIGNALS | THERMAL_SIGNALS | DERIVED


def is_shown(name: str) -> bool:
    """Return whether a page shows a signal unchanged; of some it shows the norm or single columns."""
    computed = name in DERIVED_SIGNALS and name not in DERIVED
    return not computed and name not in APART and quantities.unit_of(name) is not None


def quantity(name: str) -> tuple[str, str]:
    """Return unit and meaning of a signal in a page."""
    if name in USUAL:
        return USUAL[name]
    return quantities.unit_of(name) or quantities.ONE, quantities.meaning_of(name)


@dataclass(frozen=True)
class Plot:
    """Plot of one or more signals over time."""

    title: str
    unit: str  # of the displayed values
    factor: float  # from values to displayed values
    signals: tuple[tuple[str, str], ...]  # name and role: actual, command or true
    columns: tuple[str, ...]  # names of the columns of the signals
    of_arm: bool = False  # motor values are divided by the gear ratio (4.17)
    shown: bool = True  # when the page is opened
    what: str = ''  # explanation

    def document(self, held: Iterable[str]) -> dict[str, Any] | None:
        """Return the plot for JSON with the available signals; None if no signal is available."""
        held = set(held)
        signals = [
            {'name': name, 'role': role, 'arm': self.of_arm and name.startswith('motor_')}
            for name, role in self.signals
            if name in held
        ]
        if not signals:
            return None
        return {
            'title': self.title,
            'unit': self.unit,
            'factor': self.factor,
            'columns': list(self.columns),
            'signals': signals,
            'shown': self.shown,
            'what': self.what,
        }


def _of_rotary_axis(number: int) -> tuple[Plot, ...]:
    """Return the plots of rotary axis ``number``, from 0."""
    position, command, true, error, speed, current = (
        numbered(f'turn_{name}', number)
        for name in ('position', 'command', 'true', 'error', 'speed', 'current')
    )
    axis = f'axis {ARMS + 1 + number}'
    of_axis = f', {axis}' if number else ''
    return (
        Plot(
            f'Angle of the tool{of_axis}',
            'deg',
            DEG,
            ((position, ACTUAL), (command, COMMAND), (true, TRUE)),
            ('turn',),
        ),
        Plot(f'Error of the angle of the tool{of_axis}', 'deg', DEG, ((error, ACTUAL),), ('error',)),
        Plot(f'Speed of the tool{of_axis}', 'deg/s', DEG, ((speed, ACTUAL),), ('speed',), shown=False),
        Plot(f'Current of {axis if number else "the rotary axis"}', 'A', 1.0, ((current, ACTUAL),), (axis,)),
    )


PLOTS = (
    Plot('TCP speed', 'm/s', 1.0, (('tcp_speed', ACTUAL), ('master_speed', COMMAND)), ('speed',)),
    Plot(
        'TCP acceleration, norm',
        'm/s2',
        1.0,
        (('tcp_acceleration_norm', ACTUAL),),
        ('acceleration',),
        shown=False,
    ),
    Plot('Virtual master, distance', 'mm', 1e3, (('master_distance', COMMAND),), ('s',), shown=False),
    Plot(
        'Virtual master, acceleration', 'm/s2', 1.0, (('master_acceleration', COMMAND),), ('a',), shown=False
    ),
    Plot('TCP error', 'mm', 1e3, (('tcp_error', ACTUAL),), XYZ),
    Plot('TCP error, norm', 'mm', 1e3, (('tcp_error_norm', ACTUAL),), ('norm',), shown=False),
    Plot('Current', 'A', 1.0, (('current_mean', ACTUAL),), AXES),
    Plot(
        'Current, least and greatest sample of each cycle',
        'A',
        1.0,
        (('current_min', ACTUAL), ('current_max', ACTUAL)),
        AXES,
    ),
    Plot('Current in the AT', 'A', 1.0, (('current', ACTUAL),), AXES, shown=False),
    Plot('Gear torque', 'N m', 1.0, (('gear_torque', ACTUAL),), AXES, shown=False),
    Plot('Following error of the arms', 'deg', DEG, (('following_error', ACTUAL),), AXES),
    Plot('Arm speed', 'deg/s', DEG, (('motor_speed', ACTUAL),), AXES, of_arm=True),
    Plot(
        'Arm angle',
        'deg',
        DEG,
        (('motor_position', ACTUAL), ('motor_command', COMMAND), ('arm_angle', TRUE)),
        AXES,
        of_arm=True,
    ),
    Plot(
        'TCP position', 'mm', 1e3, (('tcp_actual', ACTUAL), ('tcp_command', COMMAND), ('tcp_true', TRUE)), XYZ
    ),
    *(plot for number in range(ROTARY_AXES_MAX) for plot in _of_rotary_axis(number)),
    Plot('Coupling torque d', 'N m', 1.0, (('coupling_torque', ACTUAL),), AXES, shown=False),
    Plot('True motor shaft', 'deg', DEG, (('shaft_position', ACTUAL),), AXES, shown=False),
    Plot('True motor speed', 'rpm', 60.0 / math.tau, (('shaft_speed', ACTUAL),), AXES, shown=False),
)


def others(held: Iterable[str]) -> list[Plot]:
    """Return a plot for each signal that is not in ``PLOTS``."""
    known = {name for plot in PLOTS for name, _ in plot.signals}
    return [_of(name) for name in held if name not in known]


def _of(name: str) -> Plot:
    unit, what = quantity(name)
    title = what if name in USUAL else name.replace('_', ' ')
    columns = tuple(column for column, _ in columns_of(name, unit))
    return Plot(title, unit, 1.0, ((name, ACTUAL),), columns, shown=False, what=what)
