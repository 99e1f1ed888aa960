"""Tests of the arms (thesis 4.2 to 4.6) against an independent model: rotated elbows, rods of length l_B."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import UnreachableError

SEED = 20090417
PRINTED = 1e-9  # the reference values have nine decimals
ROUNDING = 1e-12  # a few hundred roundings of numbers of order one
DIFFERENCE_STEP = 1e-4
DIFFERENCE = 1e-7  # central differences of fourth order: step^4 and rounding/step (second ones: /step^2)
REFERENCE_THETA = np.radians([10.0, 25.0, 40.0])
REFERENCE_THETADOT = np.array([2.0, -1.0, 1.5])
L_A, L_B, R = 0.400, 0.950, 0.150  # of the default robot


def turn(angle):
    """Matrix of a rotation about z."""
    return np.array(
        [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    )


TURNS = np.stack([turn(angle) for angle in np.radians([0.0, 120.0, 240.0])])


def elbows(theta):
    """Elbows of arm angles (..., 3), shape (..., 3 arms, 3): the arm in its own plane, turned to its azimuth."""
    theta = np.asarray(theta)
    in_plane = np.stack([R + L_A * np.cos(theta), 0.0 * theta, -L_A * np.sin(theta)], axis=-1)
    return np.einsum('iab,...ib->...ia', TURNS, in_plane)


def rods(theta, p):
    """Forearm vectors from the elbows to the plate, shape (..., 3 arms, 3)."""
    return np.asarray(p)[..., None, :] - elbows(theta)


def workspace_points(robot, count):
    """Points (count, 3) all over the workspace cylinder, its rim and its ends included."""
    print(f'seed {SEED}')
    random, k = np.random.default_rng(SEED), robot.kinematics
    radius = 0.5 * k.workspace_diameter_m * np.sqrt(random.uniform(0.0, 1.1, count).clip(0.0, 1.0))
    azimuth = random.uniform(-np.pi, np.pi, count)
    z = random.uniform(k.workspace_bottom_m - 0.01, k.workspace_top_m + 0.01, count)
    z = z.clip(k.workspace_bottom_m, k.workspace_top_m)
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=-1)


def joint_triples(robot, count):
    """Arm angles (count, 3) all over the control limits."""
    print(f'seed {SEED}')
    k = robot.kinematics
    return np.random.default_rng(SEED).uniform(k.arm_angle_min_rad, k.arm_angle_max_rad, (count, 3))


def derivative(function, step=DIFFERENCE_STEP):
    """Central difference of fourth order of a function of one variable at 0."""
    inner, outer = function(step) - function(-step), function(2.0 * step) - function(-2.0 * step)
    return (8.0 * inner - outer) / (12.0 * step)


angles = st.floats(-0.785, 1.658)


@pytest.mark.parametrize(
    ('p', 'degrees'),
    [
        ((0.0, 0.0, -0.75), [-3.606054549] * 3),
        ((0.0, 0.0, -0.9), [16.544871864] * 3),
        ((0.34, 0.34, -0.91), [6.813912684, 26.104007555, 67.044672187]),
    ],
)
def test_the_printed_points_have_their_known_arm_angles(p, degrees, robot):
    assert np.degrees(kinematics.inverse(p, robot.kinematics)) == pytest.approx(degrees, abs=PRINTED)


def test_the_elbow_in_angle_above_home_is_known(robot):
    elbow_in = kinematics.inverse_all((0.0, 0.0, -0.75), robot.kinematics)[7]
    assert np.degrees(elbow_in) == pytest.approx([-153.774080503] * 3, abs=PRINTED)


def test_the_reference_pose_has_its_known_points(robot):
    below = kinematics.forward(REFERENCE_THETA, robot.kinematics)
    above = kinematics.forward(REFERENCE_THETA, robot.kinematics, above=True)
    assert below == pytest.approx([0.187052909, 0.115179993, -0.942315064], abs=PRINTED)
    assert above == pytest.approx([-0.104216630, -0.058798538, 0.622608370], abs=PRINTED)


def test_the_reference_pose_has_its_known_jacobians(robot):
    k = robot.kinematics
    p = kinematics.forward(REFERENCE_THETA, k)
    j = kinematics.jacobian(REFERENCE_THETA, p, k)
    j_dot = kinematics.jacobian_dot(REFERENCE_THETA, REFERENCE_THETADOT, p, j @ REFERENCE_THETADOT, k)
    assert j[0] == pytest.approx([-0.423277397, 0.248488915, 0.262530520], abs=PRINTED)
    assert j_dot[0] == pytest.approx([-0.452447158, -0.055768235, 0.152468523], abs=PRINTED)


def test_forward_undoes_inverse_across_the_workspace(robot):
    points = workspace_points(robot, 5000)
    theta = kinematics.inverse(points, robot.kinematics)
    assert np.abs(kinematics.forward(theta, robot.kinematics) - points).max() < ROUNDING


def test_the_whole_workspace_lies_within_the_limits_of_angle_swing_and_singularity(robot):
    k, points = robot.kinematics, workspace_points(robot, 5000)
    theta = kinematics.inverse(points, k)
    serial, parallel = kinematics.singularity(theta, points, k)
    assert k.arm_angle_min_deg < np.degrees(theta).min() < -35.0
    assert 80.0 < np.degrees(theta).max() < k.arm_angle_max_deg
    assert 37.0 < np.degrees(kinematics.forearm_swing(points, k)).max() < k.forearm_swing_max_deg
    # the parameter study found 0.66 and 0.348 over the cylinder
    assert serial.min() == pytest.approx(0.66, abs=0.01)
    assert parallel.min() == pytest.approx(0.348, abs=0.01)


def test_inverse_undoes_forward_within_the_joint_limits(robot):
    k, theta = robot.kinematics, joint_triples(robot, 5000)
    p = kinematics.forward(theta, k)
    in_plane = np.einsum('iba,...ib->...ia', TURNS, rods(theta, p))
    # elbow out: the forearm turns the arm down, seen along the arm's hinge
    out = in_plane[..., 0] * np.sin(theta) + in_plane[..., 2] * np.cos(theta) < 0.0
    works = out.all(axis=-1)
    assert works.mean() > 0.9
    assert (
        np.abs(kinematics.inverse(p[works], k) - theta[works]).max() < 1e3 * ROUNDING
    )  # near the elbow's stretch
    every = kinematics.inverse_all(p, k)
    number = (~out) @ np.array([1, 2, 4])
    assert np.abs(every[np.arange(len(p)), number] - theta).max() < 1e3 * ROUNDING


@given(st.floats(0.0, 0.6), st.floats(-np.pi, np.pi), st.floats(-0.95, -0.70))
def test_all_eight_solutions_close_the_chain_and_differ(robot, radius, azimuth, z):
    p = np.array([radius * np.cos(azimuth), radius * np.sin(azimuth), z])
    solutions = kinematics.inverse_all(p, robot.kinematics)
    assert solutions.shape == (8, 3)
    assert np.abs(np.linalg.norm(rods(solutions, p), axis=-1) - L_B).max() < ROUNDING
    assert (np.abs(solutions) <= np.pi).all()
    assert np.array_equal(solutions[0], kinematics.inverse(p, robot.kinematics))
    for n in range(8):
        for m in range(n):
            assert np.abs(solutions[n] - solutions[m]).max() > 0.5
            assert np.count_nonzero(solutions[n] != solutions[m]) == (n ^ m).bit_count()


@given(angles, angles, angles)
def test_both_intersections_close_the_chain_as_mirror_images_in_the_elbow_plane(robot, a, b, c):
    theta = np.array([a, b, c])
    below = kinematics.forward(theta, robot.kinematics)
    above = kinematics.forward(theta, robot.kinematics, above=True)
    for p in (below, above):
        assert np.linalg.norm(rods(theta, p), axis=-1) == pytest.approx([L_B] * 3, abs=ROUNDING)
    corners = elbows(theta)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    assert normal[2] > 0.0
    assert normal @ (below - corners[0]) == pytest.approx(-normal @ (above - corners[0]), abs=ROUNDING)
    assert normal @ (below - corners[0]) < 0.0
    assert np.cross(normal, above - below) == pytest.approx(np.zeros(3), abs=ROUNDING)


@pytest.mark.parametrize('shape', [(), (1,), (7,), (2, 3), (0,), (2, 0, 4)])
def test_arrays_of_poses_give_the_bits_of_single_poses(shape, robot):
    k = robot.kinematics
    count = int(np.prod(shape))
    points = workspace_points(robot, count).reshape(*shape, 3)
    theta = kinematics.inverse(points, k)
    rates, speeds = np.ones_like(theta), points[..., ::-1]
    together = [
        theta,
        kinematics.forward(theta, k),
        kinematics.forward(theta, k, above=True),
        kinematics.inverse_all(points, k),
        kinematics.jacobian(theta, points, k),
        kinematics.jacobian_dot(theta, rates, points, speeds, k),
        *kinematics.singularity(theta, points, k),
        kinematics.forearm_swing(points, k),
    ]
    tails = [(3,), (3,), (3,), (8, 3), (3, 3), (3, 3), (3,), (), (3,)]
    assert [result.shape for result in together] == [(*shape, *tail) for tail in tails]
    for index in np.ndindex(shape):
        p, t = points[index], theta[index]
        alone = [
            kinematics.inverse(p, k),
            kinematics.forward(t, k),
            kinematics.forward(t, k, above=True),
            kinematics.inverse_all(p, k),
            kinematics.jacobian(t, p, k),
            kinematics.jacobian_dot(t, rates[index], p, speeds[index], k),
            *kinematics.singularity(t, p, k),
            kinematics.forearm_swing(p, k),
        ]
        for many, one in zip(together, alone, strict=True):
            assert many[index].tobytes() == one.tobytes()


def test_poses_may_be_lists_and_strided_arrays(robot):
    points = workspace_points(robot, 8)
    expected = kinematics.inverse(points[::2], robot.kinematics)
    assert np.array_equal(kinematics.inverse(points[::2].tolist(), robot.kinematics), expected)
    assert np.array_equal(kinematics.inverse(np.asfortranarray(points[::2]), robot.kinematics), expected)


@pytest.mark.parametrize('wrong', [0.3, [0.1, 0.2], [[0.1, 0.2, -0.8, 0.0]], []])
def test_poses_of_another_shape_are_rejected(wrong, robot):
    with pytest.raises(ValueError, match=r'must have shape \(\.\.\., 3\)'):
        kinematics.inverse(wrong, robot.kinematics)


def test_angles_without_their_points_are_broadcast_or_rejected_but_never_read_beyond_the_end(robot):
    k = robot.kinematics
    theta, p = np.full((4, 3), 0.3), kinematics.forward(np.full(3, 0.3), k)
    expected = kinematics.jacobian(theta, np.tile(p, (4, 1)), k)
    try:
        result = kinematics.jacobian(theta, p, k)
    except ValueError:
        return
    assert np.array_equal(result, expected)


def test_the_jacobian_is_the_derivative_of_forward_kinematics(robot):
    k, theta = robot.kinematics, joint_triples(robot, 500)
    j = kinematics.jacobian(theta, kinematics.forward(theta, k), k)
    for i, unit in enumerate(np.eye(3)):
        column = derivative(lambda h, unit=unit: kinematics.forward(theta + h * unit, k))
        assert np.abs(j[:, :, i] - column).max() < DIFFERENCE


def test_the_jacobians_velocities_stretch_no_rod(robot):
    theta = joint_triples(robot, 500)
    p = kinematics.forward(theta, robot.kinematics)
    j = kinematics.jacobian(theta, p, robot.kinematics)
    rates = joint_triples(robot, 500)[::-1]
    plate = np.einsum('nai,ni->na', j, rates)
    elbow_speeds = derivative(lambda h: elbows(theta + h * rates))
    stretch = ((plate[:, None, :] - elbow_speeds) * rods(theta, p)).sum(axis=-1)
    assert np.abs(stretch).max() < DIFFERENCE


def test_jacobian_dot_is_the_jacobians_rate_along_a_motion(robot):
    k, theta = robot.kinematics, joint_triples(robot, 500)
    rates = 3.0 * joint_triples(robot, 500)[::-1]

    def jacobian_at(h):
        return kinematics.jacobian(theta + h * rates, kinematics.forward(theta + h * rates, k), k)

    p = kinematics.forward(theta, k)
    velocity = np.einsum('nai,ni->na', jacobian_at(0.0), rates)
    j_dot = kinematics.jacobian_dot(theta, rates, p, velocity, k)
    assert (
        np.abs(j_dot - derivative(jacobian_at)).max() < 10.0 * DIFFERENCE
    )  # rates of 5 rad/s, to the fourth


def test_the_plates_acceleration_is_that_of_its_second_difference(robot):
    k, theta = robot.kinematics, joint_triples(robot, 500)
    rates, accelerations = 2.0 * theta[::-1], 10.0 * np.roll(theta, 1, axis=0)

    def point_at(t):
        return kinematics.forward(theta + t * rates + 0.5 * t * t * accelerations, k)

    p = point_at(0.0)
    j = kinematics.jacobian(theta, p, k)
    j_dot = kinematics.jacobian_dot(theta, rates, p, np.einsum('nai,ni->na', j, rates), k)
    acceleration = np.einsum('nai,ni->na', j, accelerations) + np.einsum('nai,ni->na', j_dot, rates)
    step = 1e-3  # a second difference divides the rounding by step^2
    near, far = (
        point_at(step) + point_at(-step) - 2.0 * p,
        point_at(2.0 * step) + point_at(-2.0 * step) - 2.0 * p,
    )
    assert np.abs(acceleration - (16.0 * near - far) / (12.0 * step * step)).max() < 10.0 * DIFFERENCE


@pytest.mark.parametrize('arm', [1, 2, 3])
def test_an_unreachable_point_names_the_arm_and_the_point(arm, robot):
    # opposite to the arm, farther from its hip than l_A + l_B = 1.35 m, but within reach of the other two
    away = TURNS[arm - 1] @ [-0.95, 0.0, -0.8]
    with pytest.raises(UnreachableError, match=f'out of reach of arm {arm}$') as caught:
        kinematics.inverse(away, robot.kinematics)
    assert f'({away[0]:g}, {away[1]:g}, -0.8) m' in str(caught.value)
    with pytest.raises(UnreachableError, match=f'^position 2 .* arm {arm}$'):
        kinematics.inverse([[0, 0, -0.8], [0.1, 0, -0.8], away, away], robot.kinematics)
    unsolved = np.isnan(kinematics.inverse_all(away, robot.kinematics))
    assert unsolved[:, arm - 1].all()
    assert np.count_nonzero(unsolved) == 8


def test_point_beyond_rod_length_next_to_an_arm_is_out_of_reach(robot):
    with pytest.raises(UnreachableError, match='arm 1'):
        kinematics.inverse([0.15, 0.951, 0.0], robot.kinematics)


def test_rods_too_short_to_meet_are_named_with_their_angles(robot):
    short = robot.replace(kinematics__forearm_length_m=0.5).kinematics
    with pytest.raises(UnreachableError, match=r'do not meet at arm angles \(0.000, 0.000, 0.000\) deg'):
        kinematics.forward(np.zeros((2, 3)), short)


@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf, 1e200])
@pytest.mark.parametrize('place', [0, 1, 2])
def test_non_finite_position_or_angle_is_unreachable_in_both_directions(value, place, robot):
    p = np.array([0.0, 0.0, -0.8])
    p[place] = value
    with pytest.raises(UnreachableError):
        kinematics.inverse(p, robot.kinematics)
    theta = np.zeros(3)
    theta[place] = value
    if not abs(value) < np.inf:
        with pytest.raises(UnreachableError):
            kinematics.forward(theta, robot.kinematics)


def test_turning_the_plate_by_a_third_hands_the_angles_to_the_next_arm(robot):
    points = workspace_points(robot, 500)
    theta = kinematics.inverse(points, robot.kinematics)
    turned = kinematics.inverse(points @ TURNS[1].T, robot.kinematics)
    assert np.abs(turned - np.roll(theta, 1, axis=-1)).max() < ROUNDING


def test_arms_numbered_in_reverse_carry_the_plate_to_the_same_point(robot):
    clockwise = robot.replace(kinematics__arm_azimuth_deg=(0.0, 240.0, 120.0)).kinematics
    theta = joint_triples(robot, 200)
    expected = kinematics.forward(theta, robot.kinematics)
    assert np.abs(kinematics.forward(theta[:, [0, 2, 1]], clockwise) - expected).max() < ROUNDING


def test_mirroring_the_plate_in_the_plane_of_arm_1_swaps_arms_2_and_3(robot):
    points = workspace_points(robot, 500)
    theta = kinematics.inverse(points, robot.kinematics)
    mirrored = kinematics.inverse(points * [1.0, -1.0, 1.0], robot.kinematics)
    assert np.abs(mirrored - theta[:, [0, 2, 1]]).max() < ROUNDING


def test_positive_angles_point_down_and_the_arm_nearest_to_the_plate_is_raised(robot):
    heights = kinematics.forward(
        np.radians([[-30.0] * 3, [0.0] * 3, [30.0] * 3, [60.0] * 3]), robot.kinematics
    )[:, 2]
    assert (np.diff(heights) < 0.0).all()
    for arm in range(3):
        theta = kinematics.inverse(TURNS[arm] @ [0.3, 0.0, -0.8], robot.kinematics)
        assert np.argmin(theta) == arm


@pytest.mark.parametrize('branch', [0, 1])
def test_a_plate_that_circles_about_the_hip_takes_the_arm_along_rigidly(branch, robot):
    """Above, below and on either side of the hip: one continuous branch, for both signs of z."""
    distance = np.array([0.56, 0.7, 0.95, 1.2, 1.34])[:, None]  # between l_B - l_A and l_B + l_A
    azimuth = np.linspace(-np.pi, np.pi, 721)
    point = [R + distance * np.cos(azimuth), 0.0 * distance * azimuth, -distance * np.sin(azimuth)]
    theta = kinematics.inverse_all(np.stack(point, axis=-1), robot.kinematics)[..., branch, 0]
    offset = np.unwrap(theta - azimuth, axis=-1)
    cosine = (L_A**2 + distance[:, 0] ** 2 - L_B**2) / (2.0 * L_A * distance[:, 0])
    expected = np.arccos(cosine) * (1.0 if branch else -1.0)
    error = np.angle(np.exp(1j * (offset - expected[:, None])))
    assert np.abs(error).max() < 1e3 * ROUNDING  # near stretch and fold the root amplifies the rounding
    assert (theta > -np.pi).all()
    assert (theta <= np.pi).all()


@pytest.mark.parametrize('arm', [0, 1, 2])
def test_the_serial_measure_vanishes_where_arm_and_rod_lie_in_line(arm, robot):
    theta = np.array([0.2, 0.3, 0.4])
    for length in (L_A + L_B, L_A - L_B):  # stretched and folded
        p = TURNS[arm] @ [R + length * np.cos(theta[arm]), 0.0, -length * np.sin(theta[arm])]
        serial, _ = kinematics.singularity(theta, p, robot.kinematics)
        assert serial[arm] == pytest.approx(0.0, abs=ROUNDING)
        assert (np.abs(np.delete(serial, arm)) > 0.1).all()


def test_the_serial_measure_is_positive_on_the_working_branch_and_negative_on_the_other(robot):
    points = workspace_points(robot, 200)
    branches = kinematics.inverse_all(points, robot.kinematics)
    out, _ = kinematics.singularity(branches[:, 0], points, robot.kinematics)
    inward, _ = kinematics.singularity(branches[:, 7], points, robot.kinematics)
    assert (out > 0.0).all()
    assert np.abs(inward + out).max() < ROUNDING


def test_the_parallel_measure_vanishes_with_the_plate_in_the_elbow_plane(robot):
    flat = robot.replace(kinematics__forearm_length_m=R + L_A).kinematics
    _, parallel = kinematics.singularity(np.zeros(3), np.zeros(3), flat)
    assert parallel == pytest.approx(0.0, abs=ROUNDING)


def test_the_parallel_measure_is_six_times_the_tetrahedron_of_elbows_and_plate(robot):
    theta = joint_triples(robot, 200)
    p = kinematics.forward(theta, robot.kinematics)
    _, parallel = kinematics.singularity(theta, p, robot.kinematics)
    corners = elbows(theta)
    a, b, c = (np.linalg.norm(corners[:, n] - corners[:, n - 1], axis=-1) for n in range(3))
    area = 0.25 * np.sqrt((a + b + c) * (-a + b + c) * (a - b + c) * (a + b - c))  # Heron
    height = np.sqrt(L_B**2 - (a * b * c / (4.0 * area)) ** 2)  # above the circumcentre
    assert np.abs(parallel - 2.0 * area * height / L_B**3).max() < ROUNDING


def test_edited_lengths_are_copies(robot):
    own = kinematics.geometry(robot)
    kept = own.copy()
    own['l_a'] += 0.1
    assert kinematics.geometry(robot) == kept
    assert kinematics.geometry(robot.replace(kinematics__upper_arm_length_m=0.31))['l_a'][0, 0] == 0.31
