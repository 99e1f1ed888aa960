"""Tests of the Jacobian experiments (11.2): effect of wrong lengths and singularities on joint velocities."""

import csv
import dataclasses
import json
import math

import numpy as np
import pytest

from delta3_pacdrive import kinematics, parameters, simulation
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.errors import ParameterError, TraceError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording import trace_csv
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.thesis.jacobian import (
    condition,
    figures,
    mapping,
    motion,
    report,
    sensitivity,
    study,
)
from delta3_pacdrive.studies.thesis.jacobian.deviation import Deviation, peaks
from delta3_pacdrive.studies.thesis.jacobian.mapping import LENGTHS, JointMotion, Pose, inexact, joint_motion
from delta3_pacdrive.studies.thesis.jacobian.motion import Signals
from delta3_pacdrive.studies.thesis.jacobian.run import causes, courses
from delta3_pacdrive.studies.thesis.jacobian.study import (
    LATE,
    PRINTED_JACOBIAN_DOT,
    WITHOUT_JACOBIAN_DOT,
)
from thoroughness import some

NUMERICALLY_NIL = (1e-8, 1e-4)  # percent: rounding of 1e-16 m over steps of 1 ms, once and squared
DIFFERENCED = 0.01  # percent of the peaks: the squared cycle time, times what jerks leave
STENCIL = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0  # sixth order
STENCIL_2 = np.array([2.0, -27.0, 270.0, -490.0, 270.0, -27.0, 2.0]) / 180.0
STEP_S = 1e-3
RECORDED_PERCENT = 0.1  # of the peaks: what increments leave of recorded set points


@pytest.fixture(scope='session')
def experiments(robot):
    return [motion.load(number, robot, Signals.COMMAND) for number in ('1', '2', '3')]


@pytest.fixture(scope='session')
def trace(robot):
    return simulation.run(programs.load('experiment3', robot.motion), robot)


@pytest.fixture(scope='session')
def swept(robot):
    return condition.sweep(robot.kinematics)


@pytest.fixture(scope='session')
def studied(tmp_path_factory):
    """Return the folder and the report of a study of experiment 1, as the command makes it."""
    folder = tmp_path_factory.mktemp('jacobian')
    assert main(['jacobian', '1', '--error', 'l_A=0.002', '--output', str(folder)]) == 0
    return folder, json.loads((folder / 'report.json').read_text())


def swinging(robot):
    """Return a motion with derivatives that owe nothing to a Jacobian: angles are sines, TCP by forward kinematics."""
    times = np.arange(0.0, 1.0, 0.01)
    amplitude, rate, phase = (
        np.radians([25.0, 20.0, 30.0]),
        np.array([5.0, 7.0, 6.0]),
        np.array([0.0, 1.0, 2.5]),
    )

    def angles(t):
        return np.radians([15.0, 20.0, 10.0]) + amplitude * np.sin(rate * t[:, None] + phase)

    around = np.stack(
        [kinematics.forward(angles(times + n * STEP_S), robot.kinematics) for n in range(-3, 4)]
    )
    turn = rate * times[:, None] + phase
    return motion.Motion(
        'sines',
        'exact',
        STEP_S,
        times,
        angles(times),
        amplitude * rate * np.cos(turn),
        -amplitude * rate**2 * np.sin(turn),
        around[3],
        np.einsum('k,kna->na', STENCIL, around) / STEP_S,
        np.einsum('k,kna->na', STENCIL_2, around) / STEP_S**2,
    )


def largest(computed, recorded):
    """Return the largest deviations of velocities and accelerations in percent of the peaks."""
    return (
        np.abs(Deviation.of(computed.velocity, recorded.thetadot).of_peak).max(),
        np.abs(Deviation.of(computed.acceleration, recorded.thetaddot).of_peak).max(),
    )


