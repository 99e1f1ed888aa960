"""Tests of decoupled arms (Fig. 4.9, 8.4): three linear motors, and the coupling torque d as their input."""

import json

import numpy as np
import pytest

from delta3_pacdrive import dynamics, parameters, simulation
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.parameters import DECOUPLED
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.robot.plant import decoupled
from delta3_pacdrive.robot.plant.plant import Plant

GEAR, STEPS = 32.0, 16
NEAR_M = 1e-5  # of a TCP: d is 62.5 us old


@pytest.fixture(scope='module')
def loose(robot):
    return robot.replace(dynamics__arm_coupling=DECOUPLED)


def test_the_motion_is_that_of_the_exact_plant_but_for_a_step_of_d(robot, loose, short_program):
    exact, other = (simulation.run(short_program, one) for one in (robot, loose))
    apart = np.linalg.norm(exact['tcp_true'] - other['tcp_true'], axis=1).max()
    assert 0.0 < apart < NEAR_M
    torque = np.abs(exact['coupling_torque'] - other['coupling_torque']).max()
    assert 0.0 < torque < 0.1


def test_shorter_steps_bring_it_nearer(robot, short_program):
    def apart(period_s):
        runs = [
            simulation.run(
                short_program,
                robot.replace(drive__current_period_s=period_s, dynamics__arm_coupling=coupling),
            )['tcp_true']
            for coupling in ('exact', DECOUPLED)
        ]
        return np.linalg.norm(runs[0] - runs[1], axis=1).max()

    assert apart(31.25e-6) < 0.65 * apart(62.5e-6)


def test_held_by_its_brakes_d_is_the_weight_of_the_arms(robot, loose):
    plant = Plant(loose)
    plant.advance(np.zeros((STEPS, 3)), [False] * 3)
    weight = dynamics.gravity(plant.arm_angles(), robot)
    np.testing.assert_allclose(plant.shafts()[6:], weight / GEAR, rtol=1e-12)


def test_each_current_moves_its_own_shaft_alone_in_the_first_step(loose):
    """The other arms feel it a step later, through d."""
    plants = [Plant(loose) for _ in range(2)]
    for plant in plants:
        plant.state['brake_released'], plant.state['brake_locked'] = 1, 0
        plant.advance(np.zeros((1, 3)), [True] * 3)
    for plant, current in zip(plants, (0.0, 2.0), strict=True):
        plant.advance(np.array([[current, 0.0, 0.0]]), [True] * 3)
    speeds = np.subtract(plants[1].shafts()[3:6], plants[0].shafts()[3:6])
    assert speeds[0] > 1e-3
    assert speeds[1:].tolist() == [0.0, 0.0]
    for plant in plants:
        plant.advance(np.zeros((1, 3)), [True] * 3)
    assert np.abs(np.subtract(plants[1].shafts()[4:6], plants[0].shafts()[4:6])).min() > 0.0


@pytest.mark.parametrize('effect', ['gear', 'friction', 'ripple'])
def test_built_robots_have_no_linear_part(effect):
    others = {f'rich__{name}': name == effect for name in ('gear', 'friction', 'ripple')}
    with pytest.raises(ParameterError, match=rf'dynamics.arm_coupling is decoupled, .* rich.{effect} '):
        parameters.load('rich').replace(dynamics__arm_coupling=DECOUPLED, **others)


def test_a_payload_that_makes_the_loop_unstable_is_rejected(loose):
    with pytest.raises(ParameterError, match=r'payload of 2 kg the mass matrix reaches 2\.7'):
        Plant(loose.replace(dynamics__payload_mass_kg=2.0))
    decoupled.require_stable(loose, 0.5)


def test_payload_gripped_during_motion_is_checked_as_well(loose):
    grip = {'output': {'name': 'gripper', 'value': True, 'payload_kg': 2.0}}
    program = programs.parse({'moves': [{'move_l': {'to_m': [0.0, 0.0, -0.8]}}, grip]}, loose.motion)
    with pytest.raises(ParameterError, match='payload of 2 kg'):
        simulation.run(program, loose)


def test_the_largest_inertia_is_that_of_the_mass_matrix_somewhere(robot):
    assert 1.55 < decoupled.largest_inertia_kg_m2(robot, 0.5) < 1.7
    assert decoupled.largest_inertia_kg_m2(robot, 0.0) < decoupled.largest_inertia_kg_m2(robot, 1.0)


def test_simulate_reports_the_difference_from_the_exact_plant(loose, tmp_path, capsys):
    path = parameters.write(loose, tmp_path / 'loose.yaml')
    assert main(['simulate', 'experiment1', '--parameters', str(path), '--json']) == 0
    apart = json.loads(capsys.readouterr().out)['from_exact']
    assert 0.0 < apart['tcp_rms_m'] < apart['tcp_max_m'] < NEAR_M
    assert main(['simulate', 'experiment1', '--parameters', str(path)]) == 0
    assert 'from exact' in capsys.readouterr().out
