"""Facts about ``delta3 workspace``: its figures of the workspace, its files, its refusals."""

import json

import numpy as np
import pytest

from delta3_pacdrive.cli import workspace


def test_extremes_are_told_in_si_with_their_places(capsys):
    assert workspace.main(['--resolution', '50', '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert found['poses'] == 25 * 25 * 6
    speed = found['quantities']['speed_m_s']
    assert 5.0 < speed['least'] < speed['median'] < speed['largest'] < 8.0
    assert found['quantities']['payload_kg']['least'] == pytest.approx(21.0, abs=0.2)
    assert len(found['quantities']['condition']['largest_at_m']) == 3
    assert found['poses_per_s'] == pytest.approx(found['poses'] / found['seconds'])


def test_people_read_a_line_per_quantity(capsys):
    assert workspace.main(['--resolution', '100', '--payload', '2', '--acceleration', '40']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == 'accelerations with 2 kg, payloads with 40 m/s2'
    assert len(lines) == 3 + 9
    assert lines[3].split()[:4] == ['condition', 'of', 'the', 'Jacobian']


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
def test_what_cannot_be_obeyed_is_a_usage_error(arguments, capsys):
    with pytest.raises(SystemExit, match='2'):
        workspace.main(arguments)
    assert 'error: ' in capsys.readouterr().err


def test_a_resolution_that_makes_too_many_poses_is_refused_in_one_sentence(capsys):
    assert workspace.main(['--resolution', '1']) == 1
    assert 'poses, the limit is 20000000' in capsys.readouterr().err
