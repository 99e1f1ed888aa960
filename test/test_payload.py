"""Tests of the payload: one limit for every source, equal to the capacity of the robot."""

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics, parameters
from delta3_pacdrive.errors import ParameterError, ProgramError, TelegramError, TuningError
from delta3_pacdrive.parameters import PAYLOAD_MAX_KG
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.paths.move import Move
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.robot.sercos import telegrams, words
from delta3_pacdrive.studies.drives.tuning.run import robot_of
from delta3_pacdrive.studies.drives.tuning.study import Settings

TOO_HEAVY_KG = PAYLOAD_MAX_KG + 1e-3
RESERVE = 2.0  # of what is held at rest, over the limit


def held_kg(torque_n_m, robot):
    """Payload that a motor torque holds at rest in the whole workspace, friction not counted on."""
    radius = robot.kinematics.workspace_diameter_m / 2.0
    x, y, z = np.meshgrid(*(np.linspace(-radius, radius, 41),) * 2, np.linspace(-0.95, -0.70, 11))
    inside = np.hypot(x, y) <= radius
    theta = kinematics.inverse(np.stack([x[inside], y[inside], z[inside]], axis=-1), robot.kinematics)
    empty, loaded = (
        dynamics.gravity(theta, robot.replace(dynamics__payload_mass_kg=kg)) for kg in (0.0, 1.0)
    )
    limit = torque_n_m * robot.dynamics.gear_ratio
    heaviest = (np.sign(loaded - empty) * limit - empty) / (loaded - empty)
    return float(heaviest.min())


def test_limit_is_half_of_the_capacity_of_brakes_and_nominal_currents(robot):
    by_motors = held_kg(robot.motor.nominal_current_a * robot.motor.torque_constant_n_m_a, robot)
    by_brakes = held_kg(robot.motor.brake_torque_n_m, robot)
    assert (by_brakes, by_motors) == pytest.approx(
        (21.0, 22.6), abs=0.1
    )  # as configuration and documentation say
    assert 0.9 * by_brakes < RESERVE * PAYLOAD_MAX_KG <= by_brakes


def program_of(kg, where):
    output = {
        'output': {'name': 'gripper', 'value': True, **({'payload_kg': kg} if where == 'output' else {})}
    }
    return {
        'start_m': [0.0, 0.0, -0.75],
        **({'payload_kg': kg} if where == 'program' else {}),
        'moves': [{'move_l': {'to_m': [0.0, 0.0, -0.8]}}, output],
    }


@pytest.mark.parametrize('where', ['program', 'output'])
def test_programs_carry_up_to_the_limit(where, robot):
    assert programs.parse(program_of(PAYLOAD_MAX_KG, where), robot.motion)
    with pytest.raises(ProgramError, match='between 0 and 10'):
        programs.parse(program_of(TOO_HEAVY_KG, where), robot.motion)


def test_parameters_carry_up_to_the_limit(robot):
    assert robot.replace(dynamics__payload_mass_kg=PAYLOAD_MAX_KG)
    with pytest.raises(ParameterError, match=r'payload_mass_kg is 10\.001, but must be between 0 and 10'):
        robot.replace(dynamics__payload_mass_kg=TOO_HEAVY_KG)


def test_a_tuning_carries_up_to_the_limit():
    assert robot_of(Settings(payload_kg=PAYLOAD_MAX_KG)).dynamics.payload_mass_kg == PAYLOAD_MAX_KG
    with pytest.raises(TuningError, match='between 0 and 10 kg'):
        robot_of(Settings(payload_kg=TOO_HEAVY_KG))


@pytest.mark.parametrize('where', ['program', 'output'])
def test_plans_carry_up_to_the_limit(where, robot):
    document = program_of(PAYLOAD_MAX_KG, where)
    plan = program_planner.plan(
        programs.parse(document, robot.motion), np.array(document['start_m']), robot
    ).plan
    row = plan.moves[0].to_array(0, 1)
    assert Move.from_array(row)
    (places,) = np.nonzero(row == PAYLOAD_MAX_KG)
    for wrong in (TOO_HEAVY_KG, -0.5, 999.0):
        for place in places:
            changed = row.copy()
            changed[place] = wrong
            with pytest.raises(ProgramError, match=r'payload|header'):
                Move.from_array(changed)


def test_telegrams_carry_up_to_the_limit():
    assert words.PAYLOAD_MAX_KG == parameters.PAYLOAD_MAX_KG
    session = b'3fa9'
    for kg in (0.0, PAYLOAD_MAX_KG):
        assert telegrams.parse_current_frame(telegrams.current_frame(True, kg, session), session)[1] == kg
    with pytest.raises(TelegramError):
        telegrams.parse_current_frame(telegrams.current_frame(True, TOO_HEAVY_KG, session), session)
