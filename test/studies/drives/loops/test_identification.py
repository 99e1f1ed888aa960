"""Tests of the quality of a measured response, its excitation, and the names of loads."""

import math

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.robot.drive.excitation import multisine
from delta3_pacdrive.studies.drives.loops.analysis import exchanged_shaft
from delta3_pacdrive.studies.drives.loops.identification import Measured, opened, response
from delta3_pacdrive.studies.drives.loops.load import extremes, load_at
from delta3_pacdrive.studies.thesis.jacobian import condition
from delta3_pacdrive.studies.thesis.jacobian.mapping import (
    LENGTHS,
    Pose,
    inexact,
    product,
    solve,
    with_printed_jacobian_dot,
)
from delta3_pacdrive.studies.thesis.jacobian.motion import Signals, load

GEAR = 32.0


def measured(frequencies, coherence, averages=8, values=None, **fields):
    frequencies = np.asarray(frequencies, dtype=np.float64)
    values = np.ones(len(frequencies), np.complex128) if values is None else values
    return Measured(frequencies, values, np.broadcast_to(coherence, frequencies.shape), averages, **fields)


def test_the_error_of_a_response_is_its_spread_over_many_estimates():
    """White noise added to a gain of 1: the reported standard deviation against that of 400 estimates."""
    print('seed 8')
    generator = np.random.default_rng(8)
    piece, pieces = 64, 16
    found = []
    for _ in range(400):
        x = generator.standard_normal(piece * pieces)
        y = x + generator.standard_normal(piece * pieces)
        found.append(response(x, y, 1e-3, piece, lines=np.arange(4, 28)))
    spread = np.std([np.abs(one.values) for one in found], axis=0).mean()
    told = np.mean([one.error for one in found])
    assert told == pytest.approx(spread, rel=0.1)
    # by the book: a coherence of a half in n pieces
    assert measured([1.0], 0.5).error == pytest.approx(math.sqrt(0.5 / (2.0 * 8.0 * 0.5)))


def test_a_response_is_trusted_where_its_error_is_small_and_enough_of_it_follows():
    many = 10_000  # averages that make any error small
    assert measured([1.0, 2.0, 3.0], np.array([0.9, 0.51, 0.49]), many).trusted.tolist() == [
        True,
        True,
        False,
    ]
    assert measured([1.0], 0.9, 8).trusted.tolist() == [False]


def test_the_trusted_band_is_the_longest_in_octaves():
    frequencies = np.array([1.0, 2.0, 4.0, 50.0, 100.0, 150.0, 199.0])
    coherence = np.array([0.99, 0.99, 0.99, 0.1, 0.99, 0.99, 0.99])
    assert measured(frequencies, coherence, 10_000).band_hz() == (1.0, 4.0)
    assert measured(frequencies, 0.1, 10_000).band_hz() is None


def test_small_open_loop_is_less_certain_than_its_sensitivity():
    sensitivity = measured([1.0, 2.0], 0.99, values=np.array([0.5, 0.9], np.complex128))
    loop = opened(sensitivity)
    assert loop.values == pytest.approx(np.array([1.0, 1.0 / 9.0]))
    # dL/L = dS/S / (S - 1)
    assert loop.error / sensitivity.error == pytest.approx(np.array([2.0, 10.0]))


def test_a_multisine_has_its_rms_at_its_lines_and_little_crest():
    one = multisine(0.5, 1e-3, 200.0, 0.7, 4.0)
    values = one.periods(1)
    assert math.sqrt((values**2).mean()) == pytest.approx(0.7, rel=1e-12)
    assert np.abs(values).max() < 4.0 * 0.7  # 28 lines of equal phase would add up to 7.5 times their rms
    size = np.abs(np.fft.rfft(values)) / len(values)
    lines = np.flatnonzero(size > 1e-9)
    assert lines.tolist() == one.lines.tolist()
    assert size[lines] == pytest.approx(np.full(len(lines), size[lines[0]]), rel=1e-9)
    assert one.frequencies_hz[[0, -1]].tolist() == [4.0, 200.0]


