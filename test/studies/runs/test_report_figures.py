"""Tests of figures in reports against independent computations."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from delta3_pacdrive import dynamics, kinematics, simulation
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.studies.drives.loops.load import friction_slope, load_at
from delta3_pacdrive.studies.drives.loops.response import bandwidth, margins, step_figures
from delta3_pacdrive.studies.drives.tuning import drive_settings as settings
from delta3_pacdrive.studies.drives.tuning import effect
from delta3_pacdrive.studies.estimation.problem import Block, Problem
from delta3_pacdrive.studies.estimation.quantities import TABLE
from delta3_pacdrive.studies.estimation.solver import fit
from delta3_pacdrive.studies.framework.columns import to_dict
from delta3_pacdrive.studies.thesis.experiments.attribution import EFFECTS, Attribution, outcome_of
from delta3_pacdrive.studies.thesis.experiments.compared_signals import QUANTITIES, Run
from delta3_pacdrive.studies.thesis.experiments.comparison import Comparison
from delta3_pacdrive.studies.thesis.experiments.conclusions import conclusions
from delta3_pacdrive.studies.thesis.jacobian import report as jacobian_report
from delta3_pacdrive.studies.thesis.jacobian.deviation import THRESHOLD, Deviation, figures, peaks
from delta3_pacdrive.studies.thesis.jacobian.mapping import Pose
from delta3_pacdrive.studies.thesis.jacobian.motion import Signals, load
from delta3_pacdrive.studies.thesis.jacobian.sensitivity import sensitivities, slope

EXACT = 1e-12
GRID = 2e-3  # of margins that are interpolated between 4000 frequencies


# jacobian


def test_figures_of_percentages_are_maximum_root_mean_square_and_95th_percentile():
    values = np.array([[3.0, -4.0, 0.0], [1.0, 0.5, -12.0], [0.25, 2.0, np.nan], [6.0, -7.0, 8.0]])
    magnitudes = sorted(abs(v) for v in values.ravel() if v == v)
    found = figures(values)
    assert found['max'] == 12.0
    assert found['rms'] == pytest.approx(math.sqrt(sum(v * v for v in magnitudes) / 11), rel=EXACT)
    # between the 10th and the 11th of eleven values, halfway
    assert found['p95'] == pytest.approx(0.5 * (magnitudes[-2] + magnitudes[-1]), rel=EXACT)
    assert found['max_of_joints'] == [6.0, 7.0, 12.0]


def test_percentages_are_of_the_recorded_peak_and_of_recorded_values_above_the_threshold():
    recorded = np.array([[10.0, 1.0, 5.0], [-20.0, 2.0, 0.9 * THRESHOLD * 8.0], [0.0, -4.0, 8.0]])
    found = Deviation.of(2.0 * recorded + 1.0, recorded)
    assert found.of_peak == pytest.approx(100.0 * (recorded + 1.0) / np.array([20.0, 4.0, 8.0]), rel=EXACT)
    expected = 100.0 * (recorded + 1.0) / np.where(recorded == 0.0, np.nan, recorded)
    expected[1, 2] = np.nan  # below 5 % of the peak
    np.testing.assert_allclose(found.momentary, expected, rtol=EXACT)


@pytest.fixture(scope='module')
def motion(robot):
    return load('1', robot, Signals.COMMAND)


def test_sensitivities_are_percent_per_millimetre_and_per_percent(motion, robot):
    rows = [row for row in sensitivities(motion, robot.kinematics) if row.pose == Pose.RECORDED]
    assert {row.symbol for row in rows} == {'l_A', 'l_B', 'R_A', 'R_B'}
    for row in rows:
        change = slope(motion, robot.kinematics, row.symbol, Pose.RECORDED)
        for share, values, recorded in (
            (row.velocity, change.velocity, motion.thetadot),
            (row.acceleration, change.acceleration, motion.thetaddot),
        ):
            percent = 100.0 * 1e-3 * values / peaks(recorded)
            assert share.of_peak == pytest.approx(np.abs(percent).max(), rel=EXACT)
            assert share.of_peak_rms == pytest.approx(math.sqrt((percent**2).mean()), rel=EXACT)
    # a percent of 400, 950, 200 and 50 mm
    percent_mm = {'l_A': 4.0, 'l_B': 9.5, 'R_A': 2.0, 'R_B': 0.5}
    for row in rows:
        assert row.velocity_relative.of_peak == pytest.approx(percent_mm[row.symbol] * row.velocity.of_peak)


def of_peak(velocity, acceleration):
    values = {'velocity': velocity, 'acceleration': acceleration}
    return {name: {'of_peak': {'max': value}, 'momentary': {'max': 0.0}} for name, value in values.items()}


CAUSES = {
    jacobian_report.LATE: 1.5,
    jacobian_report.WITHOUT_JACOBIAN_DOT: 2.5,
    jacobian_report.PRINTED_JACOBIAN_DOT: 3.5,
}
NEEDED = {'needed_of_peak_m': 0.01, 'needed_momentary_m': 0.002, 'target_percent': 10.0}


def test_message_on_inexact_lengths_names_them():
    row = {
        'exact': of_peak(0.011, 0.022),
        'inexact': of_peak(7.7, 8.8),
        'every_length_1_mm_off': {'velocity': {'of_peak': 0.5, 'momentary': 3.3}},
        'thesis_percent': 10.0,
        'condition': {'min': 1.25, 'max': 2.25},
        'sensitivities': [
            {'pose': 'recorded', 'symbol': symbol, 'velocity': {'of_peak': 1.0}} | NEEDED
            for symbol in ('l_A', 'l_B', 'R_A', 'R_B')
        ],
        'other_causes': [{'name': name, 'of_peak': share} for name, share in CAUSES.items()],
    }
    result = {
        'trajectories': [row],
        'pose': 'recorded',
        'signals': 'command',
        'errors_m': {'R_A': 0.035},
        'condition': {
            'workspace': {'condition': {'max': 4.4}, 'recorded': {'least': 0.1, 'largest': 0.9}},
            'decades': [{'recorded': {'median': 6.6}}],
            'exponents': {'recorded': {'all': 1.01}},
        },
    }
    exact, inexact, tolerance, needed, causes, condition = jacobian_report.conclusions(result)
    assert 'velocities deviate by at most 0.011 %, accelerations by 0.022 %' in exact
    assert inexact == (
        'With R_A +35 mm the velocities deviate by 7.7 % of their peaks (thesis: 10), the accelerations by 8.8 %.'
    )
    assert 'at most 0.5 % of the peak velocities, but 3.3 % of momentary ones above 5 %' in tolerance
    assert 'an error of l_A 10 mm (2 mm)' in needed
    assert 'deviate by 2.5 % of their peaks, (4.15) as printed by 3.5 %' in causes
    assert 'the velocities by 1.5 %' in causes
    assert 'cond(J) is 1.25 to 2.25, in the workspace up to 4.40' in condition


# tuning


@pytest.mark.parametrize('speed', [0.0, 0.5, -1.5, 4.0, 200.0])
def test_the_slope_of_the_friction_is_its_derivative(speed, robot):
    built = robot.replace(motor__friction_smoothing_rad_s=2.0)
    m = built.motor

    def friction(w):
        return m.static_friction_n_m * math.tanh(w / 2.0) + m.viscous_friction_n_m_s_rad * w

    h = 1e-4
    assert friction_slope(speed, built) == pytest.approx(
        (friction(speed + h) - friction(speed - h)) / (2.0 * h), rel=1e-6
    )


def crossings(function, frequencies):
    """Roots of a function of the angular frequency."""
    values = np.array([function(w) for w in frequencies])
    places = np.flatnonzero((values[:-1] < 0.0) != (values[1:] < 0.0))
    return [brentq(function, frequencies[k], frequencies[k + 1]) for k in places]


def delayed(s):
    """Return a lag with a dead time: its phase passes -180 degrees again and again."""
    return 1.6 * np.exp(-0.5 * s) / (s + 1.0)


def resonant(s):
    """Return an integrator and two resonances: |L| passes 1 five times, with different phases."""
    first = 0.3 * s / (s**2 + 0.3 * s + 25.0)
    second = 0.9 * s / (s**2 + 0.9 * s + 400.0)
    return (0.8 / s + 1.6 * first + 1.5 * second) * np.exp(-0.12 * s)


ANGULAR = np.geomspace(1e-2, 1e2, 4000)


@pytest.mark.parametrize('loop', [delayed, resonant])
def test_margins_are_those_of_the_nearest_crossing(loop):
    found = margins(ANGULAR / math.tau, loop(1j * ANGULAR))
    size = lambda w: abs(loop(1j * w)) - 1.0  # noqa: E731
    over = lambda w: float(np.angle(-loop(1j * w)))  # noqa: E731
    # where L is on the negative real axis, not where its angle jumps
    turned = [w for w in crossings(over, ANGULAR) if loop(1j * w).real < 0.0]
    gains = sorted(20.0 * math.log10(1.0 / abs(loop(1j * w))) for w in turned)
    assert len(gains) > 1
    assert found.gain_margin_db == pytest.approx(min(g for g in gains if g > 0.0), abs=0.02)
    ones = crossings(size, ANGULAR)
    phases = [math.degrees(over(w)) for w in ones]
    assert found.phase_margin_deg == pytest.approx(min(phases, key=abs), abs=0.3)
    delays = [math.radians(phase % 360.0) / w for phase, w in zip(phases, ones, strict=True)]
    assert found.delay_margin_s == pytest.approx(min(delays), rel=GRID, abs=1e-3)
    peak = (1.0 / np.abs(1.0 + loop(1j * ANGULAR))).max()
    assert found.sensitivity_peak == pytest.approx(peak, rel=EXACT)


def test_the_loop_with_resonances_passes_one_several_times_with_different_margins():
    ones = crossings(lambda w: abs(resonant(1j * w)) - 1.0, ANGULAR)
    assert len(ones) == 5
    phases = [math.degrees(float(np.angle(-resonant(1j * w)))) for w in ones]
    assert max(phases) - min(phases) > 30.0


def test_the_bandwidth_is_where_half_the_power_is_left():
    frequencies = np.geomspace(0.1, 100.0, 2000)
    closed = 1.0 / (1.0 + 1j * frequencies / 7.0) ** 2
    # two lags: |1/(1 + x^2)| = sqrt(1/2)
    assert bandwidth(frequencies, closed) == pytest.approx(7.0 * math.sqrt(math.sqrt(2.0) - 1.0), rel=1e-3)


def test_a_lag_rises_in_ln_9_and_settles_in_ln_50_of_its_time_constant():
    time_s = np.arange(0.0, 1.0, 1e-4)
    lag = 1.0 - np.exp(-time_s / 0.05)
    found = step_figures(time_s, lag)
    assert found.rise_time_s == pytest.approx(0.05 * math.log(9.0), rel=1e-4)
    assert found.settling_time_s == pytest.approx(0.05 * math.log(50.0), abs=2e-4)
    assert found.overshoot == 0.0
    # a response that ends too high exceeds the step, though never its own end
    high = step_figures(time_s, 1.1 * lag)
    assert high.overshoot == pytest.approx(0.1, rel=1e-4)
    assert high.settling_time_s is None
    assert high.final == pytest.approx(1.1, rel=1e-4)


@pytest.mark.parametrize('axis', [0, 1, 2])
def test_load_of_a_drive_agrees_with_its_motor_torque(axis, robot):
    point = (0.25, 0.1, -0.82)
    found = load_at(point, axis, robot)
    theta, still, gear = kinematics.inverse(point, robot.kinematics), np.zeros(3), 32.0
    turned = np.zeros(3)
    turned[axis] = 1.0 / gear  # of the arm, for 1 rad/s2 of the motor
    at_rest = dynamics.inverse(theta, still, still, robot)[axis] / gear
    moved = dynamics.inverse(theta, still, turned, robot)[axis] / gear
    assert found.gravity_n_m == pytest.approx(at_rest, rel=1e-9)
    assert found.inertia_kg_m2 == pytest.approx(moved - at_rest, rel=1e-9)


def test_the_effect_of_gains_on_a_program_is_that_of_its_trace(robot):
    program = programs.parse({'moves': [{'move_l': {'to_m': [0.1, 0.05, -0.8]}}]}, robot.motion)
    found, trace = effect.run(program, robot), simulation.run(program, robot)
    first = trace.meta['start_cycle']
    following = trace['following_error'][first:]
    length = np.linalg.norm(trace['tcp_error'][first:], axis=1)
    peak = np.maximum(-trace['current_min'], trace['current_max'])[first:]
    expected = {
        'following_error_max_rad': np.abs(following).max(),
        'following_error_rms_rad': math.sqrt((following**2).mean()),
        'tcp_error_max_m': length.max(),
        'tcp_error_rms_m': math.sqrt((length**2).mean()),
        'current_peak_a': peak.max(),
        'current_rms_a': math.sqrt((trace['current_rms'][first:] ** 2).mean(axis=0).max()),
    }
    told = to_dict(found)
    assert {key: told[key] for key in expected} == pytest.approx(expected, rel=1e-9)


def test_an_action_time_is_proportional_over_integral_gain(robot):
    velocity = settings.parse('S-0-0101=0.02').apply(robot).drive
    assert velocity.velocity_integral_gain_a_rad == pytest.approx(0.35 / 0.02, rel=EXACT)
    current = settings.parse('S-0-0107=0.003').apply(robot).drive
    assert current.current_integral_gain_v_a_s == pytest.approx(30.0 / 0.003, rel=EXACT)


# estimation

SAMPLES, SIGMA = 6000, 0.3


class Straight:
    """A signal that is linear in R and L: y = a R + b L + noise, three columns."""

    step, accuracy, depends = 1e-4, 1e-8, frozenset({'R', 'L'})

    def __init__(self, noise, true):
        times = np.arange(SAMPLES) * 1e-3
        phases = np.array([0.0, 1.0, 2.0])
        self.a = np.sin(2.0 * times[:, None] + phases)
        self.b = 50.0 * np.cos(1.3 * times[:, None] + phases)
        self.data = self.a * true['R'] + self.b * true['L'] + noise
        self.blocks = (Block('y', 'V', SIGMA, 1e-3),)
        self.shapes = (self.data.shape,)

    def residuals(self, values):
        return [self.data - self.a * values['R'] - self.b * values['L']]


def coloured(generator, correlation):
    """Noise of standard deviation ``SIGMA``, each sample correlated with the one before."""
    white = generator.standard_normal((SAMPLES, 3)) * SIGMA * math.sqrt(1.0 - correlation**2)
    out = np.empty_like(white)
    out[0] = generator.standard_normal(3) * SIGMA
    for n in range(1, SAMPLES):
        out[n] = correlation * out[n - 1] + white[n]
    return out


@pytest.mark.parametrize(('correlation', 'tolerance'), [(0.0, 0.06), (0.9, 0.25)])
def test_a_95_per_cent_interval_is_1_96_standard_deviations_of_its_estimate_wide(
    correlation, tolerance, robot
):
    true = {'R': robot.motor.winding_resistance_ohm, 'L': robot.motor.winding_inductance_h}
    print('seed 11')
    model = Straight(coloured(np.random.default_rng(11), correlation), true)
    problem = Problem([TABLE['R'], TABLE['L']], [model], robot)
    found = fit(problem, 1.2 * np.array([true['R'], true['L']]))
    # linear least squares by the book: the variance of (A'A)^-1 A' e, columns of the signal independent
    columns = [np.column_stack([model.a[:, k], model.b[:, k]]) for k in range(3)]
    normal = np.linalg.inv(sum(c.T @ c for c in columns))
    decay = correlation ** np.arange(SAMPLES)
    cut = int(np.searchsorted(-decay, -1e-6)) if correlation else 1
    middle = np.zeros((2, 2))
    for c in columns:
        for lag in range(cut):
            product = c[: SAMPLES - lag].T @ c[lag:]
            middle += decay[lag] * (product if lag == 0 else product + product.T)
    deviation = SIGMA * np.sqrt(np.diag(normal @ middle @ normal))
    for estimate, sd in zip(found.estimates, deviation, strict=True):
        # the covariance is estimated from the residuals: by a few per cent, by more from few independent blocks
        assert estimate.half_width == pytest.approx(1.96 * sd, rel=tolerance), estimate.symbol
        assert abs(estimate.value - true[estimate.symbol]) < 3.0 * sd


# experiments


def run_of(tcp, current, start=0):
    cycles = np.arange(start, start + len(tcp))
    actual = {'tcp': np.asarray(tcp), 'current': np.asarray(current)}
    return Run(cycles, 1e-3, actual, {}, ())


@pytest.fixture
def compared():
    generator = np.random.default_rng(3)
    model = run_of(generator.normal(size=(50, 3)), generator.normal(size=(50, 3)))
    robot = run_of(generator.normal(size=(50, 3)), generator.normal(size=(50, 3)))
    return Comparison.of(model, robot)


def test_the_statistics_of_a_comparison_are_those_of_lengths_and_of_axes(compared):
    rows = {(row.signal, row.column): row for row in compared.statistics()}
    tcp = 1e3 * (compared.robot.actual['tcp'] - compared.model.actual['tcp'])
    length = np.linalg.norm(tcp, axis=1)
    whole = rows['tcp', 'all']
    assert whole.unit == 'mm'
    assert whole.deviation_max == pytest.approx(length.max(), rel=EXACT)
    assert whole.deviation_rms == pytest.approx(math.sqrt((length**2).mean()), rel=EXACT)
    travel = 1e3 * (compared.model.actual['tcp'] - compared.model.actual['tcp'][0])
    assert whole.peak == pytest.approx(np.linalg.norm(travel, axis=1).max(), rel=EXACT)
    assert whole.deviation_max_percent == pytest.approx(100.0 * whole.deviation_max / whole.peak, rel=EXACT)
    assert whole.deviation_max_at_s == pytest.approx(1e-3 * length.argmax())
    current = rows['current', 'all']
    apart = compared.robot.actual['current'] - compared.model.actual['current']
    assert current.deviation_max == pytest.approx(np.abs(apart).max(), rel=EXACT)
    assert current.deviation_rms == pytest.approx(math.sqrt((apart**2).mean()), rel=EXACT)
    assert current.peak == pytest.approx(np.abs(compared.model.actual['current']).max(), rel=EXACT)
    assert rows['current', '2'].robot_rms == pytest.approx(
        math.sqrt((compared.robot.actual['current'][:, 1] ** 2).mean()), rel=EXACT
    )
    assert compared.mean_square_deviation('tcp') == pytest.approx(1e-6 * (length**2).mean(), rel=EXACT)
    assert compared.mean_square_deviation('current') == pytest.approx((apart**2).mean(), rel=EXACT)


def test_a_deviation_is_robot_less_model(compared):
    expected = compared.robot.actual['current'] - compared.model.actual['current']
    assert compared.deviation('current').tobytes() == expected.tobytes()


def test_effects_alone_and_left_out_show_their_gain_and_loss():
    names = tuple(EFFECTS)[:2]
    # v of no effect, the first, the second, both: they do not superpose
    outcome = outcome_of(('current', 'max'), names, 1.0, np.array([3.0, 10.0, 5.0, 20.0]))
    assert outcome.other == 2.0
    assert outcome.alone == dict(zip(names, (7.0, 2.0), strict=True))
    assert outcome.left_out == dict(zip(names, (15.0, 10.0), strict=True))
    assert outcome.share == dict(zip(names, (11.0, 6.0), strict=True))
    assert Attribution(names, (), 4, {}).effects == names


@pytest.mark.parametrize(
    ('apart', 'small', 'clear'),
    [(0.0, True, False), (0.005, True, False), (0.05, False, False), (0.5, False, True)],
)
def test_small_is_under_one_per_cent_of_the_travel_and_clear_over_ten_per_cent_of_the_rms(
    apart, small, clear
):
    way = np.column_stack([np.linspace(0.0, 1.0, 101), np.zeros(101), np.zeros(101)])
    signal = np.where(np.arange(101) % 2, 1.0, -1.0)[:, None]
    names = {
        name: len(QUANTITIES[name].columns) for name in ('arm_angle', 'tcp', 'tcp_error_norm', 'current')
    }
    model = {
        name: way if QUANTITIES[name].position else np.repeat(signal, n, axis=1) for name, n in names.items()
    }
    robot = {name: values * (1.0 + apart) for name, values in model.items()}
    cycles = np.arange(101)
    rows = Comparison.of(Run(cycles, 1e-3, model, {}, ()), Run(cycles, 1e-3, robot, {}, ())).statistics()
    angle, tcp, norm, current = conclusions(rows)
    assert [angle.holds, tcp.holds] == [small, small]
    assert [norm.holds, current.holds] == [clear, clear]
