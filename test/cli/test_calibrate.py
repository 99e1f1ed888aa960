"""Tests of ``delta3 calibrate``: arguments, output and exit status."""

import json

import pytest

from delta3_pacdrive.cli import calibrate
from delta3_pacdrive.planning.program import file_reader as program_file


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        ([], 'required'),
        (['measure'], 'invalid choice'),
        (['fit'], 'fit requires either a table of measurements or --simulate'),
        (['home'], 'home requires either a table of measurements or --simulate'),
        (['fit', 'a.csv', '--simulate', 'rich'], 'fit requires either a table of measurements or --simulate'),
        (['plan', 'a.csv'], 'plan takes no table of measurements'),
        (['plan', '--simulate', 'rich'], '--simulate is for fit and home, not for plan'),
        (['fit', 'a.csv', '--height', '-900'], '--height is for plan and home, not for fit'),
        (['fit', 'a.csv', '--number', '30'], '--number and --checks apply to planned poses'),
        (['fit', 'a.csv', '--method', 'level'], 'a level plane determines the zero angles only: use home'),
        (['plan', '--height', '-900'], '--height and --arm require --method level'),
        (['plan', '--method', 'level'], 'touches of a level plane require --height'),
        (['home', 'a.csv'], 'touches of a level plane require --height'),
        (['home', 'a.csv', '--height', '-900', '--arm', '4'], 'must be a whole number between 1 and 3'),
        (['plan', '--noise', 'x'], 'must be a number between 0 and 10 mm'),
        (['plan', '--diameter', '50'], '--diameter requires planned poses and --method ball'),
        (['plan', '--columns', 'c.yaml'], '--columns is for fit and home, not for plan'),
        (['fit', '--simulate', 'rich', '--columns', 'c.yaml'], '--columns requires a table of measurements'),
    ],
)
def test_invalid_options_are_a_usage_error(arguments, sentence, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match='2'):
        calibrate.main(arguments)
    assert sentence in ' '.join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['fit', 'nowhere.csv'], 'cannot read'),
        (
            ['plan', '--number', '3'],
            '3 poses are too few for the method base, at least 6 are needed',
        ),
        (['plan', '--method', 'level', '--height', '-2000'], 'more than the 0 candidates'),
        (['plan', '--parameters', 'nowhere.yaml'], 'cannot read parameter file nowhere.yaml'),
    ],
)
def test_impossible_calibration_gives_one_message_and_status_1(
    arguments, sentence, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert calibrate.main(arguments) == 1
    errors = capsys.readouterr().err.strip().splitlines()
    assert errors[-1].startswith('error: ')
    assert sentence in errors[-1]


def test_a_plan_leaves_a_table_and_a_program(tmp_path, capsys, robot):
    folder = tmp_path / 'a'
    assert calibrate.main(['plan', '--number', '12', '--checks', '4', '--output', str(folder), '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found['poses'], found['checks']) == (12, 4)
    assert found['uncertainty_after_m'] < 0.1 * found['uncertainty_before_m']
    rows = [
        line for line in (folder / 'poses.csv').read_text('utf-8').splitlines() if not line.startswith('#')
    ]
    assert len(rows) == 17
    assert rows[0].startswith(
        'number,use,x [mm],y [mm],z [mm],axis1 [deg],axis2 [deg],axis3 [deg],measured_x [mm]'
    )
    program = program_file.load(folder / 'poses.yaml', robot.motion)
    assert len(program.statements) == 32  # a move and a dwell each


def test_a_table_that_was_not_filled_in_is_rejected(tmp_path, capsys):
    folder = tmp_path / 'a'
    assert calibrate.main(['plan', '--output', str(folder)]) == 0
    capsys.readouterr()
    assert calibrate.main(['fit', str(folder / 'poses.csv'), '--output', str(tmp_path / 'b')]) == 1
    assert 'has no measured_x [mm]' in capsys.readouterr().err
    assert not (tmp_path / 'b').exists()


def test_third_party_table_is_read_with_its_column_file(tmp_path, capsys):
    table, columns = tmp_path / 'theirs.csv', tmp_path / 'columns.yaml'
    table.write_text('W1,W2,W3,X,Y,Z\n10,20,30,1,2,-800\n')
    told = [('arm_position', n, 'deg', f'W{n}') for n in (1, 2, 3)]
    told += [('tcp_measured', axis, 'mm', axis.upper()) for axis in 'xyz']
    rows = [f'- {{signal: {a}, axis: {b}, unit: {c}, column: {d}}}\n' for a, b, c, d in told]
    columns.write_text('columns:\n' + ''.join(rows))

    def refused(*arguments):
        assert calibrate.main([*arguments, '--output', str(tmp_path / 'out')]) == 1
        return capsys.readouterr().err

    fit, home = ('fit', str(table)), ('home', str(table), '--height', '-900')
    assert 'is not a table of measurements' in refused(*fit)
    assert 'is 181.6 mm from the TCP computed' in refused(*fit, '--columns', str(columns))
    assert 'contains points, not touches' in refused(*home, '--columns', str(columns))
