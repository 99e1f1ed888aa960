"""Report of the run of a single motor: JSON document, text, table and trace."""

from typing import Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.motor import share_text, thermal_warnings
from delta3_pacdrive.studies.drives.one_motor.study import SingleRun
from delta3_pacdrive.studies.framework.columns import cells, fill, named_lines
from delta3_pacdrive.studies.framework.report_folder import Table

TABLE = 'one_motor.csv'
SHOWN_EVERY = 4  # rows of the table: a period of the position loop


def summary(found: SingleRun) -> dict[str, Any]:
    """Return the results, ready for JSON."""
    rows, motor = found.driven, found.robot.motor
    apart = np.abs(found.position[rows] - found.in_robot[rows])
    return {
        'program': found.program,
        'axis': found.axis,
        'load_inertia_kg_m2': motor.load_inertia_kg_m2,
        'load_torque_n_m': motor.load_torque_n_m,
        'coupling_effect': motor.coupling_effect,
        'shaft_inertia_kg_m2': found.inertia_kg_m2,
        'current_peak_a': _largest(found.current[rows]),
        'current_peak_limit_a': motor.peak_current_a,
        'current_rms_a': (rms_a := _rms(found.current[rows])),
        'current_rms_limit_a': motor.nominal_current_a,
        'warnings': thermal_warnings([rms_a], motor.nominal_current_a, [f'motor {found.axis}']),
        'speed_max_rad_s': _largest(found.speed[rows]),
        'voltage_max_v': _largest(found.voltage[rows]),
        'position_error_max_rad': _largest(found.position_error[rows]),
        'position_error_rms_rad': _rms(found.position_error[rows]),
        'final_error_rad': float(found.position_error[-1]),
        'from_robot_max_rad': float(apart.max()),
        'from_robot_rms_rad': _rms(apart),
    }


def _largest(values: Floats) -> float:
    return float(np.abs(values).max())


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def text(document: dict[str, Any]) -> list[str]:
    """Return a summary as lines of text."""
    d = document
    peak, nominal = (
        share_text([d[f'current_{which}_a']], d[f'current_{which}_limit_a'], name)
        for which, name in (('peak', 'peak'), ('rms', 'nominal'))
    )
    rows = [
        (
            'load',
            'I_Load {load_inertia_kg_m2:g} kg m2, tau_load {load_torque_n_m:g N m}, CE {coupling_effect:g}; '
            'shaft with load {shaft_inertia_kg_m2:.3f kg cm2}',
        ),
        ('current', f'{{current_peak_a:.2f A}} peak, {peak}; {{current_rms_a:.2f A}} rms, {nominal}'),
        *(('warning', warning) for warning in d['warnings']),
        ('speed', '{speed_max_rad_s:.1f rad/s} max, phase voltage {voltage_max_v:.1f V} max'),
        (
            'set point',
            '{position_error_max_rad:.3f mrad} max, {position_error_rms_rad:.3f mrad} rms from the shaft',
        ),
        (
            'in robot',
            'the same shaft deviates by {from_robot_max_rad:.3f mrad} max, {from_robot_rms_rad:.3f mrad} rms',
        ),
    ]
    lines = named_lines(((name, fill(template, d)) for name, template in rows), 12)
    return [f'{d["program"]}, motor {d["axis"]} alone', '', *lines, '']


def tables(found: SingleRun) -> list[Table]:
    """Return all signals as a table, with one row per period of the position loop."""
    return [Table.of_columns(TABLE, {name: values[::SHOWN_EVERY] for name, values in cells(found).items()})]


def trace(found: SingleRun) -> Trace:
    """Return the run as a trace with one row per period of the current loop; the other motors are 0."""

    def of_axis(values: Floats) -> Floats:
        columns = np.zeros((len(values), 3))
        columns[:, found.axis - 1] = values
        return columns

    one = {
        'motor_command': found.command,
        'shaft_position': found.position,
        'shaft_speed': found.speed,
        'position_reference': found.reference,
        'speed_reference': found.speed_reference,
        'current_reference': found.current_reference,
        'current': found.current,
        'phase_voltage': found.voltage,
        'coupling_torque': found.coupling + found.load,
    }
    start = found.robot.motion.start_cycle * found.robot.bus.cycle_time_s
    signals = {name: of_axis(values) for name, values in one.items()}
    signals['phase_current'] = found.phase_currents
    return Trace(found.time_s + start, signals, found.meta | {'single_motor': found.axis})
