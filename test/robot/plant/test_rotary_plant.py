"""Tests of the machine of the rotary axis: motor, brake, gear, bar and tool."""

import math

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.robot.plant.rotary_plant import RotaryPlant

STEPS = 16  # of current in an exchange period
STEP = 1e-4  # relative: a midpoint step against a closed form
FREE = {'viscous_friction_n_m_s_rad': 0.0, 'static_friction_n_m': 0.0}


def with_axis(robot, **values):
    """Return a robot with a rotary axis of these values."""
    return robot.replace(rotary__present=True, **{f'rotary__{name}': value for name, value in values.items()})


def with_bar_that_gives(robot, **values):
    """Return a robot with an elastic bar and otherwise nominal parameters."""
    effects = dict.fromkeys(('forearm_rods', 'friction', 'ripple', 'sensors', 'geometry'), False)
    rich = {'enabled': True, **effects}
    bus = {'bus__exchange_period_s': 125e-6}
    return with_axis(robot.replace(**{f'rich__{k}': v for k, v in rich.items()}, **bus), **values)


def released(robot, speed_rad_s=0.0, payload_kg=0.0):
    """Return an axis with open brake, and motor shaft and tool at a common speed."""
    axis = RotaryPlant(robot, 0)
    steps = math.ceil(robot.motor.brake_release_s / robot.drive.current_period_s) + 1
    axis.advance(np.zeros((steps, 4)), True, payload_kg)
    axis.state['rate'] = speed_rad_s
    axis.state['turning'] = speed_rad_s / robot.rotary.gear_ratio
    return axis


def run(axis, seconds, current_a=0.0, payload_kg=0.0, step_s=62.5e-6):
    axis.advance(np.full((round(seconds / step_s), 4), current_a), True, payload_kg)


def energy_j(axis, robot):
    """Kinetic energy of rotor and tool."""
    state = axis.state[0]
    rotor = robot.rotary.rotor_inertia_kg_m2
    return 0.5 * rotor * state['rate'] ** 2 + 0.5 * state['inertia'] * state['turning'] ** 2


def test_the_axis_runs_down_exponentially_against_viscous_friction(robot):
    machine = with_axis(robot, static_friction_n_m=0.0, viscous_friction_n_m_s_rad=1e-3)
    axis = released(machine, 100.0)
    run(axis, 0.1)
    inertia = machine.rotary.shaft_inertia_kg_m2(0.0)
    assert axis.shaft()[1] == pytest.approx(100.0 * math.exp(-1e-3 * 0.1 / inertia), rel=STEP)


def test_axis_coasts_against_coulomb_friction_as_in_its_closed_form(robot):
    """I w' = -F_s tanh(w / w_s) is solved by sinh(w / w_s) = sinh(w0 / w_s) exp(-F_s t / (I w_s))."""
    machine = with_axis(robot, static_friction_n_m=0.05, viscous_friction_n_m_s_rad=0.0)
    inertia, smooth = machine.rotary.shaft_inertia_kg_m2(0.0), machine.motor.friction_smoothing_rad_s
    axis = released(machine, 10.0)
    seconds = (
        10.0 * inertia / 0.05 + 0.5 * inertia * smooth / 0.05
    )  # a straight fall, and a little of the end
    run(axis, seconds)
    after = round(seconds / 62.5e-6) * 62.5e-6
    expected = smooth * math.asinh(math.sinh(10.0 / smooth) * math.exp(-0.05 * after / (inertia * smooth)))
    assert axis.shaft()[1] == pytest.approx(expected, rel=1e-2)
    assert 0.0 < axis.shaft()[1] < smooth


def test_a_current_accelerates_rotor_tool_and_part_together(robot):
    machine = with_axis(robot, **FREE)
    axis, payload = released(machine), 2.0
    run(axis, 62.5e-6, 3.0, payload)  # its current has risen
    before = axis.shaft()[1]
    run(axis, 0.01, 3.0, payload)
    rotary = machine.rotary
    inertia = rotary.rotor_inertia_kg_m2 + (
        rotary.tool_inertia_kg_m2 + payload * rotary.part_gyration_radius_m**2
    ) / (rotary.gear_ratio**2)
    assert axis.shaft()[1] - before == pytest.approx(rotary.torque_constant_n_m_a * 3.0 * 0.01 / inertia)
    assert axis.angle_rad == axis.shaft()[0] / rotary.gear_ratio


def test_coupling_torque_is_the_load_outside_the_model_of_the_drive(robot):
    machine = with_axis(robot, **FREE)
    axis = released(machine)
    run(axis, 0.01, 2.0, payload_kg=2.0)
    known = machine.rotary.shaft_inertia_kg_m2(machine.dynamics.payload_mass_kg)
    acceleration = axis.state['acceleration'][0]
    expected = machine.rotary.torque_constant_n_m_a * 2.0 - known * acceleration
    assert axis.shaft()[2] == pytest.approx(expected, rel=1e-9)
    assert expected > 0.01  # a heavier part is felt


