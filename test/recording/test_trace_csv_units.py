"""Tests of units in CSV traces, and of the message for invalid traces."""

import numpy as np
import pytest

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import trace_csv
from delta3_pacdrive.recording.signals import columns_of
from delta3_pacdrive.recording.tables import quantities


def test_units_in_the_header_are_turned_into_si(tmp_path):
    columns = [f'motor_speed_{i} [rpm]' for i in '123'] + [f'tcp_measured_{i} [mm]' for i in 'xyz']
    path = tmp_path / 'run.csv'
    path.write_text('\n'.join([','.join(['time [ms]', *columns]), '0,60,0,0,1,2,3', '1,0,0,0,4,5,6']))
    trace = trace_csv.read(path)
    assert trace.time_s.tolist() == [0.0, 0.001]
    assert trace['motor_speed'][0, 0] == pytest.approx(2.0 * np.pi)
    assert trace['tcp_measured'][1] == pytest.approx([4e-3, 5e-3, 6e-3])


# written down from the definitions of the units, not from the reader's table
ONE_UNIT_IN_SI = {
    's': 1.0, 'ms': 0.001, 'us': 1e-6, 'ns': 1e-9,
    'rad': 1.0, 'deg': 0.017453292519943295, 'rev': 6.283185307179586, 'rad/s': 1.0,
    'deg/s': 0.017453292519943295, 'rpm': 0.10471975511965977, 'A': 1.0, 'mA': 0.001, 'm': 1.0, 'mm': 0.001, 'V': 1.0,
    'N m': 1.0, 'm/s': 1.0, 'mm/s': 0.001, 'm/s2': 1.0, 'mm/s2': 0.001, 'rad/s2': 1.0,
    'deg/s2': 0.017453292519943295, 'kg': 1.0, 'increments': 1.0, 'bits': 1.0, 'Pa': 1.0,
    'N': 1.0, 'W': 1.0,
}  # fmt: skip
IN_UNITS = {'s': 'time', 'rad': 'motor_position', 'rad/s': 'motor_speed', 'A': 'current', 'm': 'tcp_measured',
            'V': 'phase_voltage', 'N m': 'coupling_torque', 'm/s': 'tcp_velocity',
            'm/s2': 'tcp_acceleration', 'rad/s2': 'arm_acceleration', 'kg': 'payload', 'bits': 'status_word',
            'increments': 'drive_encoder_increments', 'Pa': 'cell_vacuum', 'N': 'cell_force',
            'W': 'mains_power'}  # fmt: skip


@pytest.mark.parametrize('unit', ONE_UNIT_IN_SI)
def test_every_unit_matches_its_name(unit, tmp_path):
    assert quantities.UNITS.keys() == ONE_UNIT_IN_SI.keys()
    signal = IN_UNITS[quantities.UNITS[unit][0]]
    suffixes = [suffix for suffix, _ in columns_of(signal, '')]
    columns = (
        [f'time [{unit}]']
        if signal == 'time'
        else ['time [s]', *(f'{signal}_{i} [{unit}]'.replace('_ [', ' [') for i in suffixes)]
    )
    path = tmp_path / 'run.csv'
    path.write_text(
        f'{",".join(columns)}\n{",".join(["0"] * len(columns))}\n{",".join(["1"] * len(columns))}\n'
    )
    trace = trace_csv.read(path)
    values = trace.time_s[1] if signal == 'time' else trace[signal][1]
    assert np.all(np.abs(values / ONE_UNIT_IN_SI[unit] - 1.0) < 1e-15)


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('', 'is empty'),
        ('time [s]\n', 'no row of numbers'),
        ('time [s],speed [rad/s]\n0,1\n', 'unknown column'),
        ('time,current_1 [A],current_2 [A],current_3 [A]\n0,1,2,3\n', 'must have a unit'),
        ('time [s],current_1 [V],current_2 [A],current_3 [A]\n0,1,2,3\n', 'must have a unit'),
        ('time [s],current_1 [A],current_2 [A]\n0,1,2\n', 'not all three'),
        ('time [s],time [s]\n0,0\n', 'twice'),
        ('time [s]\n0\none\n', 'not only numbers'),
        ('time [s],payload [kg]\n0,1\n1,2,3\n', 'has 3 values'),
        ('time [s]\nnan\n', 'not finite'),
        ('time [s]\n1\n0\n', 'do not increase'),
        ('# {"gear_ratio": \ntime [s]\n0\n', 'not a JSON object'),
    ],
)
def test_invalid_csv_trace_is_rejected_with_one_message(text, reason, tmp_path):
    path = tmp_path / 'run.csv'
    path.write_text(text)
    with pytest.raises(TraceError, match=reason) as caught:
        trace_csv.read(path)
    assert '\n' not in str(caught.value)