@pytest.mark.parametrize('pose', Pose)
def test_exact_lengths_and_derivatives_give_no_deviation(robot, pose):
    swing = swinging(robot)
    velocity, acceleration = largest(joint_motion(swing, robot.kinematics, pose), swing)
    assert velocity < NUMERICALLY_NIL[0]
    assert acceleration < NUMERICALLY_NIL[1]


def test_with_exact_lengths_only_the_differencing_per_bus_cycle_is_left(robot, experiments):
    for own in experiments:
        assert max(largest(joint_motion(own, robot.kinematics), own)) < DIFFERENCED


def test_error_of_differencing_grows_with_the_square_of_the_cycle_time(robot):
    left = []
    for cycle in (1e-3, 2e-3, 4e-3):
        slow = robot.replace(bus__cycle_time_s=cycle)
        own = motion.load('2', slow, Signals.COMMAND)
        difference = joint_motion(own, slow.kinematics).velocity - own.thetadot
        left.append(np.sqrt(np.mean(difference**2)))
    assert left[1] / left[0] == pytest.approx(4.0, rel=0.1)
    assert left[2] / left[1] == pytest.approx(4.0, rel=0.1)


def test_central_differences_are_parabolas_through_three_points_and_wider_ones_keep_parabolas(robot):
    t = 0.02 * np.arange(40)[:, None]
    values = 1.0 + t * [2.0, -3.0, 0.5] + t**2 * [1.0, 4.0, -2.0]
    for half in (1, 4):
        first, second = motion.derivatives(values, 0.02, half)
        inner = slice(half, -half)
        assert np.allclose(first[inner], ([2.0, -3.0, 0.5] + 2.0 * t * [1.0, 4.0, -2.0])[inner], atol=1e-11)
        assert np.allclose(second[inner], [2.0, 8.0, -4.0], atol=1e-9)
        assert np.isnan(first[:half]).all()
        assert np.isnan(second[-half:]).all()
    noise = np.random.default_rng(1).normal(size=(50, 3))
    first, second = motion.derivatives(noise, 0.1)
    assert np.allclose(first[1:-1], (noise[2:] - noise[:-2]) / 0.2)
    assert np.allclose(second[1:-1], (noise[2:] - 2.0 * noise[1:-1] + noise[:-2]) / 0.01)


def predicted(motion, kinematics, errors, pose):
    """First-order change of the joint motion for errors [m] of several lengths."""
    slopes = [
        (error, sensitivity.slope(motion, kinematics, symbol, pose)) for symbol, error in errors.items()
    ]
    return JointMotion(
        sum(error * slope.velocity for error, slope in slopes),
        sum(error * slope.acceleration for error, slope in slopes),
    )


@pytest.mark.parametrize('pose', Pose)
@pytest.mark.parametrize(
    'errors', [*({symbol: 1e-4} for symbol in LENGTHS), {'l_A': 1e-4, 'l_B': -2e-4, 'R_A': 1e-4, 'R_B': 5e-5}]
)
def test_the_first_order_predicts_the_deviation_of_a_small_error(robot, experiments, pose, errors):
    own = experiments[2]
    exact = joint_motion(own, robot.kinematics, pose)
    found = joint_motion(own, inexact(robot.kinematics, errors), pose)
    expected = predicted(own, robot.kinematics, errors, pose)
    for name in ('velocity', 'acceleration'):
        change = getattr(found, name) - getattr(exact, name)
        rest = np.abs(change - getattr(expected, name)).max()
        assert rest <= 2e-3 * np.abs(change).max()


def test_error_of_the_first_order_grows_with_the_square_of_the_length_error(robot, experiments):
    own = experiments[0]
    exact = joint_motion(own, robot.kinematics).velocity
    rest = []
    for error in (1e-3, 2e-3, 4e-3):
        found = joint_motion(own, inexact(robot.kinematics, {'l_A': error})).velocity
        expected = predicted(own, robot.kinematics, {'l_A': error}, Pose.RECORDED).velocity
        rest.append(np.abs(found - exact - expected).max())
    assert rest[1] / rest[0] == pytest.approx(4.0, rel=0.05)
    assert rest[2] / rest[1] == pytest.approx(4.0, rel=0.05)


