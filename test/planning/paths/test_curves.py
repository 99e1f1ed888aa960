"""Tests of paths (thesis 5, 6.1 to 6.3): lines, circles, splines, blends and cubics as pieces over the distance."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.paths import curves
from delta3_pacdrive.planning.paths.curves import ARC_RADIUS_MAX_M, SPLINE_POINTS_MAX, TURN_MAX_RAD, Curve
from delta3_pacdrive.planning.paths.path import SEGMENT_COLUMNS, path_at, sample_path
from planned import refusal
from thoroughness import examples

EXACT = 1e-12
ON_CIRCLE_M = 1e-6
THROUGH_M = 1e-9
EVEN = 2.5e-4  # of |dp/ds|: the pieces are made to keep 2e-4 at five of their places
ARC_EVEN = 1e-4
SHAPE = 1e-3  # of a chord: how far quintics with the ends of a spline may be from it between them
CONTINUOUS_M = 1e-12
# jumps at joints: the coefficients of a piece of length h hold its curvature to rounding / h^2
TANGENT_JUMP, CURVATURE_JUMP = 1e-9, 1e-6  # that of the curvature relative to 1/m and to itself

coordinates = st.floats(-0.5, 0.5)
points = st.tuples(coordinates, coordinates, coordinates)
shares = st.floats(0.0, 1.0)


def dense(curve, count=2001):
    """Return samples (n, 4, 3) over the whole of a curve, and their distances."""
    s = np.linspace(0.0, curve.length_m, count)
    return sample_path(s, curve.segments), s


def inside_pieces(curve, per_piece=20):
    """Return samples spread over every piece."""
    edges = np.append(curve.segments[:, 0], curve.length_m)
    share = (np.arange(per_piece) + 0.5) / per_piece
    s = (edges[:-1, None] + np.diff(edges)[:, None] * share).ravel()
    return sample_path(s, curve.segments)


def unevenness(curve):
    return np.abs(np.linalg.norm(inside_pieces(curve)[:, 1], axis=1) - 1.0).max()


def require_c2(curve, tangent_jump=TANGENT_JUMP):
    """Compare both sides of every joint: position, tangent, curvature."""
    for n in range(1, len(curve.segments)):
        joint = curve.segments[n, 0]
        before = sample_path([joint], curve.segments[:n])[0]
        after = sample_path([joint], curve.segments[n:])[0]
        assert np.abs(before[0] - after[0]).max() < CONTINUOUS_M
        assert np.abs(before[1] - after[1]).max() < tangent_jump
        bend = np.abs(after[2]).max()
        assert np.abs(before[2] - after[2]).max() < CURVATURE_JUMP * (1.0 + bend)


def distance_to(curve, p):
    """Smallest distance of a point from a curve, and where."""
    samples, s = dense(curve)
    where = s[np.argmin(np.linalg.norm(samples[:, 0] - p, axis=1))]
    for _ in range(5):  # Newton's steps to the foot of the perpendicular
        here, tangent, bend, _ = curve.at(where)
        where -= (here - p) @ tangent / (tangent @ tangent + (here - p) @ bend)
        where = min(max(where, 0.0), curve.length_m)
    return float(np.linalg.norm(curve.at(where)[0] - p)), where


# pieces


def test_pieces_cut_from_one_polynomial_are_that_polynomial_with_three_derivatives():
    """Each piece has its own origin; its powers are those of the distance from there."""
    polynomials = [
        np.polynomial.Polynomial(c)
        for c in (
            [0.1, -0.3, 2.0, -1.5, 0.3, 0.7],
            [0.0, 0.7, -1.0, 0.4, -2.0, 0.1],
            [-0.8, 0.2, 0.5, 0.6, 0.0, -0.9],
        )
    ]
    cuts = [0.0, 0.3, 0.31, 0.8]
    segments = np.zeros((4, SEGMENT_COLUMNS))
    for n, cut in enumerate(cuts):
        segments[n, 0] = cut
        for axis, q in enumerate(polynomials):
            taylor = [q.deriv(k)(cut) / math.factorial(k) for k in range(1, 6)]
            segments[n, 1 + 6 * axis : 7 + 6 * axis] = [q(cut), *taylor]
    s = np.array([0.0, 0.1, 0.2999, 0.3, 0.305, 0.31, 0.5, 0.7999, 0.8, 1.0])
    sampled = sample_path(s, segments)
    for axis, q in enumerate(polynomials):
        for order in range(4):
            expected = (q.deriv(order) if order else q)(s)
            assert np.abs(sampled[:, order, axis] - expected).max() < 1e-11
    one_by_one = [path_at(x, segments, 0, len(segments)) for x in s]
    assert np.array_equal(np.array(one_by_one), sampled[:, 0])


@given(points, points, points, shares, shares)
def test_a_part_of_a_curve_is_that_stretch_of_it(a, c, b, one, other):
    curve = any_arc(a, c, b)
    start, end = sorted((one * curve.length_m, other * curve.length_m))
    assume(end - start > 1e-6)
    part = curve.part(start, end)
    assert part.length_m == pytest.approx(end - start, rel=EXACT)
    s = np.linspace(0.0, part.length_m, 50)
    difference = sample_path(s, part.segments) - sample_path(start + s, curve.segments)
    assert np.abs(difference[:, :2]).max() < EXACT
    # a third derivative of cubic pieces is a step at each joint: only up to the second is compared
    assert np.abs(difference[:, 2]).max() < 1e-9 * (1.0 + np.abs(sample_path(s, part.segments)[:, 2]).max())
    assert part.segments[0, 0] == 0.0
    assert (np.diff(part.segments[:, 0]) > 0.0).all()
    assert part.segments[-1, 0] < part.length_m


def test_section_over_the_whole_curve_equals_the_curve():
    curve = curves.arc((0, 0, 0), (0.1, 0.1, 0), (0.2, 0, 0))
    assert curve.part(0.0, curve.length_m) is curve


@given(points, points, points)
def test_joined_curves_follow_each_other(a, c, b):
    first = any_arc(a, c, b)
    second = curves.line(b, (0.0, 0.0, -0.9))
    both = curves.joined([first, second])
    assert both.length_m == pytest.approx(first.length_m + second.length_m, rel=EXACT)
    s = np.linspace(0.0, 1.0, 30)
    on_first = sample_path(s[:-1] * first.length_m, both.segments)
    assert np.abs(on_first - sample_path(s[:-1] * first.length_m, first.segments)).max() == 0.0
    on_second = sample_path(first.length_m + s * second.length_m, both.segments)[:, 0]
    assert np.abs(on_second - sample_path(s * second.length_m, second.segments)[:, 0]).max() < EXACT


# lines and points


@given(points, points)
def test_a_line_is_straight_even_and_meets_its_ends(start, end):
    curve = curves.line(start, end)
    assert curve.length_m == pytest.approx(math.dist(start, end), rel=EXACT)
    if curve.length_m < 1e-6:
        return
    share = np.linspace(0.0, 1.0, 11)[:, None]
    p, tangent, curvature, change = np.moveaxis(
        sample_path(share[:, 0] * curve.length_m, curve.segments), 1, 0
    )
    expected = (1.0 - share) * np.array(start) + share * np.array(end)
    assert np.abs(p - expected).max() < EXACT
    assert p[0].tolist() == list(start)
    assert np.linalg.norm(tangent, axis=1) == pytest.approx(np.ones(11), abs=1e-9)
    assert not curvature.any()
    assert not change.any()


def test_point_is_fixed():
    curve = curves.point([0.1, 0.2, -0.8])
    assert curve.length_m == 0.0
    assert curve.at(0.0).tolist() == [[0.1, 0.2, -0.8], [0.0] * 3, [0.0] * 3, [0.0] * 3]


# circles


def circle_through(a, c, b):
    """Centre, radius and normal from linear equations: equally far from all three, and in their plane."""
    a, c, b = (np.array(p) for p in (a, c, b))
    normal = np.cross(c - a, b - a)
    normal /= np.linalg.norm(normal)
    matrix = np.array([c - a, b - a, normal])
    centre = np.linalg.solve(matrix, [(c @ c - a @ a) / 2.0, (b @ b - a @ a) / 2.0, normal @ a])
    return centre, float(np.linalg.norm(a - centre)), normal


def any_arc(a, c, b):
    """Return the arc, if the points are well apart and off a line."""
    u, v = np.array(c) - a, np.array(b) - a
    size = np.linalg.norm(u) * np.linalg.norm(v)
    assume(min(np.linalg.norm(u), np.linalg.norm(v), math.dist(c, b)) > 1e-3)
    assume(np.linalg.norm(np.cross(u, v)) > 0.02 * size)
    return curves.arc(a, c, b)


@settings(max_examples=examples(200))
@given(points, points, points)
def test_an_arc_lies_on_the_circle_through_its_three_points(a, c, b):
    curve = any_arc(a, c, b)
    centre, radius, normal = circle_through(a, c, b)
    p = inside_pieces(curve)[:, 0] - centre
    assert np.abs(np.linalg.norm(p, axis=1) - radius).max() < ON_CIRCLE_M
    assert np.abs(p @ normal).max() < ON_CIRCLE_M


@settings(max_examples=examples(200))
@given(points, points, points)
def test_arc_passes_start_circle_point_and_end_once(a, c, b):
    curve = any_arc(a, c, b)
    assert np.abs(curve.at(0.0)[0] - a).max() < THROUGH_M
    assert np.abs(curve.at(curve.length_m)[0] - b).max() < THROUGH_M
    distance, where = distance_to(curve, np.array(c))
    assert distance < ON_CIRCLE_M
    # the angle at the centre grows steadily, from 0 at the start, by less than a full turn
    centre, radius, normal = circle_through(a, c, b)
    p = dense(curve)[0][:, 0] - centre
    steps = np.arctan2(np.cross(p[:-1], p[1:]) @ normal, (p[:-1] * p[1:]).sum(axis=1))
    assert (steps > 0.0).all()
    assert steps.sum() < 2.0 * np.pi
    assert curve.length_m == pytest.approx(radius * steps.sum(), rel=1e-6)
    # and two angles at the circumference are half of those at the centre
    inscribed = math.acos(
        np.clip(np.dot(np.subtract(a, b), np.subtract(c, b)) / (math.dist(a, b) * math.dist(c, b)), -1.0, 1.0)
    )
    assert where == pytest.approx(2.0 * inscribed * radius, abs=1e-4 * radius)


@settings(max_examples=examples(200))
@given(points, points, points)
def test_an_arc_is_even_and_bends_as_its_circle_does(a, c, b):
    curve = any_arc(a, c, b)
    _, radius, _ = circle_through(a, c, b)
    assert unevenness(curve) < ARC_EVEN
    bend = np.linalg.norm(inside_pieces(curve)[:, 2], axis=1)
    # a cubic's second derivative is a polygon between points 0.05 rad apart: within 0.05^2 / 8 inside, more at its ends
    assert np.abs(bend * radius - 1.0).max() < 2e-3
    require_c2(curve)


def test_long_arc_is_taken_if_the_circle_point_is_on_it():
    a, b = (0.1, 0.0, -0.8), (0.0, 0.1, -0.8)
    short = curves.arc(a, (0.1 * math.cos(0.5), 0.1 * math.sin(0.5), -0.8), b)
    long = curves.arc(a, (-0.1, 0.0, -0.8), b)
    assert short.length_m == pytest.approx(0.1 * math.pi / 2.0, rel=1e-9)
    assert long.length_m == pytest.approx(0.1 * math.pi * 1.5, rel=1e-9)


@given(points, points)
def test_coincident_points_of_an_arc_are_named(a, b):
    assume(math.dist(a, b) > 1e-3)
    assert refusal(curves.arc, a, b, a) == (
        'start and end of the circle coincide: for a full circle give two other points of it, and angle_deg: 360'
    )
    assert refusal(curves.arc, a, a, b) == 'start and circle point of the circle coincide'
    assert refusal(curves.arc, a, b, b) == 'circle point and end of the circle coincide'


@given(points, points, st.floats(-2.0, 3.0))
def test_three_points_on_a_line_are_not_a_circle(a, b, share):
    assume(math.dist(a, b) > 1e-2 and min(abs(share), abs(share - 1.0)) > 1e-2)
    via = np.array(a) + share * np.subtract(b, a)
    assert 'on a line: they do not define a circle' in refusal(curves.arc, a, via, b)


@pytest.mark.parametrize(
    ('radius', 'allowed'), [(0.99 * ARC_RADIUS_MAX_M, True), (1.01 * ARC_RADIUS_MAX_M, False)]
)
def test_a_circle_may_have_a_radius_of_100_m(radius, allowed):
    half = 0.25
    sagitta = radius - math.sqrt(radius**2 - half**2)
    three = (-half, 0.0, -0.8), (0.0, sagitta, -0.8), (half, 0.0, -0.8)
    if allowed:
        curve = curves.arc(*three)
        centre = np.array([0.0, sagitta - radius, -0.8])
        assert np.abs(np.linalg.norm(dense(curve)[0][:, 0] - centre, axis=1) - radius).max() < ON_CIRCLE_M
    else:
        assert 'radius of 101 m, the limit is 100 m' in refusal(curves.arc, *three)


# splines


@st.composite
def corner_points(draw, turn_max):
    """Points a few centimetres apart, the way between them turning by at most ``turn_max`` each."""
    count = draw(st.integers(3, 12))
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3)
    p = [rng.uniform(-0.1, 0.1, 3)]
    for _ in range(count - 1):
        direction /= np.linalg.norm(direction)
        p.append(p[-1] + direction * rng.uniform(0.02, 0.2))
        sideways = np.cross(direction, rng.normal(size=3))
        sideways /= np.linalg.norm(sideways)
        turn = rng.uniform(0.0, turn_max)
        direction = math.cos(turn) * direction + math.sin(turn) * sideways
    return np.array(p)


def spline_or_refusal(p):
    """Return the spline; points drawn blindly may turn back on themselves."""
    try:
        return curves.spline(p)
    except ProgramError:
        assume(False)


@settings(max_examples=examples(150))
@given(corner_points(turn_max=3.0))
def test_spline_passes_all_points_in_their_order(p):
    curve = spline_or_refusal(p)
    assert np.abs(curve.at(0.0)[0] - p[0]).max() < THROUGH_M
    assert np.abs(curve.at(curve.length_m)[0] - p[-1]).max() < THROUGH_M
    # a point is where a piece begins
    begins = sample_path(curve.segments[:, 0], curve.segments)[:, 0]
    found = [np.linalg.norm(begins - point, axis=1) for point in p[:-1]]
    assert max(gaps.min() for gaps in found) < THROUGH_M
    order = [int(np.argmin(gaps)) for gaps in found]
    assert order == sorted(set(order))


@settings(max_examples=examples(150))
@given(corner_points(turn_max=3.0))
def test_a_spline_is_even_and_c2(p):
    curve = spline_or_refusal(p)
    assert unevenness(curve) < EVEN
    require_c2(curve)


@settings(max_examples=examples(50))
@given(corner_points(turn_max=3.0))
def test_the_length_of_a_spline_is_that_of_its_polygon_with_many_corners(p):
    curve = spline_or_refusal(p)
    samples = inside_pieces(curve, 200)[:, 0]
    polygon = np.concatenate([p[:1], samples, p[-1:]])
    assert np.linalg.norm(np.diff(polygon, axis=0), axis=1).sum() == pytest.approx(curve.length_m, rel=EVEN)


@settings(max_examples=examples(50))
@given(corner_points(turn_max=1.0))
def test_a_spline_is_the_natural_cubic_spline_over_the_chords(p):
    """Its pieces have place, tangent and curvature of that spline at both ends, and come close to it between."""
    curve = curves.spline(p)
    chords = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    cubic = CubicSpline(chords, p, bc_type='natural')
    u = np.linspace(0.0, chords[-1], 20_001)
    speed = np.linalg.norm(cubic(u, 1), axis=1)
    length = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(u))])
    assert curve.length_m == pytest.approx(length[-1], rel=1e-8)
    samples, s = dense(curve)
    assert np.abs(samples[:, 0] - cubic(np.interp(s, length, u))).max() < SHAPE * np.diff(chords).max()


def test_a_spline_begins_and_ends_without_bend():
    curve = curves.spline([(0, 0, 0), (0.1, 0.05, 0), (0.2, -0.05, 0.02), (0.3, 0, 0)])
    assert np.abs(curve.at(0.0)[2]).max() < 1e-9
    assert np.abs(curve.at(curve.length_m)[2]).max() < 1e-9


def test_a_spline_through_one_point_is_a_line():
    curve, line = curves.spline([(0, 0, -0.8), (0.1, 0.2, -0.9)]), curves.line((0, 0, -0.8), (0.1, 0.2, -0.9))
    assert curve.length_m == line.length_m
    assert np.array_equal(curve.segments, line.segments)


def test_spline_accepts_100_points_and_rejects_101():
    turns = np.linspace(0.0, 6.0 * np.pi, SPLINE_POINTS_MAX + 2)
    p = np.stack([0.2 * np.cos(turns), 0.2 * np.sin(turns), -0.9 + 0.01 * turns], axis=1)
    curve = curves.spline(p[:101])
    assert max(distance_to(curve, point)[0] for point in p[:101:20]) < THROUGH_M
    assert unevenness(curve) < EVEN
    assert refusal(curves.spline, p[:102]) == 'it goes through 101 points, the limit is 100'


def test_a_spline_that_turns_back_is_rejected_with_the_place():
    there_and_back = [(0.0, 0.1, -0.8), (0.1, 0.1, -0.8), (0.0, 0.1, -0.8)]
    sentence = refusal(curves.spline, there_and_back)
    assert sentence == 'the spline turns too sharply near (0.1000, 0.1000, -0.8000) m'


def test_a_cusp_between_the_points_is_rejected_with_a_place():
    """The curve x = t^2, y = t^3 is a cubic spline with zero velocity at t = 0, for any knots."""

    cusp = (
        lambda t: np.stack([t**2, t**3, 0.0 * t], axis=1),
        lambda t: np.stack([2.0 * t, 3.0 * t**2, 0.0 * t], axis=1),
        lambda t: np.stack([2.0 + 0.0 * t, 6.0 * t, 0.0 * t], axis=1),
    )
    assert 'the path turns too sharply near (' in refusal(
        curves.by_arc_length, cusp, [-0.3, -0.1, 0.2], 'path'
    )


def test_neighbours_of_a_spline_that_coincide_are_named():
    p = [(0, 0, -0.8), (0.1, 0, -0.8), (0.1, 0, -0.8 + 1e-9), (0.2, 0, -0.8)]
    assert refusal(curves.spline, p) == 'points 1 and 2 of the spline coincide'


# blends


def corner(turn, before=0.3, after=0.3):
    """Return two lines that meet at the origin under an angle."""
    end = after * np.array([math.cos(turn), math.sin(turn), 0.0])
    return curves.line((-before, 0.0, 0.0), (0.0, 0.0, 0.0)), curves.line((0.0, 0.0, 0.0), end)


def direction_and_bend(sample):
    """Unit tangent and curvature vector, for any |dp/ds|."""
    _, first, second, _ = sample
    tangent = first / np.linalg.norm(first)
    return tangent, (second - (second @ tangent) * tangent) / (first @ first)


def require_same(one, other):
    """Compare place, tangent and curvature."""
    assert np.abs(one[0] - other[0]).max() < CONTINUOUS_M
    (tangent, bend), (other_tangent, other_bend) = direction_and_bend(one), direction_and_bend(other)
    assert np.abs(tangent - other_tangent).max() < TANGENT_JUMP
    assert np.abs(bend - other_bend).max() < CURVATURE_JUMP * (1.0 + np.abs(other_bend).max())


def require_blend(before, after, radius):
    curve = curves.blend(before, after, radius)
    require_same(curve.at(0.0), before.at(before.length_m - radius))
    require_same(curve.at(curve.length_m), after.at(radius))
    jump = np.linalg.norm(after.at(0.0)[1] - before.at(before.length_m)[1])
    # the path stays on curves that meet within SMOOTH_RAD
    require_c2(curve, TANGENT_JUMP + (jump if jump <= curves.SMOOTH_RAD else 0.0))
    assert unevenness(curve) < EVEN
    place = after.at(0.0)[0]
    assert np.linalg.norm(dense(curve)[0][:, 0] - place, axis=1).max() <= radius * (1.0 + EVEN)
    assert curve.length_m < 2.0 * radius * (1.0 + EVEN)
    return curve


@settings(max_examples=examples(200))
@given(st.floats(0.0, TURN_MAX_RAD - 1e-6), st.floats(1e-4, 0.3))
def test_a_blend_of_two_lines_is_c2_and_stays_within_its_radius_of_the_corner(turn, radius):
    curve = require_blend(*corner(turn), radius)
    p = dense(curve)[0][:, 0]
    # inside the corner: between the two lines
    assert p[:, 1].min() > -1e-12
    assert (p @ [math.sin(turn), -math.cos(turn), 0.0]).max() < 1e-12 + 1e-9 * radius
    # a mirror image of itself in the corner's bisector
    mirror = np.array([-math.sin(turn / 2.0), math.cos(turn / 2.0), 0.0])
    assert np.abs((2.0 * np.outer(p @ mirror, mirror) - p)[::-1] - p).max() < 1e-6 * radius + 1e-4 * EVEN


@settings(max_examples=examples(200))
@given(points, points, points, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.01, 1.0))
def test_a_blend_of_an_arc_and_a_line_is_c2_and_stays_within_its_radius(a, c, b, azimuth, rise, share):
    before = any_arc(a, c, b)
    direction = np.array([math.cos(3.0 * azimuth), math.sin(3.0 * azimuth), rise])
    after = curves.line(b, np.array(b) + 0.2 * direction / np.linalg.norm(direction))
    _, bend, _ = circle_through(a, c, b)
    # up to half a radian of the arc
    radius = share * min(before.length_m, 0.2, 0.5 * bend)
    turn = math.acos(np.clip(before.at(before.length_m)[1] @ after.at(0.0)[1], -1.0, 1.0))
    assume(turn < 2.5)
    require_blend(before, after, radius)
    backwards = curves.arc(b, c, a)
    turn = math.acos(np.clip(-after.at(0.0)[1] @ backwards.at(0.0)[1], -1.0, 1.0))
    assume(turn < 2.5)
    require_blend(curves.line(after.at(0.2)[0], b), backwards, radius)


@given(corner_points(turn_max=1.0), st.floats(0.01, 1.0), st.floats(0.1, 2.0))
def test_a_blend_cut_from_a_spline_is_c2_and_as_even_as_the_spline(p, share, turn):
    before = curves.spline(p)
    direction = before.at(before.length_m)[1]
    sideways = np.cross(direction, [0.3, -0.5, 0.8])
    sideways /= np.linalg.norm(sideways)
    after = curves.line(p[-1], p[-1] + 0.2 * (math.cos(turn) * direction + math.sin(turn) * sideways))
    radius = share * min(0.02, 0.5 * before.length_m)
    curve = require_blend(before, after, radius)
    cut = before.at(before.length_m - radius)
    assert abs(np.linalg.norm(curve.at(0.0)[1]) - np.linalg.norm(cut[1])) < EVEN


@pytest.mark.parametrize('turn', [TURN_MAX_RAD + 1e-3, math.pi])
def test_a_path_that_turns_back_has_no_blend(turn):
    sentence = refusal(curves.blend, *corner(turn), 0.01)
    assert sentence == 'the path turns back at this corner, which cannot be rounded; use blend_m: 0'


def test_a_sharper_corner_is_cut_less():
    """The nearest that a blend comes to the corner grows with the turn: on a straight corner it passes through it."""
    nearest = [
        np.linalg.norm(dense(curves.blend(*corner(turn), 0.1))[0][:, 0], axis=1).min()
        for turn in np.radians([0.0, 30.0, 60.0, 90.0, 120.0, 150.0])
    ]
    assert nearest[0] < 1e-4
    assert (np.diff(nearest) > 0.0).all()


# cubics of chapter 5

velocities = st.tuples(*[st.floats(-2.0, 2.0)] * 3)


@given(points, points, velocities, velocities, st.floats(0.01, 10.0))
def test_a_cubic_has_the_places_and_velocities_prescribed_at_its_ends(start, end, v0, v1, duration):
    a = curves.cubic_coefficients(start, end, v0, v1, duration)
    rounding = 1e-12 * (1.0 + duration) + 1e-12 / duration
    for axis in range(3):
        x = np.polynomial.Polynomial(a[:, axis])
        assert x(0.0) == start[axis]
        assert x(duration) == pytest.approx(end[axis], abs=rounding)
        assert x.deriv()(0.0) == v0[axis]
        assert x.deriv()(duration) == pytest.approx(v1[axis], abs=rounding)


@given(points, points, st.floats(0.01, 10.0))
def test_a_cubic_from_rest_to_rest_is_that_of_the_textbook(start, end, duration):
    """X = X0 + (X1 - X0)(3 u^2 - 2 u^3), u = t/T."""
    curve = curves.timed_cubic(np.array(start), np.array(end), np.zeros(3), np.zeros(3), duration)
    u = np.linspace(0.0, 1.0, 21)
    expected = np.array(start) + np.outer(3.0 * u**2 - 2.0 * u**3, np.subtract(end, start))
    assert curve.length_m == duration
    assert np.abs(sample_path(u * duration, curve.segments)[:, 0] - expected).max() < 1e-12


@given(st.lists(st.tuples(points, velocities, st.floats(0.05, 2.0)), min_size=2, max_size=5))
def test_cubics_in_sequence_have_no_jump_in_place_and_velocity(parts):
    here, velocity = np.zeros(3), np.zeros(3)
    pieces = []
    for end, end_velocity, duration in parts:
        pieces.append(curves.timed_cubic(here, np.array(end), velocity, np.array(end_velocity), duration))
        here, velocity = np.array(end), np.array(end_velocity)
    whole = curves.joined(pieces)
    assert whole.length_m == pytest.approx(sum(duration for _, _, duration in parts), rel=EXACT)
    time = 0.0
    for n, (end, end_velocity, duration) in enumerate(parts):
        time += duration
        for segments in (whole.segments[: n + 1], whole.segments[n + 1 :]):
            if len(segments):
                p, v, _, _ = sample_path([time], segments)[0]
                assert np.abs(p - end).max() < 1e-11
                assert np.abs(v - end_velocity).max() < 1e-9


def test_a_curve_is_frozen():
    curve = curves.line((0, 0, 0), (1, 0, 0))
    assert isinstance(curve, Curve)
    with pytest.raises(AttributeError):
        curve.length_m = 2.0
