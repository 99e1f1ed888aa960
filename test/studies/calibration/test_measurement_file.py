"""Tests of tables of measurements: accepted content, and messages of rejections."""

import numpy as np
import pytest

from delta3_pacdrive.errors import CalibrationError
from delta3_pacdrive.studies.calibration import measurement_file, simulated
from delta3_pacdrive.studies.framework.provenance import Provenance
from measured import instrument, planned

HEADER = 'axis1 [deg],axis2 [deg],axis3 [deg],measured_x [mm],measured_y [mm],measured_z [mm]'
ROW = '10,20,30,1.5,-2.5,-800'
TOUCH = 'axis1 [deg],axis2 [deg],axis3 [deg],object,diameter [mm]'


def read(tmp_path, *lines, content=None):
    path = tmp_path / 'measured.csv'
    path.write_bytes('\n'.join(lines).encode() if content is None else content)
    return measurement_file.read(path)


def test_table_has_angles_and_points_in_its_units(tmp_path):
    found = read(tmp_path, HEADER, ROW, '', '11,21,31,1,2,-801')
    assert found.angles_rad[0] == pytest.approx(np.radians([10.0, 20.0, 30.0]))
    assert found.points_m == pytest.approx(np.array([[0.0015, -0.0025, -0.8], [0.001, 0.002, -0.801]]))
    assert not found.checks.any()
    assert found.objects == ()
    other = read(tmp_path, HEADER.replace('mm', 'm').replace('deg', 'rad'), '0.1,0.2,0.3,0.001,0.002,-0.8')
    assert other.points_m[0] == pytest.approx([0.001, 0.002, -0.8])
    assert other.angles_rad[0] == pytest.approx([0.1, 0.2, 0.3])


def test_touches_name_the_touched_object(tmp_path):
    found = read(tmp_path, TOUCH, '10,20,30,plate,', '10,21,30,ball,50', '10,22,30,ball,50')
    assert found.objects == ('plate', 'ball', 'ball')
    assert np.isnan(found.diameters_m[0])
    assert found.diameters_m[1:] == pytest.approx([0.05, 0.05])


def test_the_table_of_a_plan_is_read_back_once_it_is_filled_in(tmp_path, robot):
    poses = planned(robot)
    measured = instrument(poses, robot)
    origin = Provenance.of('delta3 calibrate plan', robot)
    path = measurement_file.write(
        tmp_path / 'a.csv', poses, simulated.planned_angles(poses, robot), origin, measured.points_m
    )
    found = measurement_file.read(path)
    assert found.angles_rad == pytest.approx(measured.angles_rad, abs=1e-8)
    assert found.points_m == pytest.approx(measured.points_m, abs=1e-9)
    assert (found.checks == poses.checks).all()
    assert found.checksum == robot.checksum
    empty = measurement_file.write(tmp_path / 'b.csv', poses, simulated.planned_angles(poses, robot), origin)
    with pytest.raises(CalibrationError, match=r'measurement 1 of .* has no measured_x \[mm\]$'):
        measurement_file.read(empty)


@pytest.mark.parametrize(
    ('lines', 'sentence'),
    [
        ([], 'is empty: it has no headings and no numbers'),
        ([HEADER], 'has no measurement'),
        (['time [s],current_1 [A]', '0,1'], 'is not a table of measurements: it has the column .time'),
        ([HEADER.replace('axis2', 'axes2'), ROW], 'did you mean axis2'),
        ([HEADER.replace('axis2 [deg]', 'axis2'), ROW], 'must have a unit, one of'),
        ([HEADER.replace('[mm]', '[kg]'), ROW], 'must have a unit, one of'),
        ([HEADER.replace('axis2', 'axis1'), ROW], 'has the column axis1 twice'),
        ([HEADER.rpartition(',')[0], '10,20,30,1,2'], 'has no column measured_z'),
        ([HEADER, '10,20,30'], 'line 2 of .* has 3 values, the header 6 columns'),
        ([HEADER, ROW, '10,20,x,1,2,3'], 'line 3 of .* contains .x., not only numbers'),
        (
            [HEADER, ROW, ROW.replace('30', 'inf')],
            r'measurement 2 of .*: axis3 \[deg\] is not a finite number',
        ),
        ([HEADER, ROW.replace('30', '')], r'has no axis3 \[deg\]$'),
        (
            ['use,' + HEADER, 'perhaps,' + ROW],
            'measurement 1 of .*: use is .perhaps., but must be fit or check',
        ),
        (
            ['use,' + HEADER, 'fit,' + ROW, ',' + ROW],
            "measurement 2 of .*: use is '', but must be fit or check",
        ),
        (['use,' + HEADER, 'check,' + ROW], 'all of them are checks'),
        ([HEADER + ',object', ROW + ',plate'], 'has both points and touches of objects'),
        ([TOUCH, '10,20,30,,'], 'measurement 1 of .* names no object'),
        (
            [TOUCH, '10,20,30,ball,50', '10,20,31,ball,60'],
            'measurement 2 of .* the diameter of ball differs',
        ),
        ([TOUCH, '10,20,30,ball,-50'], 'measurement 1 of .*: the diameter of ball must be positive'),
    ],
)
def test_invalid_table_is_rejected_with_one_message(lines, sentence, tmp_path):
    with pytest.raises(CalibrationError, match=sentence):
        read(tmp_path, *lines)


