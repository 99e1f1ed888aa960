"""Tests of the parameters of the rotary axes: rules, the values of their drives, and a second axis."""

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.errors import ParameterError


@pytest.mark.parametrize(
    ('changes', 'sentence'),
    [
        (
            {'angle_min_deg': 90.0, 'angle_max_deg': 90.0, 'home_deg': 90.0},
            'rotary.angle_min_deg is 90, but must be less than rotary.angle_max_deg (90)',
        ),
        (
            {'home_deg': 361.0},
            'rotary.home_deg is 361, but must lie between rotary.angle_min_deg (-360) and '
            'rotary.angle_max_deg (360)',
        ),
        (
            {'gear_ratio': 20.0},
            'rotary.speed_max_deg_s is 2400, but its motor permits 1800 deg/s at most '
            '(rotary.max_speed_rpm over rotary.gear_ratio)',
        ),
        (
            {'nominal_current_a': 7.0},
            'rotary.nominal_current_a is 7, but must not exceed rotary.peak_current_a (6.5)',
        ),
        (
            {'static_friction_n_m': 4.0},
            'rotary.static_friction_n_m is 4, but its motor has only 3.9 N m at its peak current',
        ),
    ],
)
def test_contradictory_values_of_a_rotary_axis_are_rejected_if_it_is_present(changes, sentence, robot):
    changes = {f'rotary__{name}': value for name, value in changes.items()}
    assert not robot.replace(**changes).rotary.present
    with pytest.raises(ParameterError) as refused:
        robot.replace(rotary__present=True, **changes)
    assert sentence in str(refused.value)


def test_the_drive_of_the_rotary_axis_has_its_own_motor_gear_and_loops_in_their_places(robot):
    machine = robot.replace(
        rotary__present=True, rotary__angle_min_deg=-10.0, drive__notch_1_frequency_hz=200.0
    )
    axis, rotary = parameters.rotary_axis_parameters(machine, 0), machine.rotary
    for name in ('peak_current_a', 'torque_constant_n_m_a', 'winding_resistance_ohm', 'brake_torque_n_m'):
        assert getattr(axis.motor, name) == getattr(rotary, name) != getattr(machine.motor, name)
    assert axis.dynamics.gear_ratio == rotary.gear_ratio
    assert axis.dynamics.end_stop_min_deg < rotary.angle_min_deg
    assert axis.drive.velocity_gain_a_s_rad == rotary.velocity_gain_a_s_rad
    assert axis.drive.notch_1_frequency_hz == 0.0
    assert axis.drive.feedforward_inertia_kg_m2 == rotary.shaft_inertia_kg_m2(
        machine.dynamics.payload_mass_kg
    )
    assert axis.rich.sensor_seed != machine.rich.sensor_seed


def test_a_second_rotary_axis_has_its_own_values_and_is_listed_only_if_present(robot, tmp_path):
    assert robot.axes == ('axis1', 'axis2', 'axis3')
    assert robot.rotary_axes == ()
    one = robot.replace(rotary__present=True)
    assert one.axes == (*robot.axes, 'axis4')
    assert one.rotary_axes == (one.rotary,)
    two = one.replace(rotary_2__present=True, rotary_2__gear_ratio=5.0)
    assert two.axes == (*one.axes, 'axis5')
    assert two.rotary_axes == (two.rotary, two.rotary_2)
    ratios = [parameters.rotary_axis_parameters(two, number).dynamics.gear_ratio for number in range(2)]
    assert ratios == [10.0, 5.0]
    assert two.kind == 'rotary+rotary_2'
    assert not any(name.startswith('rotary_2.') for name in parameters.flatten(one))
    assert 'rotary_2' not in parameters.write(one, tmp_path / 'one.yaml').read_text(encoding='utf-8')
    assert parameters.load(parameters.write(two, tmp_path / 'two.yaml')) == two
    with pytest.raises(ParameterError, match=r'rotary_2\.present is true, but the robot has no first'):
        robot.replace(rotary_2__present=True)
    with pytest.raises(ParameterError, match=r'rotary_2\.angle_max_deg \(360\)'):
        two.replace(rotary_2__home_deg=361.0)
