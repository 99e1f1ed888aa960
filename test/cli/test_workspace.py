"""Tests of ``delta3 workspace``: figures of merit, files and rejections."""

import json

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.cli import workspace
from delta3_pacdrive.studies.places.workspace import evaluation


def test_extremes_are_in_si_with_their_positions(capsys):
    assert workspace.main(['--resolution', '50', '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert found['poses'] == 25 * 25 * 6
    speed = found['quantities']['speed_m_s']
    assert 5.0 < speed['least'] < speed['median'] < speed['largest'] < 8.0
    assert found['quantities']['payload_kg']['least'] == 10.0  # the limit of the robot
    assert len(found['quantities']['condition']['largest_at_m']) == 3
    assert found['poses_per_s'] == pytest.approx(found['poses'] / found['seconds'])


def test_users_read_a_line_per_quantity(capsys):
    assert workspace.main(['--resolution', '100', '--payload', '2', '--acceleration', '40']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == 'accelerations with 2 kg, payloads with 40 m/s2'
    assert len(lines) == 3 + 11
    assert lines[3].split()[:4] == ['condition', 'of', 'the', 'Jacobian']


def test_the_workspace_is_that_of_the_robot_of_a_parameter_file(tmp_path, capsys, robot):
    slow = robot.replace(dynamics__payload_mass_kg=3.0, motor__max_speed_rpm=0.5 * robot.motor.max_speed_rpm)
    file = str(parameters.write(slow, tmp_path / 'slow.yaml'))
    found = []
    for more in ([], ['--parameters', file]):
        assert workspace.main(['--resolution', '200', '--json', *more]) == 0
        found.append(json.loads(capsys.readouterr().out))
    usual, changed = found
    assert (usual['payload_kg'], changed['payload_kg']) == (robot.dynamics.payload_mass_kg, 3.0)
    speeds = [one['quantities']['speed_m_s']['median'] for one in found]
    assert speeds[1] == pytest.approx(0.5 * speeds[0])


def test_figures_tables_and_the_volume_are_written(tmp_path, capsys):
    folder, volume = tmp_path / 'maps', tmp_path / 'volume.csv'
    arguments = ['--resolution', '200', '--slice', 'z=-0.8', '--output', str(folder), '--volume', str(volume)]
    assert workspace.main([*arguments, '--json']) == 0
    files = json.loads(capsys.readouterr().out)['files']
    names = {path.name for path in folder.iterdir()}
    assert {'index.html', 'extremes.csv', 'reach.png', 'speed.png', 'increment.png'} <= names
    assert {file.rpartition('/')[2] for file in files} == names | {'volume.csv'}
    rows = [line for line in volume.read_text().splitlines() if not line.startswith('#')]
    table = np.array([[float(cell) for cell in row.split(',')] for row in rows[1:]])
    assert rows[0].startswith('x [m],y [m],z [m],limit,condition,')
    assert np.isfinite(table).all()


@pytest.mark.parametrize(
    'arguments',
    [
        ['--resolution', '0'],
        ['--resolution', 'nan'],
        ['--slice', 'z'],
        ['--slice', 'w=1'],
        ['--slice', 'z=nan', '--output', 'x'],
        ['--slice', 'z=-0.8'],
        ['--volume', 'volume.txt'],
        ['--acceleration', '-1'],
        ['--output', 'x', *(['--slice', 'z=-0.8'] * 10)],
    ],
)
def test_inapplicable_option_is_a_usage_error(arguments, capsys):
    with pytest.raises(SystemExit, match='2'):
        workspace.main(arguments)
    assert 'error: ' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (
            ['--resolution', '0.6', '--output', 'maps', '--volume', 'new/v.npz'],
            'poses, the limit is 20000000',
        ),
        (['--volume', 'v.npz/v.npz', '--output', 'maps'], 'cannot write v.npz/v.npz: v.npz is not a folder'),
        (['--volume', 'folder.csv', '--output', 'maps'], 'cannot write folder.csv: it is a folder'),
        (['--volume', 'v.npz', '--output', 'v.npz'], 'cannot write to v.npz: v.npz is not a folder'),
        (
            ['--volume', '/proc/new/v.npz'],
            'cannot write /proc/new/v.npz: the folder /proc may not be written: ',
        ),
    ],
)
def test_impossible_request_is_rejected_before_computation_and_writing(
    arguments, sentence, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(evaluation, 'capability', None)  # it would be missed
    (tmp_path / 'v.npz').touch()
    (tmp_path / 'folder.csv').mkdir()
    before = sorted(tmp_path.rglob('*'))
    assert workspace.main(arguments) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert sentence in line
    assert sorted(tmp_path.rglob('*')) == before


@pytest.mark.parametrize('plane', ['z=5', 'z=0.9', 'x=-2'])
def test_a_slice_that_the_arms_do_not_reach_is_rejected(plane, capsys, tmp_path):
    assert workspace.main(['--slice', plane, '--output', str(tmp_path / 'maps')]) == 1
    axis, _, place = plane.partition('=')
    sentence = f'error: the arms do not reach any position of the slice {axis} = {1e3 * float(place):g} mm\n'
    assert capsys.readouterr().err == sentence
    assert not list(tmp_path.iterdir())