def test_a_bar_that_gives_neither_makes_nor_loses_energy(robot):
    machine = with_bar_that_gives(robot, backlash_deg=0.0, bar_damping_n_m_s_rad=0.0, **FREE)
    axis = released(machine, 50.0)
    axis.state['turning'] = 0.0  # the rotor alone has been struck
    state, stiffness = axis.state[0], machine.rotary.bar_stiffness_n_m_rad
    start = energy_j(axis, machine)
    for _ in range(200):
        run(axis, 1e-3)
        twist = state['shaft'] / machine.rotary.gear_ratio - state['angle']
        whole = energy_j(axis, machine) + 0.5 * stiffness * twist**2
        assert whole == pytest.approx(start, rel=2e-3)  # (w h)^2 of the stiffest swing, over 200 ms
    momentum = machine.rotary.rotor_inertia_kg_m2 * machine.rotary.gear_ratio * state['rate']
    momentum += state['inertia'] * state['turning']
    assert momentum == pytest.approx(machine.rotary.rotor_inertia_kg_m2 * machine.rotary.gear_ratio * 50.0)


def test_rotor_and_tool_swing_at_the_frequency_of_two_masses(robot):
    machine = with_bar_that_gives(robot, backlash_deg=0.0, bar_damping_n_m_s_rad=0.0, **FREE)
    rotary = machine.rotary
    axis = released(machine, 1.0)
    axis.state['turning'] = 0.0
    rotor = rotary.rotor_inertia_kg_m2 * rotary.gear_ratio**2
    period = math.tau / math.sqrt(rotary.bar_stiffness_n_m_rad * (1 / rotor + 1 / rotary.tool_inertia_kg_m2))
    twists = []
    for _ in range(2000):
        run(axis, 62.5e-6)
        twists.append(axis.state['shaft'][0] / rotary.gear_ratio - axis.angle_rad)
    twists = np.array(twists)
    before = np.flatnonzero((twists[:-1] < 0.0) & (twists[1:] >= 0.0))
    rises = before + twists[before] / (twists[before] - twists[before + 1])
    assert np.diff(rises).mean() * 62.5e-6 == pytest.approx(period, rel=2e-3)


def test_tool_lags_by_the_lost_motion_when_the_motor_reverses(robot):
    lost = 0.5
    damped = {
        'bar_stiffness_n_m_rad': 1e4,
        'bar_damping_n_m_s_rad': 3.0,
    }  # so that it does not bounce for long
    machine = with_bar_that_gives(robot, backlash_deg=lost, static_friction_n_m=0.0, **damped)
    axis = released(machine)

    def lead_deg(current_a):
        """Angle by which the motor is ahead of the tool once it has pushed it for a while."""
        axis.state['rate'] = axis.state['turning'] = 0.0
        run(axis, 0.05, current_a)
        return math.degrees(axis.state['shaft'][0] / machine.rotary.gear_ratio - axis.angle_rad)

    forwards, backwards = lead_deg(0.2), lead_deg(-0.2)
    assert forwards - backwards == pytest.approx(lost, abs=0.02)  # and what the bar gives under its torque
    assert forwards == pytest.approx(-backwards, abs=0.02)


def test_an_applied_brake_holds_the_axis_up_to_its_torque(robot):
    machine = with_axis(robot, **FREE)
    holds = machine.rotary.brake_torque_n_m / machine.rotary.torque_constant_n_m_a
    for current, moves in ((0.99 * holds, False), (1.01 * holds, True)):
        axis = RotaryPlant(machine, 0)
        axis.advance(np.full((STEPS, 4), current), False, 0.0)
        assert (axis.shaft()[1] != 0.0) == moves


def test_a_brake_stops_the_axis_after_its_time(robot):
    machine = with_axis(robot, **FREE)
    axis = released(machine, 50.0)
    delay = machine.motor.brake_apply_s
    axis.advance(np.zeros((round(delay / 62.5e-6) - 1, 4)), False, 0.0)
    assert axis.shaft()[1] == 50.0
    falls = 50.0 * machine.rotary.shaft_inertia_kg_m2(0.0) / machine.rotary.brake_torque_n_m
    axis.advance(np.zeros((math.ceil(falls / 62.5e-6) + 3, 4)), False, 0.0)
    assert axis.shaft()[1] == 0.0
    assert axis.state['brake_locked'][0] == 1


def test_axis_is_at_its_home(robot):
    machine = with_axis(robot, home_deg=30.0)
    axis = RotaryPlant(machine, 0)
    assert axis.angle_rad == pytest.approx(math.radians(30.0), rel=1e-12)
    assert axis.shaft()[0] == axis.angle_rad * machine.rotary.gear_ratio


def test_only_a_built_robot_has_a_bar_that_gives(robot):
    rich = parameters.load('rich').replace(rotary__present=True)
    assert RotaryPlant(rich, 0).record['constants']['elastic'][0] == 1
    assert RotaryPlant(with_axis(robot), 0).record['constants']['elastic'][0] == 0
