"""Tests of the names in ``import delta3_pacdrive``: sufficient, documented, and without ROS."""

import inspect
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

import delta3_pacdrive as d3
from delta3_pacdrive.errors import ProgramError, TraceError, UnreachableError
from delta3_pacdrive.robot.faults.fault import KINDS

FUNCTIONS = [
    d3.load_parameters,
    d3.load_program,
    d3.load_trace,
    d3.simulate,
    d3.kinematics.inverse,
    d3.kinematics.forward,
]
FAR = [[0.0, 0.0, -0.8], [0.75, 0.0, -1.0], [0.1, 0.1, -0.85]]  # the second one is out of reach of one arm


def test_all_documented_names_exist():
    assert sorted(d3.__all__) == dir(d3)
    assert all(getattr(d3, name) is not None for name in d3.__all__)
    assert d3.__version__ == metadata.version('delta3_pacdrive')
    with pytest.raises(AttributeError, match='has no attribute'):
        _ = d3.nobody


def test_import_loads_no_heavy_packages(tmp_path):
    program = 'import sys, delta3_pacdrive; print(*sys.modules)'
    command = [sys.executable, '-P', '-c', program]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert not {'numpy', 'numba', 'scipy', 'rclpy', 'yaml'}.intersection(done.stdout.split())


def test_a_program_is_simulated_by_its_name_or_as_it_was_read():
    robot = d3.load_parameters()
    by_name, read = d3.simulate('experiment1'), d3.simulate(d3.load_program('experiment1', robot), robot)
    np.testing.assert_array_equal(by_name['tcp_error'], read['tcp_error'])
    assert isinstance(by_name, d3.Trace)


def test_requested_signals_are_added_and_unknown_ones_rejected():
    trace = d3.simulate('experiment3', signals=['payload', 'tcp_sp*', 'drive_voltage'])
    assert {'current', 'payload', 'tcp_speed', 'drive_voltage'} <= trace.signals.keys()
    speed = np.linalg.norm(trace['tcp_velocity'], axis=1)
    np.testing.assert_array_equal(trace['tcp_speed'][:, 0], speed)
    with pytest.raises(TraceError, match="there is no signal 'drive_votage': did you mean drive_voltage"):
        d3.simulate('experiment3', signals=['drive_votage'])


def test_a_program_may_be_written_in_python_and_is_checked_as_a_file_is():
    robot = d3.load_parameters()
    there = d3.load_program({'moves': [{'move_l': {'to_m': [0.1, 0.0, -0.75]}}]}, robot)
    end = d3.simulate(there, robot).meta['figures']['final_tcp_m']
    assert end == pytest.approx([0.1, 0.0, -0.75], abs=1e-4)
    with pytest.raises(ProgramError, match=r'moves\[0\]'):
        d3.load_program({'moves': [{'move_l': {'to': [0.1, 0.0, -0.75]}}]}, robot)


def test_a_trace_is_read_back_as_it_was_written(tmp_path):
    trace = d3.simulate('experiment1')
    trace.save(tmp_path / 'run.npz')
    again = d3.load_trace(tmp_path / 'run.npz')
    np.testing.assert_array_equal(again['current'], trace['current'])
    with pytest.raises(TraceError, match='there is no recording'):
        d3.load_trace(tmp_path / 'absent.npz')


@pytest.mark.parametrize(
    'function', FUNCTIONS, ids=lambda function: f'{function.__module__}.{function.__name__}'
)
def test_every_argument_is_documented_with_returns_and_raises(function):
    text = inspect.getdoc(function)
    for name in inspect.signature(function).parameters:
        assert f'\n{name}\n    ' in text, f'{name} is not described'
    assert all(f'\n{section}\n---' in text for section in ('Parameters', 'Returns', 'Raises'))


def test_kinematics_take_the_robot_or_its_lengths():
    robot = d3.load_parameters()
    theta = d3.kinematics.inverse([0.1, 0.0, -0.8], robot)
    np.testing.assert_array_equal(theta, d3.kinematics.inverse([0.1, 0.0, -0.8], robot.kinematics))
    point = d3.kinematics.forward(theta, robot)
    np.testing.assert_array_equal(point, d3.kinematics.forward(theta, robot.kinematics))


def test_unreachable_positions_are_nan_on_request():
    robot = d3.load_parameters()
    with pytest.raises(UnreachableError, match='position 1'):
        d3.kinematics.inverse(FAR, robot)
    theta = d3.kinematics.inverse(FAR, robot, unreachable='nan')
    assert np.isnan(theta).all(axis=1).tolist() == [False, True, False]
    points = d3.kinematics.forward(theta, robot, unreachable='nan')
    assert np.isnan(points).all(axis=1).tolist() == [False, True, False]
    np.testing.assert_allclose(points[[0, 2]], np.array(FAR)[[0, 2]], atol=1e-12)
    with pytest.raises(ValueError, match='must be "raise" or "nan"'):
        d3.kinematics.inverse(FAR, robot, unreachable='zero')


def test_readme_states_the_number_of_kinds_of_faults():
    text = (Path(__file__).parents[1] / 'README.md').read_text(encoding='utf-8')
    assert f'**Faults:** {len(KINDS.keys() - {"clear"})} kinds' in text
