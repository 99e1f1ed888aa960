"""Tests of a controller with calibrated arms: five parameters of each arm."""

import numpy as np
import pytest

from built_plant import with_only
from delta3_pacdrive import kinematics
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.simulation import run
from delta3_pacdrive.simulation.robot import Robot

CORRECTIONS = {
    'kinematics__upper_arm_correction_m': [3e-4, -2e-4, 1e-4],
    'kinematics__forearm_correction_m': [-4e-4, 3e-4, 2e-4],
    'kinematics__radius_correction_m': [2e-4, 1e-4, -3e-4],
    'kinematics__arm_azimuth_correction_deg': [0.04, -0.05, 0.02],
    'kinematics__arm_angle_correction_deg': [-0.05, 0.03, 0.04],
}
ERRORS = {
    name.replace('kinematics__', 'rich__').replace('correction', 'error'): values
    for name, values in CORRECTIONS.items()
}
SEEN_M = 3e-7  # at the TCP: an increment of each motor, and half of one in the zero point


@pytest.fixture(scope='module')
def program(robot):
    return programs.load('experiment1', robot.motion)


@pytest.fixture(scope='module')
def crooked(robot):
    """Return a robot with deviating arms and otherwise nominal parameters."""
    return with_only(robot, 'geometry', **ERRORS)


def off_m(trace):
    """Return how far the TCP is from where the controller sees it [m], cycle by cycle."""
    return np.linalg.norm(trace['tcp_true'] - trace['tcp_actual'], axis=1)


def test_calibrated_controller_computes_the_true_tcp(crooked, program):
    assert off_m(run(program, crooked)).min() > 1e-4
    knowing = run(program, crooked.replace(**CORRECTIONS))
    assert off_m(knowing).max() < SEEN_M


def test_true_tcp_moves_to_the_programmed_position(crooked, program):
    knowing = run(program, crooked.replace(**CORRECTIONS))
    assert np.linalg.norm(knowing['tcp_true'][-1] - program.start_m) < 2e-6
    assert np.linalg.norm(run(program, crooked)['tcp_true'][-1] - program.start_m) > 1e-4


def test_corrections_are_of_the_controller_and_not_of_the_machine(crooked):
    """The same shafts hold the same arms, independent of the controller's model of them."""
    before, after = Robot(crooked), Robot(crooked.replace(**CORRECTIONS))
    assert before.plant.record['geometry'] == after.plant.record['geometry']
    shaft = np.array(after.plant.shafts()[:3]) - before.plant.shafts()[:3]
    arm = after.plant.arm_angles() - before.plant.arm_angles()
    assert shaft == pytest.approx(crooked.dynamics.gear_ratio * arm, abs=1e-12)


def test_drives_count_from_the_calibrated_zero_point(robot):
    """All values on the bus are an arm angle times the gear ratio (S-0-0177)."""
    zero_deg = [-0.05, 0.03, 0.04]
    calibrated = robot.replace(kinematics__arm_angle_correction_deg=zero_deg)
    machine = Robot(calibrated)
    home = kinematics.inverse(robot.motion.home_m, robot)
    ratio, grid = robot.dynamics.gear_ratio, np.pi / robot.bus.increments_per_rev
    assert machine.encoder_positions() == pytest.approx(ratio * home, abs=2.0 * grid)
    assert machine.plant.shafts()[:3] == pytest.approx(ratio * (home - np.radians(zero_deg)), abs=1e-12)
    assert [float(drive.state['absolute_distance'][0]) for drive in machine.drives] == [
        round(np.radians(angle) * ratio / (2.0 * grid)) for angle in zero_deg
    ]


def test_every_arm_has_its_own_zero_angle(robot):
    for arm in range(3):
        zero_deg = [0.0, 0.0, 0.0]
        zero_deg[arm] = 0.1
        machine = Robot(robot.replace(kinematics__arm_angle_correction_deg=zero_deg))
        turned = [float(drive.state['absolute_distance'][0]) != 0.0 for drive in machine.drives]
        assert turned == [other == arm for other in range(3)]


def test_planning_uses_the_calibrated_arms(robot, program):
    """Longer upper arms turn less for the same way: the motors of the plan are slower."""
    long_arms = robot.replace(kinematics__upper_arm_correction_m=[0.02, 0.02, 0.02])
    speeds = [np.abs(run(program, one)['motor_speed']).max() for one in (robot, long_arms)]
    assert speeds[1] < 0.99 * speeds[0]