def test_the_forearm_does_not_enter_where_angles_and_position_are_recorded(robot, experiments):
    own, longer = experiments[2], inexact(robot.kinematics, {'l_B': 0.1})
    exact = joint_motion(own, robot.kinematics)
    found = joint_motion(own, longer, Pose.RECORDED)
    assert np.array_equal(found.velocity, exact.velocity)
    assert np.array_equal(found.acceleration, exact.acceleration)
    for pose in (Pose.FORWARD, Pose.INVERSE):
        assert largest(joint_motion(own, longer, pose), own)[0] > 1.0


@pytest.mark.parametrize('pose', Pose)
def test_only_the_difference_of_the_radii_counts(robot, experiments, pose):
    own = experiments[0]
    wider = joint_motion(own, inexact(robot.kinematics, {'R_A': 0.003}), pose)
    narrower = joint_motion(own, inexact(robot.kinematics, {'R_B': -0.003}), pose)
    same = joint_motion(own, inexact(robot.kinematics, {'R_A': 0.003, 'R_B': 0.003}), pose)
    assert np.allclose(wider.velocity, narrower.velocity, rtol=1e-12, atol=1e-12)
    assert np.allclose(
        same.velocity, joint_motion(own, robot.kinematics, pose).velocity, rtol=1e-12, atol=1e-12
    )


def test_a_robot_that_is_larger_in_all_lengths_is_slower_by_the_same_share(robot, experiments):
    scale = 1.02
    errors = {symbol: (scale - 1.0) * getattr(robot.kinematics, key) for symbol, key in LENGTHS.items()}
    own = experiments[0]
    larger = dataclasses.replace(own, tcp=scale * own.tcp)
    found = joint_motion(larger, inexact(robot.kinematics, errors))
    exact = joint_motion(own, robot.kinematics)
    assert np.allclose(found.velocity, exact.velocity / scale, rtol=1e-10, atol=1e-12)


def test_a_radius_35_mm_off_reproduces_the_deviations_of_the_thesis(robot, experiments):
    wrong = inexact(robot.kinematics, study.ERRORS_M)
    first, second, third = (largest(joint_motion(own, wrong), own)[0] for own in experiments)
    assert 8.0 < first < 11.0
    assert 4.0 < second < 7.0
    assert 8.0 < third < 11.0


def test_the_ellipse_deviates_least_whichever_length_is_off(robot, experiments):
    for symbol in LENGTHS:
        for pose in Pose:
            wrong = inexact(robot.kinematics, {symbol: 1e-3})
            first, second, third = (largest(joint_motion(own, wrong, pose), own)[0] for own in experiments)
            assert second <= min(first, third)


def test_momentary_percentages_are_small_denominators(robot, experiments):
    own = experiments[2]
    wrong = joint_motion(own, inexact(robot.kinematics, {'R_A': 0.001}))
    deviation = Deviation.of(wrong.velocity, own.thetadot)
    place = np.unravel_index(np.nanargmax(np.abs(deviation.momentary)), own.theta.shape)
    assert abs(own.thetadot[place]) < 0.06 * peaks(own.thetadot)[place[1]]
    assert abs(deviation.momentary[place]) > 10.0 * np.abs(deviation.of_peak).max()


