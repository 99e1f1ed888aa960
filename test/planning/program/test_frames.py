"""Tests of frames of work objects and of tools."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.program.frames import BASE, Frame, Tool

ROUNDING_M = 1e-12  # of points up to some metres away
ROUNDING_RAD = 1e-7  # of angles of axes that are exact to 1e-15, near where an arc tangent is steep
LENGTHS = st.floats(-2.0, 2.0)
ANGLES = st.floats(-math.pi, math.pi)
POINTS = st.tuples(LENGTHS, LENGTHS, LENGTHS)
POSES = st.tuples(POINTS, ANGLES, ANGLES, ANGLES)
FAR = (0.2, -0.3, -0.8)


def framed(pose, parent=None):
    origin, *angles = pose
    return Frame.turned(origin, *angles, parent=parent)


@given(POSES, POINTS)
def test_roll_pitch_and_yaw_turn_about_the_axes_of_the_parent_one_after_the_other(pose, point):
    origin, *angles = pose
    expected = Rotation.from_euler('xyz', angles).apply(point) + np.array(origin)
    np.testing.assert_allclose(framed(pose).to_base(point), expected, rtol=0, atol=ROUNDING_M)


@given(POSES, POSES, POINTS)
def test_chain_of_frames_transforms_like_single_frames_in_order(one, other, point):
    parent, child = framed(one), framed(other)
    chain = framed(other, parent)
    expected = parent.to_base(child.to_base(point))
    np.testing.assert_allclose(chain.to_base(point), expected, rtol=0, atol=ROUNDING_M)
    np.testing.assert_allclose((parent @ child).to_base(point), expected, rtol=0, atol=ROUNDING_M)
    np.testing.assert_allclose(chain.in_base.to_base(point), expected, rtol=0, atol=ROUNDING_M)
    assert chain.in_base.parent is None


@given(POSES, POSES, POINTS)
def test_inverse_of_a_chain_restores_its_points(one, other, point):
    chain = framed(other, framed(one))
    there = chain.to_base(point)
    np.testing.assert_allclose(chain.from_base(there), point, rtol=0, atol=ROUNDING_M)
    np.testing.assert_allclose(chain.inverse().to_base(there), point, rtol=0, atol=ROUNDING_M)
    np.testing.assert_allclose((chain.inverse() @ chain).to_base(point), point, rtol=0, atol=ROUNDING_M)


@given(POSES)
def test_its_angles_make_a_frame_again(pose):
    frame = framed(pose)
    again = Frame.turned(frame.origin_m, *frame.roll_pitch_yaw_rad)
    np.testing.assert_allclose(again.axes, frame.axes, rtol=0, atol=ROUNDING_RAD)


@pytest.mark.parametrize('pitch_rad', [math.pi / 2, -math.pi / 2])
def test_its_angles_make_a_frame_again_whose_x_axis_is_upright(pitch_rad):
    frame = Frame.turned(FAR, 0.4, pitch_rad, 1.1)
    assert frame.roll_pitch_yaw_rad[0] == 0.0
    again = Frame.turned(FAR, *frame.roll_pitch_yaw_rad)
    np.testing.assert_allclose(again.axes, frame.axes, rtol=0, atol=ROUNDING_RAD)


@given(POSES, POINTS, POINTS)
def test_a_direction_is_turned_and_not_moved(pose, point, step):
    frame = framed(pose)
    moved = frame.to_base(np.add(point, step)) - frame.to_base(point)
    np.testing.assert_allclose(frame.directions_to_base(step), moved, rtol=0, atol=ROUNDING_M)


@given(POSES, st.floats(0.01, 1.0), st.floats(-1.0, 1.0), st.floats(0.01, 1.0))
def test_three_taught_points_restore_their_frame(pose, along, back, beside):
    frame = framed(pose)
    taught = Frame.taught(frame.to_base([[0, 0, 0], [along, 0, 0], [back, beside, 0]]))
    np.testing.assert_allclose(taught.origin_m, frame.origin_m, rtol=0, atol=ROUNDING_M)
    np.testing.assert_allclose(taught.axes, frame.axes, rtol=0, atol=1e-9)  # rounding over 10 mm


@pytest.mark.parametrize(
    ('points', 'sentence'),
    [
        (
            [[0, 0, -0.8], [0.1, 0, -0.8], [0.3, 0.0009, -0.8]],
            "frame 'box': its taught points are on a line: the third is 0.9 mm from the line through the others",
        ),
        ([[0, 0, -0.8], [0, 0, -0.8], [0, 0.1, -0.8]], 'x axis is 0 mm from its origin'),
        ([[0, 0, -0.8], [0.1, 0, -0.8]], 'must be 3 x 3 numbers'),
        ([[0, 0, -0.8], [0.1, 0, math.nan], [0, 0.1, -0.8]], 'its taught points must be finite'),
        ('here', "its taught points must be 3 x 3 numbers, not 'here'"),
    ],
)
def test_points_without_a_frame_are_rejected(points, sentence):
    with pytest.raises(ProgramError) as caught:
        Frame.taught(points, name='box')
    assert sentence in str(caught.value)


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        ({'origin_m': (0.0, math.inf, 0.0)}, "frame 'box': origin_m must be finite"),
        ({'origin_m': (0.0, 0.0)}, 'origin_m must be 3 numbers'),
        ({'axes': ((1, 0, 0), (0, 1, 0), (0, 0.1, 1))}, 'must be unit vectors at right angles'),
        ({'axes': ((1, 0, 0), (0, 1.001, 0), (0, 0, 1))}, 'they are off by 0.002'),
        ({'axes': ((1, 0, 0), (0, 1, 0), (0, 0, -1))}, 'a right-handed system'),
        ({'axes': ((1, 0), (0, 1))}, 'axes must be 3 x 3 numbers'),
    ],
)
def test_axes_that_form_no_frame_are_rejected(values, sentence):
    with pytest.raises(ProgramError) as caught:
        Frame(**values, name='box')
    assert sentence in str(caught.value)


def test_an_angle_that_is_not_finite_is_rejected():
    with pytest.raises(ProgramError, match='a frame: its angles must be finite'):
        Frame.turned(yaw_rad=math.inf)


@pytest.mark.parametrize('shape', [(3,), (5, 3), (2, 4, 3), (0, 3)])
def test_points_of_any_shape_are_accepted_and_returned(shape):
    points = np.random.default_rng(1).normal(size=shape)
    frame, tool = Frame.turned(FAR, 0.1, 0.2, 0.3), Tool((0.01, 0.0, -0.05))
    for found in (frame.to_base(points), frame.from_base(points), frame.directions_to_base(points)):
        assert found.shape == shape
    assert tool.plate_m(points).shape == tool.working_point_m(points).shape == shape


@pytest.mark.parametrize('take', [BASE.to_base, BASE.from_base, BASE.directions_to_base, Tool().plate_m])
@pytest.mark.parametrize('points', [1.0, [1.0, 2.0], [[1.0], [2.0], [3.0]]])
def test_invalid_points_are_rejected(take, points):
    with pytest.raises(ProgramError, match=r'must have shape \(\.\.\., 3\)'):
        take(points)


def test_base_changes_no_bit_of_a_point():
    points = np.random.default_rng(2).normal(size=(100, 3))
    np.testing.assert_array_equal(BASE.to_base(points), points)
    np.testing.assert_array_equal(BASE.from_base(points), points)


def test_a_long_chain_stays_orthonormal():
    frame = None
    for _ in range(500):
        frame = Frame.turned((0.01, 0.0, 0.0), 0.3, -0.2, 0.7, parent=frame)
    axes = np.array(frame.in_base.axes)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), rtol=0, atol=1e-14)


def test_tilt_is_measured_from_base_and_not_from_the_parent():
    parent = Frame.turned(FAR, pitch_rad=math.radians(20))
    assert parent.tilt_rad == pytest.approx(math.radians(20))
    assert Frame.turned(yaw_rad=1.0).tilt_rad == 0.0
    assert Frame.turned(pitch_rad=math.radians(-20), parent=parent).tilt_rad == pytest.approx(0.0, abs=1e-15)


def test_a_frame_at_a_place_has_the_axes_of_the_other():
    box = Frame.turned(FAR, yaw_rad=0.5, name='box')
    place = box.at((0.1, 0.2, 0.0), 'first')
    np.testing.assert_allclose(place.to_base([0, 0, 0.05]), box.to_base([0.1, 0.2, 0.05]), rtol=0, atol=1e-15)
    assert place.parent is box
    assert place.name == 'first'


def test_frames_and_tools_are_values():
    assert Frame.turned(FAR, yaw_rad=0.5) == Frame.turned(np.array(FAR), yaw_rad=0.5)
    assert len({Tool((0, 0, -0.05)), Tool((0.0, 0.0, -0.05)), Tool((0.0, 0.0, -0.06))}) == 2
    with pytest.raises(AttributeError):
        BASE.origin_m = FAR


@given(POINTS, POINTS)
def test_plate_is_placed_for_the_working_point(offset, point):
    tool = Tool(tuple(np.divide(offset, 2.0)))
    np.testing.assert_allclose(tool.plate_m(point) + np.array(tool.offset_m), point, rtol=0, atol=ROUNDING_M)
    np.testing.assert_allclose(tool.working_point_m(tool.plate_m(point)), point, rtol=0, atol=ROUNDING_M)


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        (
            {'offset_m': (0, 0, -50)},
            "tool 'cup': offset_m is [0.0, 0.0, -50.0] m, farther than 1 m: are these mill",
        ),
        ({'offset_m': (0, 0, math.nan)}, "tool 'cup': offset_m must be finite"),
        ({'mass_kg': -0.1}, 'mass_kg is -0.1, but must be between 0 and 10'),
        ({'mass_kg': 10.1}, 'mass_kg is 10.1, but must be between 0 and 10'),
        ({'mass_kg': math.nan}, 'mass_kg must be finite'),
        ({'mass_kg': (1, 2)}, 'mass_kg must be a number, not (1, 2)'),
    ],
)
def test_invalid_tool_is_rejected(values, sentence):
    with pytest.raises(ProgramError) as caught:
        Tool(**values, name='cup')
    assert sentence in str(caught.value)
