"""Tests of the markers of the robot: error line, long paths, and missing positions."""

import math

import numpy as np
import pytest
from visualization_msgs.msg import Marker

from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.ros.robot_markers import POINTS_MAX, RobotMarkers

ROBOT = parameters.load()
HOME = np.array(ROBOT.motion.home_m)
MAGNIFICATION = 250.0


@pytest.fixture
def markers() -> RobotMarkers:
    return RobotMarkers(ROBOT, MAGNIFICATION)


def places(line: Marker) -> np.ndarray:
    return np.array([[point.x, point.y, point.z] for point in line.points])


def test_the_line_of_the_error_leads_from_the_tcp_to_where_it_should_be_magnified(
    markers: RobotMarkers,
) -> None:
    error = np.array([1e-4, -2e-4, 3e-5])
    command, line = markers.error(HOME, HOME + error, error)
    assert places(line) == pytest.approx(np.array([HOME, HOME + MAGNIFICATION * error]))
    assert [command.pose.position.x, command.pose.position.y] == pytest.approx((HOME + error)[:2])


def test_unreachable_place_of_the_arms_is_not_shown(markers: RobotMarkers) -> None:
    assert markers.robot(np.full(3, np.nan)) == []
    assert markers.robot(kinematics.inverse(HOME, ROBOT))


def test_only_the_tool_of_a_rotary_axis_is_turned(markers: RobotMarkers) -> None:
    theta, turn = kinematics.inverse(HOME, ROBOT), math.radians(70.0)
    turning = RobotMarkers(ROBOT.replace(rotary__present=True), MAGNIFICATION)
    before = {(marker.ns, marker.id): marker for marker in markers.robot(theta, turn)}
    after = {(marker.ns, marker.id): marker for marker in turning.robot(theta, turn)}
    added = after.keys() - before.keys()
    assert {name for name, _ in added} == {'bar_tube', 'bar_rod', 'pointer'}
    assert {name for name, _ in before if before[name, 0].pose != after[name, 0].pose} == {'tool', 'payload'}
    pointer = after['pointer', 0].pose
    assert (pointer.orientation.z, pointer.orientation.w) == pytest.approx(
        (math.sin(turn / 2), math.cos(turn / 2))
    )
    head = after['pointer', 1].pose.position
    assert math.atan2(head.y - HOME[1], head.x - HOME[0]) == pytest.approx(turn)
    assert {marker.ns for marker in turning.still()} - {marker.ns for marker in markers.still()} == {'motor4'}


def test_every_marker_has_its_own_name_and_number(markers: RobotMarkers) -> None:
    theta = kinematics.inverse(HOME, ROBOT)
    everything = [
        *markers.still(),
        *markers.robot(theta),
        *markers.travelled(),
        *markers.error(HOME, HOME, HOME),
    ]
    names = [(marker.ns, marker.id) for marker in everything]
    assert len(names) == len(set(names)) > 40
    for marker in everything:
        q = marker.pose.orientation
        assert np.linalg.norm([q.x, q.y, q.z, q.w]) == pytest.approx(1.0)


def test_path_of_one_point_is_empty_and_long_path_loses_its_beginning(markers: RobotMarkers) -> None:
    markers.travel(HOME)
    assert markers.travelled()[0].action == Marker.DELETE
    for step in range(POINTS_MAX + 10):
        markers.travel(np.add(HOME, [0.0, 0.0, -3e-3 * step]))
        markers.travel(np.add(HOME, [0.0, 0.0, -3e-3 * step - 1e-4]))  # too near to be a new place
    (line,) = markers.travelled()
    assert line.action == Marker.ADD
    assert len(line.points) == POINTS_MAX
    assert np.diff(places(line)[:, 2]) == pytest.approx(-3e-3)
    markers.travel(np.full(3, np.nan))
    assert len(markers.travelled()[0].points) == POINTS_MAX


def test_a_planned_path_of_many_points_is_drawn_with_fewer(markers: RobotMarkers) -> None:
    assert markers.still()[-1].action == Marker.DELETE
    markers.plan(np.linspace(HOME, [0.2, 0.0, -0.8], 5 * POINTS_MAX))
    drawn = places(markers.still()[-1])
    assert POINTS_MAX / 2 < len(drawn) <= POINTS_MAX
    assert drawn[0] == pytest.approx(HOME)
    markers.plan(np.array([HOME, [0.0, 0.2, -0.8]]))
    assert places(markers.still()[-1]) == pytest.approx(np.array([HOME, [0.0, 0.2, -0.8]]))
