"""Tests of ``delta3 pose``: arguments, output and exit status."""

import json

import numpy as np
import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.cli import pose


def result(capsys, *arguments):
    status = pose.main([*arguments, '--json'])
    return status, json.loads(capsys.readouterr().out)


def test_a_point_and_its_angles_are_the_same_pose(robot, capsys):
    status, found = result(capsys, '0.2', '0.1', '-0.85')
    assert status == 0
    assert found['ok'] is found['reachable'] is True
    np.testing.assert_allclose(found['arm_angles_rad'], kinematics.inverse([0.2, 0.1, -0.85], robot))
    degrees = [str(angle) for angle in found['arm_angles_deg']]
    status, same = result(capsys, '--angles', *degrees)
    assert status == 0
    np.testing.assert_allclose(same['point_m'], [0.2, 0.1, -0.85], atol=1e-12)
    assert same['condition'] == pytest.approx(found['condition'])
    assert len(found['solutions']) == 8


def test_without_a_place_it_is_home(robot, capsys):
    assert result(capsys)[1]['point_m'] == list(robot.motion.home_m)


def test_place_outside_the_workspace_gives_status_1_and_a_message(capsys):
    assert pose.main(['0.7', '0', '-0.9']) == 1
    output, errors = capsys.readouterr()
    assert 'condition' in output
    assert errors == 'error: the distance from the z axis is 0.7 m, the limit is 0.6 m\n'
    status, found = result(capsys, '1.5', '0', '-0.8')
    assert status == 1
    assert found['ok'] is False
    assert 'out of reach of arms 1, 2 and 3' in found['error']
    assert found['jacobian_m_rad'] is None


@pytest.mark.parametrize(
    'arguments',
    [
        ['1', '2'],
        ['nan', '0', '-0.8'],
        ['1e9', '0', '-0.8'],
        ['0', '0', '-0.8', '--angles', '0', '0', '0'],
        ['--angles', '0', '0', 'inf'],
        ['--payload', 'x'],
    ],
)
def test_invalid_position_is_a_usage_error(arguments, capsys):
    with pytest.raises(SystemExit, match='2'):
        pose.main(arguments)
    assert 'error: ' in capsys.readouterr().err


def test_a_payload_beyond_the_parameters_range_is_rejected(capsys):
    assert pose.main(['--payload', '11']) == 1
    assert 'payload_mass_kg' in capsys.readouterr().err
    assert result(capsys, '--payload', '4')[1]['payload_kg'] == 4.0


def test_figures_and_solutions_are_written_with_a_page(tmp_path, capsys):
    _, found = result(capsys, '0.2', '0.1', '-0.85', '--output', str(tmp_path / 'here'))
    names = {path.name for path in (tmp_path / 'here').iterdir()}
    assert {file.rpartition('/')[2] for file in found['files']} == names
    assert names == {
        'index.html',
        'solutions.csv',
        'forward_kinematics.png',
        'three_spheres.png',
        'inverse_kinematics.png',
        'eight_solutions.png',
    }