def test_percentages_match_their_names():
    recorded = np.array([[2.0, -1.0, 1e-6], [0.05, 0.5, 0.0], [-4.0, 0.0, 0.0]])
    calculated = recorded + np.array([[0.2, 0.1, 0.0], [0.2, 0.0, 0.0], [0.0, 0.1, 0.01]])
    deviation = Deviation.of(calculated, recorded)
    assert np.allclose(deviation.of_peak, [[5.0, 10.0, 0.0], [5.0, 0.0, 0.0], [0.0, 10.0, 25.0]])
    expected = [[10.0, -10.0, np.nan], [np.nan, 0.0, np.nan], [0.0, np.nan, np.nan]]
    assert np.allclose(deviation.momentary, expected, equal_nan=True)
    assert deviation.summary()['momentary']['max'] == pytest.approx(10.0)
    peak = deviation.summary()['of_peak']
    assert peak['max'] == pytest.approx(25.0)
    assert peak['rms'] == pytest.approx(math.sqrt((25.0 + 100.0 + 25.0 + 100.0 + 625.0) / 9.0))
    assert peak['max_of_joints'] == pytest.approx([5.0, 10.0, 25.0])


def test_stated_error_causes_the_deviation(robot, experiments):
    for own in experiments[1:]:
        for row in sensitivity.sensitivities(own, robot.kinematics):
            if row.needed_of_peak_m is None:
                assert row.symbol in ('l_B', 'R_B')
                continue
            found = joint_motion(own, inexact(robot.kinematics, {row.symbol: row.needed_of_peak_m}), row.pose)
            difference = found.velocity - joint_motion(own, robot.kinematics, row.pose).velocity
            percent = 100.0 * np.abs(difference / peaks(own.thetadot)).max()
            assert percent == pytest.approx(own.thesis.deviation_percent, rel=0.01)


def test_every_length_1_mm_off_is_the_worst_that_signs_can_make(robot, experiments):
    own = experiments[0]
    bound = sensitivity.tolerance(own, robot.kinematics, Pose.FORWARD)
    found = []
    for number in range(16):
        errors = {symbol: (-1.0) ** (number >> i) * 1e-3 for i, symbol in enumerate(LENGTHS)}
        found.append(largest(joint_motion(own, inexact(robot.kinematics, errors), Pose.FORWARD), own))
    worst = np.max(found, axis=0)
    assert worst[0] == pytest.approx(bound['velocity']['of_peak'], rel=0.05)
    assert worst[1] <= 1.05 * bound['acceleration']['of_peak']


def test_omission_of_velocity_terms_matters_only_in_motion(robot, experiments):
    own = experiments[0]
    resting = dataclasses.replace(own, tcp_velocity=np.zeros_like(own.tcp))
    right = joint_motion(resting, robot.kinematics).acceleration
    for wrong in (mapping.without_jacobian_dot, mapping.with_printed_jacobian_dot):
        assert np.allclose(wrong(resting, robot.kinematics), right, atol=1e-9)
    found = {(cause.name, cause.quantity): cause.of_peak for cause in causes(own, robot.kinematics)}
    assert 10.0 < found[WITHOUT_JACOBIAN_DOT, 'acceleration'] < found[PRINTED_JACOBIAN_DOT, 'acceleration']
    assert 1.0 < found[LATE, 'velocity'] < 3.0


def test_a_cycle_between_tcp_and_joints_deviates_by_acceleration_times_cycle(robot, experiments):
    own = experiments[1]
    (late,) = (c for c in causes(own, robot.kinematics) if c.name == LATE and c.quantity == 'velocity')
    expected = 100.0 * np.abs(own.thetaddot * 1e-3 / peaks(own.thetadot)).max()
    assert late.of_peak == pytest.approx(expected, rel=0.02)


def test_a_ray_straight_down_ends_where_all_arms_are_stretched(robot):
    k = robot.kinematics
    start = np.array([[0.0, 0.0, -0.8]])
    reach = math.sqrt((k.upper_arm_length_m + k.forearm_length_m) ** 2 - k.radius_difference_m**2)
    (length,) = condition.limits(start, np.array([[0.0, 0.0, -1.0]]), k)
    assert length == pytest.approx(reach - 0.8, abs=1e-9)


def test_rays_end_at_the_first_singularity_of_either_kind(swept):
    last = swept.gap_m < condition.GAP_MIN  # no ray is longer than 1 m
    assert swept.serial_end.any()
    assert not swept.serial_end.all()
    assert swept.serial[last & swept.serial_end].max() < 0.05
    assert swept.parallel[last & ~swept.serial_end].max() < 0.05
    assert swept.condition[last].min() > 50.0


