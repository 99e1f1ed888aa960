"""Tests of CSV traces: units, and assignment of columns to signals."""

import json
import math

import numpy as np
import pytest

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import trace_csv
from delta3_pacdrive.recording.tables import quantities
from delta3_pacdrive.recording.trace import Trace

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
    'increments': ('drive_encoder_increments', '123', 1.5),
    'bits': ('status_word', '123', 1.5),
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


def test_a_signal_of_one_column_has_no_axes_and_a_number_needs_no_unit(tmp_path):
    trace = trace_csv.read(write(tmp_path / 'a.csv', 'fault,payload [kg],time [s]', '0,1.5,0', '1,2.5,1'))
    assert trace['payload'].tolist() == [[1.5], [2.5]]
    assert trace['fault'].tolist() == [[0.0], [1.0]]


def test_every_unit_that_is_read_has_its_meaning_here():
    assert set(quantities.UNITS) == {*MEANING, 's', 'ms', 'us', 'ns', 'kg', 'Pa', 'N', 'W'}


@pytest.mark.parametrize(('unit', 'second'), [('s', 1.0), ('ms', 1000.0), ('us', 1e6)])
def test_times_are_seconds_or_milliseconds(unit, second, tmp_path):
    header = f'time [{unit}],current_1 [A],current_2 [A],current_3 [A]'
    trace = trace_csv.read(write(tmp_path / 'a.csv', header, '0,1,2,3', f'{0.25 * second},1,2,3'))
    assert trace.time_s.tolist() == [0.0, 0.25]


def test_columns_belong_to_their_axes_in_any_order(tmp_path):
    columns = ('current_3 [A]', 'motor_speed_2 [rad/s]', 'time [s]', 'current_1 [mA]', 'motor_speed_1 [rpm]')
    header = ','.join([*columns, 'current_2 [A]', 'motor_speed_3 [deg/s]'])
    trace = trace_csv.read(write(tmp_path / 'a.csv', header, '3,20,0,1000,60,2,180', '6,40,1,2000,120,4,360'))
    assert trace['current'].tolist() == [[1.0, 2.0, 3.0], [2.0, 4.0, 6.0]]
    assert trace['motor_speed'] == pytest.approx(
        np.array([[math.tau, 20.0, math.pi], [2 * math.tau, 40.0, math.tau]])
    )


def test_repeated_column_is_rejected(tmp_path):
    header = 'time [s],current_1 [A],current_2 [A],current_3 [A],current_1 [mA]'
    with pytest.raises(TraceError, match='twice'):
        trace_csv.read(write(tmp_path / 'a.csv', header, '0,1,2,3,4'))


META = {
    'cycle_time_s': 1e-3,
    'program': 'p' * 200,
    'gear_ratio': 32.0,
    'start_cycle': 4,
    'parameters': {'a.b': 1.5},
}


def written(path, **meta):
    rows = np.arange(6.0).reshape(2, 3) / 7.0
    return trace_csv.write(
        Trace(np.array([0.0, 1e-3]), {'current': rows, 'nobodys': rows}, META | meta), path
    )


def test_short_comment_is_in_the_file_and_the_remainder_next_to_it(tmp_path):
    path = written(tmp_path / 'run.csv')
    comment, header, *rows = path.read_text().splitlines()
    assert comment.startswith('# {"program": "ppp')
    assert len(comment) < 300
    assert header == 'time [s],current_1 [A],current_2 [A],current_3 [A]'
    assert len(rows) == 2
    document = json.loads((tmp_path / 'run.csv-metadata.json').read_text())
    assert document['@context'] == 'http://www.w3.org/ns/csvw'
    assert document['url'] == 'run.csv'
    assert [column['titles'] for column in document['tableSchema']['columns']] == header.split(',')
    assert document['tableSchema']['columns'][1]['schema:unitText'] == 'A'
    assert trace_csv.read(path).meta == META


def test_table_without_its_metadata_file_has_its_numbers_and_comment(tmp_path):
    path = written(tmp_path / 'run.csv')
    whole = trace_csv.read(path)
    (tmp_path / 'run.csv-metadata.json').unlink()
    alone = trace_csv.read(path)
    assert np.array_equal(alone['current'], whole['current'])
    assert alone.meta == {'cycle_time_s': 1e-3, 'program': 'p' * 80, 'gear_ratio': 32.0, 'start_cycle': 4}


def test_trace_with_an_incomplete_comment_names_the_file_with_the_remainder(tmp_path):
    trace = Trace(np.array([0.0]), {'current': np.ones((1, 3))}, {'seed': 3})
    path = trace_csv.write(trace, tmp_path / 'run.csv')
    assert path.read_text().splitlines()[0] == '# {"metadata": "run.csv-metadata.json"}'
    assert trace_csv.read(path).meta == {'seed': 3}


def test_neighbour_file_of_another_run_is_ignored(tmp_path):
    path = written(tmp_path / 'run.csv')
    other = written(tmp_path / 'other.csv', start_cycle=5)
    (tmp_path / 'other.csv-metadata.json').replace(tmp_path / 'run.csv-metadata.json')
    assert 'parameters' not in trace_csv.read(path).meta
    assert trace_csv.read(other).meta['start_cycle'] == 5


@pytest.mark.parametrize(
    'text', ['', '[]', '{"notes": []}', '{"notes": [{"delta3_pacdrive": 3}]}', 'null', '\xff']
)
def test_damaged_neighbour_file_is_reported_with_one_message(text, tmp_path):
    path = written(tmp_path / 'run.csv')
    (tmp_path / 'run.csv-metadata.json').write_bytes(text.encode('latin-1'))
    with pytest.raises(
        TraceError, match=r'^cannot read the metadata of run\.csv in .*run\.csv-metadata\.json: .+'
    ):
        trace_csv.read(path)
