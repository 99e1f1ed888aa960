"""What the benchmarks without ROS say beside their speeds: facts that do not depend on the machine."""

import json

import pytest

from delta3_pacdrive.cli import bench


def run(capsys, *arguments):
    """Run ``delta3 bench``; return what it prints as JSON."""
    assert bench.main([*arguments, '--json']) == 0
    return json.loads(capsys.readouterr().out)


def test_array_kinematics_come_back_to_where_they_began(capsys):
    result = run(capsys, 'kinematics')
    assert result['round_trip_max_m'] < 2e-15
    assert set(result['poses_per_s']) == {'inverse', 'forward', 'jacobian', 'singularity'}


def test_mujoco_moves_the_same_mechanism_to_the_same_place(capsys):
    pytest.importorskip('mujoco', reason='the second engine, MuJoCo, is not installed')
    result = run(capsys, 'simulate', '--seconds', '1')
    mechanism = result['mechanism']
    assert mechanism['motion_m'] > 5e-3
    # MuJoCo's step is of the first order, and its rods give way a little
    assert mechanism['tcp_apart_m'] < 3e-3 * mechanism['motion_m']
    assert result['tcp_difference_max_m'] < 5e-6