def test_no_direction_deviates_more_than_the_worst_one_and_some_nearly_as_much(robot):
    k, error = robot.kinematics, 1e-6
    tcp = np.array([[0.3, 0.2, -0.85]])
    theta = kinematics.inverse(tcp, k)
    thetadot = np.random.default_rng(3).normal(size=(4000, 3))
    velocity = mapping.product(np.broadcast_to(kinematics.jacobian(theta, tcp, k), (4000, 3, 3)), thetadot)
    for symbol, key in LENGTHS.items():
        wrong = dataclasses.replace(k, **{key: getattr(k, key) + error})
        j = kinematics.jacobian(*mapping.posed(theta, tcp, wrong, Pose.FORWARD), wrong)
        found = mapping.solve(np.broadcast_to(j, (4000, 3, 3)), velocity) - thetadot
        share = 100.0 * np.linalg.norm(found, axis=1) / np.linalg.norm(thetadot, axis=1) * 1e-3 / error
        worst = condition.along(tcp, np.array([[1.0, 0.0, 0.0]]), k).per_mm[Pose.FORWARD][0]
        bound = worst[list(LENGTHS).index(symbol)]
        assert 0.98 * bound < share.max() <= 1.001 * bound


def test_the_deviation_keeps_the_bound_by_the_condition(robot, swept):
    """|J^-1 dJ| <= cond(J) |dJ|/|J|, with dJ from the kinematics, pose by pose."""
    k, step = robot.kinematics, 1e-7
    theta = kinematics.inverse(swept.tcp, k)
    j = kinematics.jacobian(theta, swept.tcp, k)
    for n, symbol in enumerate(LENGTHS):
        longer, shorter = (
            kinematics.jacobian(theta, swept.tcp, inexact(k, {symbol: sign * step})) for sign in (1.0, -1.0)
        )
        change = 0.1 * (longer - shorter) / (2.0 * step)  # percent per millimetre
        relative = np.linalg.norm(change, 2, axis=(1, 2)) / np.linalg.norm(j, 2, axis=(1, 2))
        assert (swept.per_mm[Pose.RECORDED][:, n] <= 1.01 * swept.condition * relative + 1e-9).all()


@pytest.mark.parametrize('pose', Pose)
def test_the_deviation_grows_along_an_approach_to_the_limit_of_the_workspace(robot, pose):
    ray = condition.along(np.array([[0.0, 0.0, -0.825]]), np.array([[0.0, 1.0, 0.0]]), robot.kinematics)
    near = ray.condition > 4.0
    assert (np.diff(ray.condition[near]) > 0.0).all()
    assert (np.diff(ray.total(pose)[near]) > 0.0).all()
    assert ray.total(pose)[-1] > 50.0 * ray.total(pose)[0]


def test_the_deviation_grows_with_the_condition_and_faster_where_the_pose_is_solved_for(swept):
    powers = condition.exponents(swept)
    assert powers['recorded']['serial'] == pytest.approx(1.0, abs=0.15)
    assert powers['recorded']['parallel'] == pytest.approx(1.0, abs=0.15)
    assert powers['inverse']['serial'] > 1.5  # angles at a serial singularity have an infinite slope
    assert powers['forward']['parallel'] > 1.5  # positions at a parallel one
    for pose in Pose:
        medians = [row[pose.value]['median'] for row in condition.decades(swept)]
        assert (np.diff(medians) > 0.0).all()


def test_inside_the_workspace_the_condition_explains_little(robot):
    inside = condition.workspace(robot.kinematics)
    assert inside['condition']['max'] < 4.5
    assert inside['recorded']['largest'] < 1.5 * inside['recorded']['least']


