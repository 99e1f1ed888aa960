"""Tests of a pose: closed loops of every solution, distances to limits, and rejections that name a limit."""

import math

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.parameters import PAYLOAD_MAX_KG
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.places.pose import evaluation, figures, report
from reports_read import read_line
from thoroughness import some

CLOSED_M = 1e-9
PLACES = [(0.2, 0.1, -0.85), (0.0, 0.0, -0.75), (0.6, 0.0, -0.95), (-0.3, 0.5, -0.7), (0.7, 0.0, -0.9)]
FIGURES = {'forward_kinematics.png', 'three_spheres.png', 'inverse_kinematics.png', 'eight_solutions.png'}


def closure_m(theta, point, robot):
    """Return by how much the three forearms miss their length, with the equations written out once more."""
    k = robot.kinematics
    worst = 0.0
    for azimuth, angle in zip(k.arm_azimuth_rad, theta, strict=True):
        reach = k.base_radius_m + k.upper_arm_length_m * math.cos(angle) - k.plate_radius_m
        elbow = reach * math.cos(azimuth), reach * math.sin(azimuth), -k.upper_arm_length_m * math.sin(angle)
        worst = max(worst, abs(math.dist(elbow, point) - k.forearm_length_m))
    return worst


@pytest.mark.parametrize('place', PLACES)
def test_all_eight_solutions_close_the_loops_and_differ(place, robot):
    pose = evaluation.of_point(place, robot)
    angles = [one.arm_angle_rad for one in pose.solutions]
    assert len({tuple(np.round(theta, 6)) for theta in angles}) == 8
    for one in pose.solutions:
        assert closure_m(one.arm_angle_rad, place, robot) < CLOSED_M
        assert one.loop_error_m < CLOSED_M
        k = robot.kinematics
        for i, elbow in enumerate(one.elbows):
            # beyond the line from the motor to the joint on the plate, or on this side of it
            azimuth = k.arm_azimuth_rad[i]
            x = place[0] * math.cos(azimuth) + place[1] * math.sin(azimuth) - k.radius_difference_m
            theta = one.arm_angle_rad[i]
            side = math.cos(theta) * -place[2] - math.sin(theta) * x
            assert elbow == ('out' if side > 0.0 else 'in')


@pytest.mark.parametrize('number', range(8))
def test_a_solution_given_as_angles_is_found_again_by_its_number(number, robot):
    point = (0.2, 0.1, -0.85)
    theta = kinematics.inverse_all(point, robot)[number] + 2.0 * math.pi * (number == 3)
    pose = evaluation.of_angles(theta, robot)
    # inward elbows may put the plate above their plane: then the angles belong to the other intersection
    assert closure_m(theta, pose.point_m, robot) < CLOSED_M
    assert pose.number == number or np.linalg.norm(pose.mirror_m - point) < CLOSED_M
    assert pose.is_reachable == (number == 0)
    if pose.number:
        assert 'with the elbow inward' in pose.refusals[-1]
        assert pose.capability is None


def test_both_intersections_of_the_spheres_close_the_loops(robot):
    pose = evaluation.of_point((0.2, 0.1, -0.85), robot)
    assert closure_m(pose.arm_angle_rad, pose.point_m, robot) < CLOSED_M
    assert closure_m(pose.arm_angle_rad, pose.mirror_m, robot) < CLOSED_M
    assert pose.mirror_m[2] > pose.point_m[2]


def test_distance_to_a_limit_is_the_remaining_travel(robot):
    pose = evaluation.of_point((0.2, 0.1, -0.85), robot)
    margins = {(margin.key, margin.arm): margin for margin in pose.margins}
    rim, top, bottom = (margins[key, None].distance for key in ('radius', 'top', 'bottom'))
    outward = np.array([0.2, 0.1, 0.0]) / math.hypot(0.2, 0.1)
    for direction, distance in ((outward, rim), ((0, 0, 1), top), ((0, 0, -1), bottom)):
        way = np.multiply(direction, distance)
        assert evaluation.of_point(pose.point_m + 0.999 * way, robot).is_reachable
        beyond = evaluation.of_point(pose.point_m + 1.001 * way, robot)
        assert len(beyond.refusals) == 1
    for arm in (1, 2, 3):
        low, high = margins['arm_angle_min', arm].distance, margins['arm_angle_max', arm].distance
        assert low + high == pytest.approx(140.0)
        assert low == pytest.approx(math.degrees(pose.arm_angle_rad[arm - 1]) + 45.0)


