"""Facts about CSV traces: every unit that is read means what it says, every column goes to its own signal."""

import math

import numpy as np
import pytest

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import quantities, trace_csv

# unit in the file: (a signal of that quantity, its axis names, SI value of 1.5 of it)
MEANING = {
    'rad': ('motor_position', '123', 1.5),
    'deg': ('motor_position', '123', 0.026179938779914943),
    'rev': ('motor_position', '123', 9.42477796076938),
    'rad/s': ('motor_speed', '123', 1.5),
    'deg/s': ('motor_speed', '123', 0.026179938779914943),
    'rpm': ('motor_speed', '123', 0.15707963267948966),
    'rad/s2': ('arm_acceleration', '123', 1.5),
    'deg/s2': ('arm_acceleration', '123', 0.026179938779914943),
    'A': ('current', '123', 1.5),
    'mA': ('current', '123', 0.0015),
    'm': ('tcp_actual', 'xyz', 1.5),
    'mm': ('tcp_actual', 'xyz', 0.0015),
    'V': ('phase_voltage', '123', 1.5),
    'N m': ('coupling_torque', '123', 1.5),
    'm/s': ('tcp_velocity', 'xyz', 1.5),
    'mm/s': ('tcp_velocity', 'xyz', 0.0015),
    'm/s2': ('tcp_acceleration', 'xyz', 1.5),
    'mm/s2': ('tcp_acceleration', 'xyz', 0.0015),
}


def write(path, header, *rows):
    path.write_text('\n'.join([header, *rows]) + '\n', encoding='utf-8')
    return path


@pytest.mark.parametrize('unit', MEANING)
def test_one_and_a_half_of_a_unit_is_its_value_in_si(unit, tmp_path):
    name, suffixes, value = MEANING[unit]
    header = ','.join(['time [s]', *(f'{name}_{suffix} [{unit}]' for suffix in suffixes)])
    trace = trace_csv.read(write(tmp_path / 'a.csv', header, '0,1.5,0,-1.5', '1,3,0,0'))
    assert trace[name][0] == pytest.approx([value, 0.0, -value], rel=1e-15)
    assert trace[name][1, 0] == pytest.approx(2.0 * value, rel=1e-15)


def test_every_unit_that_is_read_has_its_meaning_here():
    assert set(quantities.UNITS) == {*MEANING, 's', 'ms', 'us'}


@pytest.mark.parametrize(('unit', 'second'), [('s', 1.0), ('ms', 1000.0), ('us', 1e6)])
def test_times_are_seconds_or_milliseconds(unit, second, tmp_path):
    header = f'time [{unit}],current_1 [A],current_2 [A],current_3 [A]'
    trace = trace_csv.read(write(tmp_path / 'a.csv', header, '0,1,2,3', f'{0.25 * second},1,2,3'))
    assert trace.time_s.tolist() == [0.0, 0.25]


def test_columns_belong_to_their_axes_in_whatever_order_they_stand(tmp_path):
    columns = ('current_3 [A]', 'motor_speed_2 [rad/s]', 'time [s]', 'current_1 [mA]', 'motor_speed_1 [rpm]')
    header = ','.join([*columns, 'current_2 [A]', 'motor_speed_3 [deg/s]'])
    trace = trace_csv.read(write(tmp_path / 'a.csv', header, '3,20,0,1000,60,2,180', '6,40,1,2000,120,4,360'))
    assert trace['current'].tolist() == [[1.0, 2.0, 3.0], [2.0, 4.0, 6.0]]
    assert trace['motor_speed'] == pytest.approx(
        np.array([[math.tau, 20.0, math.pi], [2 * math.tau, 40.0, math.tau]])
    )


def test_a_column_that_stands_twice_is_refused(tmp_path):
    header = 'time [s],current_1 [A],current_2 [A],current_3 [A],current_1 [mA]'
    with pytest.raises(TraceError, match='twice'):
        trace_csv.read(write(tmp_path / 'a.csv', header, '0,1,2,3,4'))