def test_tables_as_others_write_them_are_read(tmp_path):
    own = read(tmp_path, 'use,' + HEADER, 'fit,' + ROW, 'check,11,21,31,1,2,-801')
    headings = 'use;axis1;axis2;axis3;measured_x;measured_y;measured_z'
    rows = ['fit;10,0;20;30;1,5;-2,5;-800', 'check;11;21;31;1;2;-801']
    other = read(tmp_path, headings, ';°;°;°;mm;mm;mm', *rows)
    for found in (other, _with_columns(tmp_path, 'use;W1;W2;W3;X;Y;Z', *rows)):
        assert (found.angles_rad == own.angles_rad).all()
        assert (found.points_m == own.points_m).all()
        assert found.checks.tolist() == [False, True]


def test_a_touch_may_have_a_name_with_the_decimal_mark(tmp_path):
    found = read(tmp_path, TOUCH.replace(',', ';'), '10,5;20;30;"plate, left";', '10;21;30;ball;50,5')
    assert found.objects == ('plate, left', 'ball')
    assert found.diameters_m[1] == pytest.approx(0.0505)


def test_factor_and_offset_of_a_column_file_apply_to_angles_and_points(tmp_path):
    """A column file says that the SI value is factor times the number plus the offset."""
    found = _with_columns(
        tmp_path, 'W1,W2,W3,X,Y,Z', ROW, factors=', factor: -0.5, offset: 0.25', units=('rad', 'm')
    )
    assert found.angles_rad[0] == pytest.approx([0.25 - 5.0, 0.25 - 10.0, 0.25 - 15.0])
    assert found.points_m[0] == pytest.approx([0.25 - 0.75, 0.25 + 1.25, 0.25 + 400.0])


def _with_columns(folder, *lines, units=('deg', 'mm'), factors=''):
    told = [(f'W{n}', 'arm_position', n, units[0]) for n in (1, 2, 3)]
    told += [(axis.upper(), 'tcp_measured', axis, units[1]) for axis in 'xyz']
    columns = folder / 'columns.yaml'
    columns.write_text(
        'columns:\n'
        + ''.join(
            f'- {{column: {column}, signal: {signal}, axis: {axis}, unit: {unit}{factors}}}\n'
            for column, signal, axis, unit in told
        )
    )
    path = folder / 'theirs.csv'
    path.write_text('\n'.join(lines))
    return measurement_file.read(path, columns)


def test_a_column_file_that_names_something_else_is_rejected(tmp_path):
    (tmp_path / 'columns.yaml').write_text('columns: [{column: t, signal: current, axis: 1, unit: A}]')
    (tmp_path / 'theirs.csv').write_text('t\n1\n')
    with pytest.raises(
        CalibrationError, match='names current, measurements have arm_position and tcp_measured'
    ):
        measurement_file.read(tmp_path / 'theirs.csv', tmp_path / 'columns.yaml')
    (tmp_path / 'columns.yaml').write_text('columns: [{column: t, signal: time, unit: s}]')
    with pytest.raises(CalibrationError, match='has no column arm_position'):
        measurement_file.read(tmp_path / 'theirs.csv', tmp_path / 'columns.yaml')


def test_files_of_other_users_are_rejected(tmp_path):
    for content in (b'\x89PNG\r\n\x1a\n\x00\x00', b'\xff\xfe\x00', b'"' + 300_000 * b'x'):
        with pytest.raises(CalibrationError):
            read(tmp_path, content=content)
    with pytest.raises(CalibrationError, match='cannot read measurements'):
        measurement_file.read(tmp_path)
    with pytest.raises(CalibrationError, match='No such file'):
        measurement_file.read(tmp_path / 'nowhere.csv')