BEYOND = {
    (0.7, 0.0, -0.9): 'the distance from the z axis is 0.7 m, the limit is 0.6 m',
    (0.0, 0.0, -0.6): 'z is -0.6 m, the limit is -0.7 m',
    (0.0, 0.0, -1.0): 'z is -1 m, the limit is -0.95 m',
    (1.5, 0.0, -0.8): 'the point is out of reach of arms 1, 2 and 3',
    (1.2, 0.0, -0.8): 'the point is out of reach of arms 2 and 3',
}


@pytest.mark.parametrize('place', BEYOND)
def test_forbidden_position_is_reported_with_its_limit(place, robot):
    pose = evaluation.of_point(place, robot)
    assert not pose.is_reachable
    assert pose.refusals[0] == BEYOND[place]
    assert report.document(pose, robot)['error'].startswith(BEYOND[place])


def test_angles_beyond_limits_or_without_a_pose_are_reported(robot):
    steep = evaluation.of_angles(np.radians([100.0, 0.0, 0.0]), robot)
    assert 'the angle of arm 1 is 100 deg, the limit is 95 deg' in steep.refusals
    apart = evaluation.of_angles(np.radians([0.0, 170.0, 0.0]), robot)
    assert apart.point_m is None
    assert apart.refusals == ('the forearms do not meet at arm angles (0.000, 170.000, 0.000) deg',)


def test_holding_torques_and_currents_are_those_of_the_dynamics_with_the_payload(robot):
    for payload_kg in (0.0, 0.5, 4.0):
        loaded = robot.replace(dynamics__payload_mass_kg=payload_kg)
        pose = evaluation.of_point((0.2, 0.1, -0.85), loaded)
        found = report.document(pose, loaded)
        torque = dynamics.gravity(kinematics.inverse([0.2, 0.1, -0.85], loaded), loaded)
        assert found['payload_kg'] == payload_kg
        np.testing.assert_allclose(found['holding_torque_n_m'], torque)
        np.testing.assert_allclose(found['holding_motor_torque_n_m'], torque / 32.0)
        np.testing.assert_allclose(found['holding_current_a'], torque / 32.0 / 0.78)


def test_the_jacobian_of_a_pose_has_its_determinant_and_condition(robot):
    found = report.document(evaluation.of_point((0.2, 0.1, -0.85), robot), robot)
    jacobian = np.array(found['jacobian_m_rad'])
    assert found['condition'] == pytest.approx(np.linalg.cond(jacobian))
    assert found['determinant_m3_rad3'] == pytest.approx(np.linalg.det(jacobian))
    # a small turn of the arms moves the plate so
    theta, turn = np.array(found['arm_angles_rad']), np.array([1e-6, -2e-6, 5e-7])
    moved = kinematics.forward(theta + turn, robot) - kinematics.forward(theta - turn, robot)
    np.testing.assert_allclose(moved / 2.0, jacobian @ turn, atol=1e-13)


def test_users_read_millimetres_degrees_and_violations(robot):
    lines = report.text(evaluation.of_point((0.2, 0.1, -0.85), robot), robot)
    rows = dict(line.strip().split('  ', 1) for line in lines if line[14:16] == '  ' and line[:14].strip())
    assert rows['TCP'] == '(200.000, 100.000, -850.000) mm'
    assert rows['arm angles'] == '-3.997 / 15.563 / 30.134 deg'
    assert rows['reachable'] == 'yes'
    assert rows['workspace'] == '376.4 mm to the rim (600 mm)'
    assert sum('beyond the limits of the arms' in line for line in lines) == 7
    none = report.text(evaluation.of_point((1.6, 0.0, -0.8), robot), robot)
    assert none[-1].split() == ['solutions', 'none']


def test_users_read_holding_currents_and_torques_as_shares_of_motor_and_brake(robot):
    pose = evaluation.of_point((0.2, 0.1, -0.85), robot)
    lines = [' '.join(line.split()) for line in report.text(pose, robot)]
    currents, torques = np.abs(pose.holding_current_a), np.abs(pose.holding_torque_n_m) / 32.0
    read_line(lines, '% of the nominal current', [*(100.0 * currents / 4.1), 4.1])
    brake = robot.motor.brake_torque_n_m
    read_line(lines, '% of the brake torque', [*(100.0 * torques / brake), brake])