def test_recorded_set_points_reproduce_the_program_up_to_increments(robot, trace, experiments):
    recorded = motion.of_trace(trace, robot, Signals.COMMAND, 'recording')
    velocity, acceleration = largest(joint_motion(recorded, robot.kinematics), recorded)
    assert velocity < RECORDED_PERCENT
    assert acceleration < 2.0 * RECORDED_PERCENT
    wrong = inexact(robot.kinematics, {'l_A': 0.01})
    program = largest(joint_motion(experiments[2], wrong), experiments[2])
    assert largest(joint_motion(recorded, wrong), recorded) == pytest.approx(program, rel=0.05)


@pytest.mark.parametrize(('signals', 'percent'), [(Signals.ACTUAL, 1.0), (Signals.TRUE, RECORDED_PERCENT)])
def test_measured_joint_speeds_are_those_of_the_measured_tcp(robot, trace, signals, percent):
    measured = motion.of_trace(trace, robot, signals, 'recording')
    assert largest(joint_motion(measured, robot.kinematics), measured)[0] < percent


def test_errors_of_the_built_arms_show_in_the_true_motion_only(robot):
    built = parameters.load('rich')
    run = simulation.run(programs.load('experiment3', built.motion), built)
    told, true = (motion.of_trace(run, built, signals, 'rich') for signals in (Signals.COMMAND, Signals.TRUE))
    assert largest(joint_motion(told, built.kinematics), told)[0] < RECORDED_PERCENT
    assert largest(joint_motion(true, built.kinematics), true)[0] > RECORDED_PERCENT / 2.0


def test_gaps_of_a_recording_are_left_out_without_effect_on_the_rest(robot, trace):
    keep = np.ones(len(trace.time_s), dtype=bool)
    keep[400:460] = False
    holed = Trace(
        trace.time_s[keep], {name: values[keep] for name, values in trace.signals.items()}, trace.meta
    )
    whole = motion.of_trace(trace, robot, Signals.COMMAND, 'whole')
    rest = motion.of_trace(holed, robot, Signals.COMMAND, 'holed')
    assert len(whole.time_s) - len(rest.time_s) == 60 + 2 * motion.WINDOW
    shared = np.isin(np.rint(whole.time_s * 1e3), np.rint(rest.time_s * 1e3))
    assert np.allclose(whole.thetaddot[shared], rest.thetaddot)


def test_csv_file_gives_the_same_result_as_the_trace(robot, trace, tmp_path):
    trace_csv.write(trace, tmp_path / 'run.csv')
    trace.save(tmp_path / 'run.npz')
    a, b = (motion.load(str(tmp_path / name), robot, Signals.COMMAND) for name in ('run.csv', 'run.npz'))
    assert a.name == b.name == 'run'
    assert np.allclose(a.thetadot, b.thetadot)
    assert np.allclose(a.tcp_acceleration, b.tcp_acceleration)


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (lambda t: Trace(t.time_s, {'tcp_command': t['tcp_command']}, t.meta), 'no signal motor_command'),
        (lambda t: Trace(t.time_s, t.signals, t.meta | {'gear_ratio': 20.0}), 'gear ratio 20'),
        (lambda t: Trace(t.time_s[:5], {n: v[:5] for n, v in t.signals.items()}, t.meta), 'has 5 samples'),
        (lambda t: Trace(t.time_s**1.1, t.signals, {}), 'not evenly spaced'),
        (
            lambda t: Trace(t.time_s[:100], {n: v[:100] for n, v in t.signals.items()}, {}),
            'no joint moves faster than 0.001 rad/s',
        ),
    ],
)
def test_unsuitable_recording_is_rejected_with_a_message(robot, trace, change, message):
    with pytest.raises(TraceError, match=message):
        motion.of_trace(change(trace), robot, Signals.COMMAND, 'recording')


@pytest.mark.parametrize(
    ('errors', 'message'), [({'l_C': 0.1}, 'l_C is not a length'), ({'R_B': -0.06}, 'R_B would be')]
)
def test_error_of_an_unknown_length_is_rejected(robot, errors, message):
    with pytest.raises(ParameterError, match=message):
        inexact(robot.kinematics, errors)