def test_a_drive_that_exchanges_believes_in_the_inertia_of_p_0_0022(robot):
    shaft = exchanged_shaft(robot, load_at((0.0, 0.0, -0.8), 0, robot), 10.0)
    assert shaft.believed_kg_m2 == pytest.approx(0.9425 / GEAR**2)
    assert shaft.exchange_period_s == 1e-3


def test_the_lightest_mode_is_lighter_than_the_heaviest_and_both_are_eigenvalues(robot):
    lightest, heaviest = extremes(robot)
    assert lightest.name.startswith('lightest mode')
    assert heaviest.name.startswith('heaviest mode')
    # the study's range of the eigenvalues of A, on another grid
    assert lightest.inertia_kg_m2 * GEAR**2 == pytest.approx(0.309, rel=5e-3)
    assert heaviest.inertia_kg_m2 * GEAR**2 == pytest.approx(1.576, rel=0.03)
    theta = kinematics.inverse((0.0, 0.0, -0.8), robot.kinematics)
    values = np.linalg.eigvalsh(dynamics.mass_matrix(theta, robot)) / GEAR**2
    assert lightest.inertia_kg_m2 <= values[0] <= values[-1] <= heaviest.inertia_kg_m2


def test_errors_of_lengths_that_are_independent_add_up_by_their_squares(robot):
    point = np.array([[0.2, 0.15, -0.83]])
    theta = kinematics.inverse(point, robot.kinematics)
    j = kinematics.jacobian(theta, point, robot.kinematics)[0]
    squares = 0.0
    for symbol in LENGTHS:
        h = 1e-6
        changed = [
            np.linalg.solve(
                kinematics.jacobian(theta, point, inexact(robot.kinematics, {symbol: step}))[0], j
            )
            for step in (h, -h)
        ]
        per_metre = (changed[0] - changed[1]) / (2.0 * h)
        # the largest singular value, in per cent for a millimetre
        squares += (100.0 * 1e-3 * np.linalg.svd(per_metre, compute_uv=False)[0]) ** 2
    worst = condition.worst_direction(theta, point, robot.kinematics, Pose.RECORDED)
    assert worst[0] == pytest.approx(math.sqrt(squares), rel=1e-6)


def test_equation_4_15_as_printed_has_a_wrong_sign(robot):
    """Jdot' = S^-1 (Ddot + Sdot J), from S, D and their differences along the motion."""
    motion = load('1', robot, Signals.COMMAND)
    rows = slice(100, 900, 50)
    k = robot.kinematics
    theta, tcp, rate, velocity = (
        values[rows] for values in (motion.theta, motion.tcp, motion.thetadot, motion.tcp_velocity)
    )
    h = 1e-6

    def matrices(angles, points):
        alpha = np.radians(k.arm_azimuth_deg)
        u = np.stack([np.cos(alpha), np.sin(alpha), 0.0 * alpha], axis=-1)
        up = np.array([0.0, 0.0, 1.0])
        c, s = np.cos(angles)[..., None], np.sin(angles)[..., None]
        l_a, r = k.upper_arm_length_m, k.base_radius_m - k.plate_radius_m
        forearm = points[:, None] - ((r + l_a * c) * u - l_a * s * up)
        tangent = -l_a * (s * u + c * up)
        return forearm, (forearm * tangent).sum(axis=-1)[..., None] * np.eye(3)

    (s1, d1), (s0, d0) = (
        matrices(theta + sign * h * rate, tcp + sign * h * velocity) for sign in (1.0, -1.0)
    )
    s, _ = matrices(theta, tcp)
    j = kinematics.jacobian(theta, tcp, k)
    printed = np.linalg.solve(s, (d1 - d0) / (2.0 * h) + (s1 - s0) / (2.0 * h) @ j)
    joint = solve(j, velocity)
    expected = solve(j, motion.tcp_acceleration[rows] - product(printed, joint))
    found = with_printed_jacobian_dot(motion, k)[rows]
    # joint velocities are differences of set points: what they leave of the exact ones shows here
    assert found == pytest.approx(expected, rel=1e-4, abs=1e-3)