def test_users_read_every_reason_for_a_rejected_pose(robot):
    pose = evaluation.of_point((0.75, 0.0, -0.6), robot)
    assert len(pose.refusals) >= 3
    lines = report.text(pose, robot)
    (first,) = (n for n, line in enumerate(lines) if line.split()[:1] == ['reachable'])
    assert lines[first].split(None, 1)[1] == f'no: {pose.refusals[0]}'
    assert [line.strip() for line in lines[first + 1 : first + len(pose.refusals)]] == list(pose.refusals[1:])


@pytest.mark.parametrize('end', ['min', 'max'])
def test_an_arm_at_exactly_its_limit_is_within_it_and_beyond_it_is_not(end, robot):
    point = (0.2, 0.1, -0.85)
    angle = float(getattr(np.degrees(evaluation.of_point(point, robot).arm_angle_rad), end)())
    legal = []
    for limit in (
        angle,
        np.nextafter(angle, 0.0 if (angle < 0.0) == (end == 'min') else np.inf * np.sign(angle)),
    ):
        at = robot.replace(**{f'kinematics__arm_angle_{end}_deg': float(limit)})
        legal.append(evaluation.of_point(point, at).solutions[0].is_legal)
    assert legal == [True, False]


@pytest.mark.parametrize(('largest_deg', 'works'), [(80.0, True), (10.0, False)])
def test_the_figure_of_the_solutions_names_the_one_in_which_the_robot_works(largest_deg, works, robot):
    pose = evaluation.of_point((0.2, 0.1, -0.85), robot.replace(kinematics__arm_angle_max_deg=largest_deg))
    drawn = [[text.get_text() for text in axes.texts] for axes in figures.eight_solutions(pose, robot).axes]
    for one, (elbows, told) in zip(pose.solutions, drawn, strict=True):
        assert elbows == ', '.join(one.elbows)
        angles, _, words = told.partition(': ')
        assert angles == ', '.join(f'{angle:z.0f}°' for angle in np.degrees(one.arm_angle_rad))
        expected = "within the arms' limits" if one.is_legal else "beyond the arms' limits"
        assert words == ('the robot works here' if one.number == 0 and works else expected)


def test_each_arm_has_both_elbows_in_the_figure_of_the_inverse_kinematics(robot):
    pose = evaluation.of_point((0.2, 0.1, -0.85), robot)
    panels = [axes for axes in figures.inverse_kinematics(pose, robot).axes if axes.get_xlabel()]
    k = robot.kinematics
    for i, axes in enumerate(panels):
        for label, number in (('elbow outward', 0), ('elbow inward', 7)):
            (line,) = (line for line in axes.get_lines() if line.get_label() == label)
            angle = pose.solutions[number].arm_angle_rad[i]
            bend = 1e3 * np.array(
                [
                    k.base_radius_m + k.upper_arm_length_m * math.cos(angle),
                    -k.upper_arm_length_m * math.sin(angle),
                ]
            )
            assert line.get_xydata()[-1] == pytest.approx(bend)


@pytest.mark.parametrize('number', some(range(3), [0]))
def test_figures_4_3_to_4_6_are_drawn_for_every_pose_that_there_is(number, robot, tmp_path):
    folder = ReportFolder(tmp_path, Provenance.of('test'))
    paths = folder.figures(figures.by_name(evaluation.of_point(PLACES[number], robot), robot))
    assert {path.name for path in paths} == FIGURES
    assert all(path.read_bytes().startswith(b'\x89PNG') for path in paths)


def test_no_figure_is_drawn_of_a_pose_that_there_is_not(robot):
    assert figures.by_name(evaluation.of_point((1.6, 0.0, -0.8), robot), robot) == {}


def test_payload_is_within_the_limit_and_other_load_is_named(robot):
    found = evaluation.of_point((0.0, 0.0, -0.8), robot)
    told = report.document(found, robot)
    assert told['payload_max_kg'] == PAYLOAD_MAX_KG < told['payload_held_kg']
    assert told['payload_peak_kg'] == pytest.approx(float(found.capability.payload_peak_kg))
    lines = [line.strip() for line in report.text(found, robot)]
    at = lines.index('payload  10.0 kg, the limit of the robot is 10 kg')
    held, peak = told['payload_held_kg'], told['payload_peak_kg']
    assert lines[at + 1] == (
        f'nominal current and brakes hold {held:.1f} kg at rest, peak torque accelerates {peak:.1f} kg with 15 m/s2'
    )