def test_the_figures_bear_the_numbers_of_the_thesis(robot, experiments):
    names = []
    for own in experiments:
        nothing = JointMotion(own.thetadot, own.thetaddot)
        trial = study.Trial(own, nothing, nothing, own.time_s, own.time_s, [], {}, [])
        names += list(figures.of_trial(trial, 'errors'))
    assert [int(name.split('_')[2]) for name in names] == list(range(25, 46))
    assert names[3] == 'figure_11_28_velocity_deviation.png'
    assert names[18] == 'figure_11_43_acceleration_of_joint_1.png'


def test_study_writes_report_tables_and_figures_with_their_origin(studied):
    folder, document = studied
    assert {path.name for path in folder.iterdir()} == {path.split('/')[-1] for path in document['files']}
    assert document['provenance']['command'].startswith('delta3 jacobian 1 --error l_A=0.002')
    for name in ('signals', 'sensitivities', 'condition'):
        lines = (folder / f'{name}.csv').read_text().splitlines()
        comments = [line for line in lines if line.startswith('#')]
        assert comments[0].startswith('# command: delta3 jacobian 1')
        rows = list(csv.reader(lines[len(comments) :]))
        assert all(len(row) == len(rows[0]) for row in rows)
        assert len(rows) > 12
    for path in folder.glob('*.png'):
        assert b'delta3 jacobian 1' in path.read_bytes()


def test_other_causes_are_drawn_with_the_inexact_lengths_and_exceed_them(experiments, robot):
    own, exact = experiments[0], robot.kinematics
    wrong = joint_motion(own, inexact(exact, {'R_A': 0.035}))
    found = causes(own, exact)
    trial = study.Trial(own, joint_motion(own, exact), wrong, own.time_s, own.time_s, [], {}, found)
    velocity, acceleration = figures.causes([trial], 'R_A + 35 mm').axes
    heights = [[bar.get_height() for bar in axes.patches] for axes in (velocity, acceleration)]
    assert [len(own) for own in heights] == [2, 4]
    assert heights[0][0] == pytest.approx(9.9, abs=0.1)
    assert heights[1][3] == pytest.approx(54.0, abs=1.0)
    assert max(heights[1]) == heights[1][3] > 5.0 * heights[1][0]
    assert 'Errors of centimetres are implausible' in acceleration.get_xlabel()


def test_figures_draw_the_other_causes_over_time_and_report_that_none_reaches_35_mm(experiments, robot):
    own, exact = experiments[2], robot.kinematics
    wrong = joint_motion(own, inexact(exact, {'R_A': 0.035}))
    found = courses(own, exact)
    trial = study.Trial(own, joint_motion(own, exact), wrong, own.time_s, own.time_s, [], {}, [], found)
    told = report.plausibility({'R_A': 0.035})
    assert told == 'An error of 35 mm is implausible.'
    assert report.plausibility({'l_A': 0.002}) == ''
    velocity = figures.velocity_deviation(trial, 'R_A + 35 mm', told)
    assert velocity.get_suptitle().startswith('Figure 11.42: ')
    assert LATE in [line.get_label() for line in velocity.axes[0].get_lines()]
    assert any(told in axes.get_xlabel() for axes in velocity.axes)
    highest = {}
    for joint in (1, 2, 3):
        figure = figures.joint_acceleration(trial, joint, 'R_A + 35 mm', told)
        assert figure.get_suptitle().startswith(f'Figure 11.{42 + joint}: ')
        assert told in figure.axes[1].get_xlabel()
        for line in figure.axes[1].get_lines()[2:]:
            seen = float(np.nanmax(np.abs(line.get_ydata())))
            highest[line.get_label()] = max(seen, highest.get(line.get_label(), 0.0))
    assert highest[PRINTED_JACOBIAN_DOT] == pytest.approx(74.0, abs=1.0)
    assert highest[WITHOUT_JACOBIAN_DOT] == pytest.approx(38.0, abs=1.0)
    assert 1.0 < highest[LATE] < 10.0
    # over time and as the largest they are the same
    assert {c.name: c.of_peak for c in causes(own, exact) if c.quantity == 'acceleration'} == pytest.approx(
        highest
    )


def test_study_of_one_trajectory_reports_its_deviations(studied, robot, experiments):
    _, document = studied
    (row,) = document['trajectories']
    wrong = joint_motion(experiments[0], inexact(robot.kinematics, {'l_A': 0.002}))
    velocity, acceleration = largest(wrong, experiments[0])
    assert row['inexact']['velocity']['of_peak']['max'] == pytest.approx(velocity)
    assert row['inexact']['acceleration']['of_peak']['max'] == pytest.approx(acceleration)
    assert len(row['sensitivities']) == len(Pose) * len(LENGTHS)
    assert f'{report.number(velocity)} % of their peaks (thesis: 10)' in document['findings'][1]


@pytest.mark.parametrize(
    ('arguments', 'status', 'sentence'),
    [
        (['nowhere.npz'], 1, 'there is no recording nowhere.npz'),
        (['nowhere'], 1, 'cannot read program file'),
        (['1', '--error', 'R_B=-0.06'], 1, 'R_B would be -0.01 m'),
        (['1', '--error', 'l_A=5'], 1, 'the error of l_A is 5 m, but must be between -0.1 and 0.1 m'),
        (['1', '--error', 'l_B=-0.1001'], 1, 'the error of l_B is -0.1001 m, but must be'),
        (['1', '--error', 'l_A=0.01', '--error', 'l_A=0.02'], 2, '--error l_A is given twice'),
        (['1', '--error', 'l_A'], 2, "'l_A' is not an error of a length"),
        (['1', '--error', 'x=1'], 2, "'x=1' is not an error of a length"),
        (['1', '--pose', 'guessed'], 2, 'invalid choice'),
        (['1', 'experiment1'], 1, 'two inputs have the name experiment 1'),
    ],
)
def test_invalid_input_is_rejected_with_a_message(arguments, status, sentence, capsys, tmp_path):
    try:
        found = main(['jacobian', *arguments, '--output', str(tmp_path)])
    except SystemExit as stop:
        found = stop.code
    assert found == status
    assert sentence in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('signals', some(['actual', 'true'], ['true']))
def test_command_compares_the_requested_signals_and_pose(signals, robot, trace, tmp_path, capsys):
    trace.save(tmp_path / 'run.npz')
    arguments = ['--signals', signals, '--pose', 'inverse', '--error', 'R_A=0.01', '--error', 'l_A=-0.002']
    assert (
        main(['jacobian', str(tmp_path / 'run.npz'), *arguments, '--output', str(tmp_path / 'o'), '--json'])
        == 0
    )
    (row,) = json.loads(capsys.readouterr().out)['trajectories']
    own = motion.of_trace(trace, robot, Signals(signals), 'run')
    wrong = joint_motion(own, inexact(robot.kinematics, {'R_A': 0.01, 'l_A': -0.002}), Pose.INVERSE)
    velocity, acceleration = largest(wrong, own)
    assert row['inexact']['velocity']['of_peak']['max'] == pytest.approx(velocity, rel=1e-9)
    assert row['inexact']['acceleration']['of_peak']['max'] == pytest.approx(acceleration, rel=1e-9)
    # other signals and another pose would have told something else
    for others, pose in (('command', Pose.INVERSE), (signals, Pose.RECORDED)):
        different = motion.of_trace(trace, robot, Signals(others), 'run')
        changed = joint_motion(different, inexact(robot.kinematics, {'R_A': 0.01, 'l_A': -0.002}), pose)
        assert abs(largest(changed, different)[0] / velocity - 1.0) > 1e-5
