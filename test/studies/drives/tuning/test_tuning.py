"""Tests of tuning (7.1, 8.1): agreement of two views of the loops and of recordings, and margins."""

import json
import math

import numpy as np
import pytest
from scipy import optimize, signal

from delta3_pacdrive import simulation
from delta3_pacdrive.cli import tune
from delta3_pacdrive.errors import ParameterError, TuningError
from delta3_pacdrive.parameters import load as load_parameters
from delta3_pacdrive.parameters.notch import notches
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.drive.notch import coefficients
from delta3_pacdrive.robot.drive.operation_data import TABLE
from delta3_pacdrive.robot.sercos.service_channel import format_idn
from delta3_pacdrive.studies.drives.loops import axis_excitation, identification
from delta3_pacdrive.studies.drives.loops.analysis import (
    LOOPS,
    OperatingPoint,
    analyse,
    exact_shaft,
    exchanged_shaft,
    linear_loop,
    step_on_bench,
)
from delta3_pacdrive.studies.drives.loops.bench import Place
from delta3_pacdrive.studies.drives.loops.load import extremes, friction_slope, load_at, modes_at
from delta3_pacdrive.studies.drives.loops.loops import Entry, Shaft, linear_cascade
from delta3_pacdrive.studies.drives.loops.response import bandwidth, margins, step_figures
from delta3_pacdrive.studies.drives.tuning import drive_settings as settings
from delta3_pacdrive.studies.drives.tuning import effect, measured_response, run, study
from delta3_pacdrive.studies.drives.tuning.report import interpolated
from delta3_pacdrive.studies.estimation import measurement
from thoroughness import some

POSE = (0.0, 0.0, -0.80)
SPEED_RAD_S = 10.0
# of the drive on the bench: encoder increments, and friction that is not quite a slope, are all that is left
BENCH_DB, BENCH_DEG = 0.2, 1.5
CASCADE_DB, CASCADE_DEG = 0.5, 3.0  # of 1/S - 1: where |L| is far from 1 it magnifies what is left
BENCH_HZ = {'current': 3500.0, 'velocity': 700.0, 'position': 400.0, 'cascade': 700.0}
STEP_SHARE = {'current': 1e-9, 'velocity': 5e-3, 'position': 2e-3}
# of the whole robot: inertia, gravity and the weights of the modes change along the way through the pose
ROBOT_DB, ROBOT_DEG, ROBOT_HZ = 1.0, 5.0, 700.0
TUNINGS = (
    {},
    {'drive__velocity_gain_a_s_rad': 0.8, 'drive__position_gain_rad_s_rad': 150.0},
    {'drive__velocity_filter_s': 4e-4, 'drive__current_filter_s': 1e-4, 'drive__velocity_integral_gain_a_rad': 0.0},
    {'drive__velocity_period_s': 250e-6, 'drive__position_period_s': 500e-6, 'bus__exchange_period_s': 250e-6},
)  # fmt: skip


def silent(*_):
    """Take the place of a progress line."""


def distances(values, linear):
    quotient = values / linear
    return np.abs(20.0 * np.log10(np.abs(quotient))).max(), np.abs(np.degrees(np.angle(quotient))).max()


@pytest.fixture(scope='module')
def operation(robot):
    return OperatingPoint(load_at(POSE, 0, robot), SPEED_RAD_S)


@pytest.fixture(scope='module')
def excited(robot):
    """Return a recording of the robot with excitation of the current set point of the first axis."""
    return axis_excitation.record(robot, axis_excitation.Excitation(Place.PLANT, 0, POSE, 5.0))


def test_current_loop_is_the_product_of_its_parts(robot):
    # PI, one period of computing delay, zero-order hold on R and L: the textbook formula, no state space
    drive, motor = robot.drive, robot.motor
    period = drive.current_period_s
    frequencies = np.geomspace(10.0, 7000.0, 50)
    z = np.exp(2j * np.pi * frequencies * period)
    decay = math.exp(-period * motor.winding_resistance_ohm / motor.winding_inductance_h)
    controller = drive.current_gain_v_a + drive.current_integral_gain_v_a_s * period / (1.0 - 1.0 / z)
    winding = (1.0 - decay) * 2.0 / motor.winding_resistance_ohm / (z - decay)
    cascade = linear_cascade(robot, Shaft(math.inf, 0.0, 125e-6), Entry.CURRENT_ERROR)
    np.testing.assert_allclose(
        cascade.respond(frequencies, 'current_filtered'), controller / z * winding, rtol=1e-9
    )


@pytest.mark.parametrize('changes', some(TUNINGS, TUNINGS[3:]))
def test_drive_on_the_bench_follows_its_equations(changes, robot, operation):
    for result in analyse(robot.replace(**changes), operation, silent):
        assert result.stable
        assert not result.fault
        measured = result.measured_open
        inside = measured.frequencies_hz <= BENCH_HZ[result.name]
        linear = interpolated(measured.frequencies_hz, result.frequencies_hz, result.open_loop)
        decibel, degree = distances(measured.values[inside], linear[inside])
        whole = result.name == 'cascade'
        assert decibel < (CASCADE_DB if whole else BENCH_DB), result.name
        assert degree < (CASCADE_DEG if whole else BENCH_DEG), result.name
        assert measured.coherence[inside].min() > 0.99
        if result.step is not None:
            share = np.abs(result.step.drive - result.step.linear).max()
            assert share < STEP_SHARE[result.name], result.name


@pytest.mark.parametrize('bandwidth_hz', [10.0, 40.0])
def test_margins_of_the_bench_include_the_disturbance_observer(bandwidth_hz, robot, operation):
    observed = robot.replace(drive__disturbance_bandwidth_hz=bandwidth_hz)
    plain, found = (analyse(r, operation, silent)[-1] for r in (robot, observed))
    assert found.stable
    inside = found.measured_open.frequencies_hz <= BENCH_HZ['cascade']
    linear = interpolated(found.measured_open.frequencies_hz, found.frequencies_hz, found.open_loop)
    decibel, degree = distances(found.measured_open.values[inside], linear[inside])
    assert decibel < CASCADE_DB
    assert degree < CASCADE_DEG
    # it costs gain margin, by more than the tolerance of the comparison
    assert found.margins.gain_margin_db < plain.margins.gain_margin_db - CASCADE_DB


def test_gain_margin_is_the_factor_at_which_the_drive_begins_to_swing(robot, operation):
    loop = LOOPS[1]
    margin = 10.0 ** (linear_loop(loop, robot, operation).margins.gain_margin_db / 20.0)

    def louder(factor):
        gain, integral = robot.drive.velocity_gain_a_s_rad, robot.drive.velocity_integral_gain_a_rad
        return robot.replace(
            drive__velocity_gain_a_s_rad=factor * gain, drive__velocity_integral_gain_a_rad=factor * integral
        )

    assert linear_loop(loop, louder(0.99 * margin), operation).stable
    assert not linear_loop(loop, louder(1.01 * margin), operation).stable
    assert step_on_bench(loop, louder(0.7 * margin), operation).figures.settling_time_s is not None
    assert step_on_bench(loop, louder(1.2 * margin), operation).figures.settling_time_s is None


def test_margins_agree_with_loops_in_closed_form():
    frequencies = np.geomspace(1e-3, 1e3, 4000)
    s = 2j * np.pi * frequencies
    third = margins(frequencies, 2.0 / (s * (s + 1.0) * (s + 2.0)))
    assert third.gain_margin_db == pytest.approx(20.0 * math.log10(3.0), abs=0.01)
    assert third.gain_margin_hz == pytest.approx(math.sqrt(2.0) / math.tau, rel=1e-3)
    integrator = margins(frequencies, 10.0 / s)
    assert integrator.phase_margin_deg == pytest.approx(90.0, abs=0.01)
    assert integrator.delay_margin_s == pytest.approx(math.pi / 2.0 / 10.0, rel=1e-3)
    assert integrator.gain_margin_db is None
    assert bandwidth(frequencies, 10.0 / (s + 10.0)) == pytest.approx(10.0 / math.tau, rel=1e-3)


def test_each_gain_margin_belongs_to_its_own_crossing():
    def loop(rate):
        s = 1j * rate
        return 8.0 * (s + 1.0) ** 2 / (s**3 * (1.0 + s / 100.0) ** 2)

    # conditionally stable: -180 degrees once above and once below a gain of one
    above, below = (
        optimize.brentq(lambda w: loop(w).imag, *bracket) for bracket in ((0.5, 3.0), (50.0, 200.0))
    )
    frequencies = np.geomspace(1e-3, 1e3, 8000)
    found = margins(frequencies, loop(math.tau * frequencies))
    assert found.gain_margin_db == pytest.approx(-20.0 * math.log10(abs(loop(below))), abs=0.01)
    assert found.gain_margin_hz == pytest.approx(below / math.tau, rel=1e-3)
    assert found.gain_reduction_db == pytest.approx(-20.0 * math.log10(abs(loop(above))), abs=0.01)
    assert found.gain_margin_db > 0.0 > found.gain_reduction_db


def test_of_many_crossings_below_a_gain_of_one_the_first_is_the_margin():
    dead_s, gain = 0.3, 2.0
    frequencies = np.geomspace(1e-3, 1e2, 20_000)
    s = 2j * np.pi * frequencies
    # the phase of a dead time passes -180 degrees again and again, with less and less gain
    rate = optimize.brentq(lambda w: math.atan(w) + w * dead_s - math.pi, 1.0, 10.0)
    found = margins(frequencies, gain * np.exp(-s * dead_s) / (s + 1.0))
    assert found.gain_margin_hz == pytest.approx(rate / math.tau, rel=1e-3)
    assert found.gain_margin_db == pytest.approx(20.0 * math.log10(math.hypot(rate, 1.0) / gain), abs=0.01)


def test_the_friction_slope_is_the_derivative_of_the_friction(robot):
    motor = robot.motor

    def friction(speed):
        return motor.static_friction_n_m * math.tanh(speed / motor.friction_smoothing_rad_s) + (
            motor.viscous_friction_n_m_s_rad * speed
        )

    for speed in (0.0, 0.3, -1.0, 2.0, 50.0):
        step = 1e-5
        slope = (friction(speed + step) - friction(speed - step)) / (2.0 * step)
        assert friction_slope(speed, robot) == pytest.approx(slope, rel=1e-6)


def test_step_figures_of_a_second_order_system():
    damping, frequency = 0.4, 50.0
    time_s = np.arange(0.0, 1.0, 1e-4)
    _, y = signal.step(([frequency**2], [1.0, 2.0 * damping * frequency, frequency**2]), T=time_s)
    found = step_figures(time_s, y)
    assert found.overshoot == pytest.approx(
        math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2)), abs=1e-3
    )
    assert found.final == pytest.approx(1.0, abs=1e-6)
    envelope = math.log(1.0 / (0.02 * math.sqrt(1.0 - damping**2))) / (damping * frequency)
    assert 0.5 * envelope < found.settling_time_s <= envelope


def test_observer_with_true_estimates_or_without_use_has_no_effect(robot, operation):
    frequencies = np.geomspace(5.0, 1000.0, 30)
    inertia = operation.load.inertia_kg_m2

    def sensitivity(exchange_s, believed):
        shaft = Shaft(inertia, 1e-3, exchange_s, believed)
        return linear_cascade(robot, shaft, Entry.CURRENT).respond(frequencies, 'current_reference', 2)

    exact = sensitivity(125e-6, None)
    # at the exchange the speed is true, elsewhere the difference of two readings: a dozen parts in a thousand
    np.testing.assert_allclose(sensitivity(1e-3, inertia), exact, rtol=0.02)
    np.testing.assert_allclose(sensitivity(125e-6, 2.0 * inertia), exact, rtol=1e-3)
    assert np.abs(sensitivity(1e-3, 2.0 * inertia) / exact - 1.0).max() > 0.05


def test_velocity_gain_that_only_the_exchange_does_not_bear_trips_only_the_simulation_with_it(robot):
    # the margin is lost between drive and plant: the lightest mode is a third of what the observer believes
    tuned = robot.replace(drive__velocity_gain_a_s_rad=1.2)
    lightest = extremes(tuned)[0]
    assert linear_cascade(tuned, exact_shaft(tuned, lightest, SPEED_RAD_S), Entry.CURRENT).is_stable()
    assert not linear_cascade(tuned, exchanged_shaft(tuned, lightest, SPEED_RAD_S), Entry.CURRENT).is_stable()
    program = programs.load('experiment1', robot.motion)
    assert '8902' in effect.run(program, tuned).fault
    assert not effect.run(program, tuned.replace(bus__exchange_period_s=125e-6)).fault


def test_more_gain_follows_better(robot):
    program = programs.load('experiment1', robot.motion)
    before, after = (
        effect.run(program, robot.replace(drive__position_gain_rad_s_rad=gain)) for gain in (60.0, 90.0)
    )
    assert after.following_error_rms_rad < before.following_error_rms_rad
    assert after.tcp_error_max_m < before.tcp_error_max_m
    assert before.following_error_max_rad == np.abs(before.following_error_rad).max()


def test_modes_share_each_axis_out_and_lie_within_the_workspace(robot):
    modes = modes_at((0.3, 0.1, -0.85), robot)
    np.testing.assert_allclose(modes.shares.sum(axis=0), 1.0)
    np.testing.assert_allclose(modes.shares.sum(axis=1), 1.0)
    of_axes = [load_at((0.3, 0.1, -0.85), axis, robot).inertia_kg_m2 for axis in range(3)]
    np.testing.assert_allclose(modes.shares @ modes.inertia_kg_m2, of_axes)
    lightest, heaviest = extremes(robot)
    assert lightest.inertia_kg_m2 < modes.inertia_kg_m2[0] < modes.inertia_kg_m2[2] < heaviest.inertia_kg_m2


@pytest.mark.parametrize('name', ['cascade', 'current'])
def test_recorded_excitation_of_the_robot_shows_the_loops_of_its_modes(name, excited, robot, operation):
    (one,) = (r for r in measured_response.identify(excited, 1, robot, operation) if r.name == name)
    low, high = one.measured.band_hz()
    assert low < 10.0
    assert high > ROBOT_HZ
    inside = (one.measured.frequencies_hz > 5.0) & (one.measured.frequencies_hz <= ROBOT_HZ)
    decibel, degree = distances(one.measured.values[inside], one.linear[inside])
    assert decibel < ROBOT_DB
    assert degree < ROBOT_DEG


def test_recording_with_notch_filter_shows_the_same_open_loop_before_it(excited, robot, operation):
    notched = robot.replace(drive__notch_1_frequency_hz=300.0, drive__notch_1_depth=0.1)
    every = round(robot.drive.velocity_period_s / robot.drive.current_period_s)
    b0, b1, b2, a1, a2 = coefficients(notches(notched.drive)[0], robot.drive.velocity_period_s)
    asked = excited['current_reference'][::every]
    behind = np.repeat(signal.lfilter([b0, b1, b2], [1.0, a1, a2], asked, axis=0), every, axis=0)
    signals = excited.signals | {'current_reference': behind[: len(excited.time_s)]}
    trace = Trace(excited.time_s, signals, excited.meta)
    plain, found = (
        measured_response.identify(one, 1, parameters, operation)[0].measured
        for one, parameters in ((excited, robot), (trace, notched))
    )
    inside = (plain.frequencies_hz > 20.0) & (plain.frequencies_hz <= ROBOT_HZ)
    decibel, degree = distances(found.values[inside], plain.values[inside])
    assert decibel < 0.1
    assert degree < 1.0


def test_position_set_point_opens_the_position_loop(robot, operation):
    trace = axis_excitation.record(robot, axis_excitation.Excitation(Place.POSITION, 0, POSE, 5.0))
    one = measured_response.identify(trace, 1, robot, operation)[0]
    assert one.name == 'position'
    inside = one.measured.frequencies_hz > 5.0
    decibel, degree = distances(one.measured.values[inside], one.linear[inside])
    assert decibel < ROBOT_DB
    assert degree < ROBOT_DEG


def test_noise_narrows_the_band_that_is_trusted(excited, robot, operation):
    noisy = measurement.with_noise(excited, robot, 1.0, seed=1)
    # what the drive asked for came from signals that were noisy as well; here the noise is added to what was recorded
    rng = np.random.default_rng(1)
    noisy.signals['current_reference'] = excited['current_reference'] + 0.3 * rng.standard_normal(
        excited['current_reference'].shape
    )
    clean = measured_response.identify(excited, 1, robot, operation)[0].measured
    worse = measured_response.identify(noisy, 1, robot, operation)[0].measured
    assert worse.trusted.sum() < clean.trusted.sum()
    assert np.median(worse.coherence) < np.median(clean.coherence)


def test_estimate_of_a_filter_in_noise_lies_within_its_own_error():
    rng = np.random.default_rng(7)
    x = rng.standard_normal(64_000)
    b, a = signal.butter(2, 0.2)
    y = signal.lfilter(b, a, x) + 0.1 * rng.standard_normal(len(x))
    found = identification.response(x, y, 1e-3, 512)
    _, true = signal.freqz(b, a, found.frequencies_hz, fs=1e3)
    off = np.abs(found.values / true - 1.0)[found.trusted]
    # a Hann window smears a little besides; complex numbers have two errors
    assert np.mean(off < 3.0 * found.error[found.trusted] + 0.01) > 0.97
    assert not found.trusted[-1]
    assert found.band_hz()[1] < 500.0


def test_bus_recording_shows_the_set_point_delay(robot, operation):
    trace = simulation.run(programs.load('packaging', robot.motion), robot)
    one = measured_response.identify(trace, 1, robot, operation)[0]
    low, high = one.measured.band_hz()
    assert low < 5.0
    assert high > 30.0
    slow = one.measured.frequencies_hz < 15.0
    frequencies = one.measured.frequencies_hz[slow]
    np.testing.assert_allclose(np.abs(one.measured.values[slow]), 1.0, atol=0.03)
    delay = -np.polynomial.polynomial.polyfit(
        math.tau * frequencies, np.angle(one.measured.values[slow]), [1]
    )[1]
    # with feed-forwards the shaft is late by the latency of its set point, 1.75 cycles, and by little else
    expected = robot.set_point_delay_cycles * robot.bus.cycle_time_s
    assert delay == pytest.approx(expected, abs=0.2e-3)


def test_elastic_gears_show_their_resonance_in_a_recording(operation):
    rich = load_parameters('rich')
    trace = axis_excitation.record(rich, axis_excitation.Excitation(Place.PLANT, 0, POSE, 5.0))
    one = measured_response.identify(trace, 1, rich, operation)[0].measured
    peak = one.frequencies_hz[np.argmax(np.where(one.frequencies_hz > 100.0, np.abs(one.values), 0.0))]
    # 180 to 200 Hz, as the stiffness was chosen; lines are spaced by a seventh
    assert 160.0 < peak < 240.0
    # and cost the margin that the rigid loop has: 17 dB
    high = one.frequencies_hz > peak
    assert margins(one.frequencies_hz[high], one.values[high]).gain_margin_db < 6.0


def test_all_names_of_a_gain_are_equivalent(robot):
    names = ('position_gain_rad_s_rad', 'drive.position_gain_rad_s_rad', 'K_Ppos', 'S-0-0104')
    tuned = [settings.apply([settings.parse(f'{name}=70')], robot) for name in names]
    assert len({one.checksum for one in tuned}) == 1
    both = settings.apply([settings.parse('S-0-0101=0.01'), settings.parse('S-0-0100=0.5')], robot)
    assert both.drive.velocity_integral_gain_a_rad == pytest.approx(0.5 / 0.01)
    for row in TABLE.values():
        if row.writable_in and row.sources[0].startswith('drive.'):
            settings.parse(f'{format_idn(row.idn)}=1')


@pytest.mark.parametrize(
    ('text', 'told'),
    [('K_Pvell=1', 'did you mean K_Pvel'), ('K_Pvel', 'NAME=VALUE'), ('K_Pvel=x', 'finite number'), ('=1', 'no drive')],
)  # fmt: skip
def test_nonsensical_setting_is_reported_with_one_message(text, told):
    with pytest.raises(TuningError, match=told):
        settings.parse(text)


def test_recording_without_sufficient_signals_names_the_missing_ones(robot, operation, excited):
    only = Trace(excited.time_s, {'motor_position': excited['motor_position']}, excited.meta)
    with pytest.raises(TuningError, match='current_reference'):
        measured_response.identify(only, 1, robot, operation)
    short = Trace(excited.time_s[:100], {n: v[:100] for n, v in excited.signals.items()}, {})
    with pytest.raises(TuningError, match='samples'):
        measured_response.identify(short, 1, robot, operation)
    with pytest.raises(ParameterError, match='between 0 and 100'):
        settings.apply([settings.parse('K_Pvel=200')], robot)


def test_command_compares_gains_and_reports_unstable_ones(tmp_path, capsys, excited):
    excited.save(tmp_path / 'trace.npz')
    arguments = ['--set', 'K_Pvel=4', '--sweep', 'K_Ppos=40:80:2', '--recording', str(tmp_path / 'trace.npz')]
    assert tune.main([*arguments, '--output', str(tmp_path / 'out'), '--json']) == 0
    report = json.loads(capsys.readouterr().out)
    after = report['variants']['after']
    assert 'velocity: unstable' in after['instability'][0]
    assert '8902' in after['effect']['fault']
    assert report['variants']['before']['loops']['velocity']['stable']
    assert [one['name'] for one in report['recorded']] == ['cascade', 'current']
    names = {path.rsplit('/', 1)[1] for path in report['files']}
    assert {'step_velocity.csv', 'bode_position_after.csv', 'effect.csv', 'sweep.csv', 'sweep.png'} <= names
    head = (tmp_path / 'out' / 'step_velocity.csv').read_text().splitlines()
    assert head[0].startswith('# command: delta3 tune --set K_Pvel=4')
    assert 'time [s],before: drive [1]' in '\n'.join(head[:7])


@pytest.mark.parametrize(
    'arguments',
    [['--set', 'foo=1'], ['--pose', '5', '0', '0'], ['--payload', '-1'], ['--speed', '99'], ['--recording', 'no.npz'],
     ['--program', 'nothing'], ['--sweep', 'K_Pvel=0:200:3'], ['--excite', '/no/such/folder/x.npz']],
)  # fmt: skip
def test_command_rejects_invalid_input_with_one_message(arguments, capsys, tmp_path):
    assert tune.main([*arguments, '--output', str(tmp_path)]) == 1
    assert capsys.readouterr().err.splitlines()[-1].startswith('error: ')


# every option changes what it should


@pytest.fixture
def studied(monkeypatch):
    """Return the studies that the command made, none of which is computed."""
    made = []

    def give_up(self):
        made.append(self)
        return {}

    monkeypatch.setattr(run.Study, 'run', give_up)
    return made


def test_options_of_load_and_bench_change_their_quantities(studied, robot, tmp_path, capsys):
    pose = (0.1, 0.0, -0.8)
    lines = [
        [],
        ['--axis', '2'],
        ['--axis', '3'],
        ['--pose', *map(str, pose)],
        ['--payload', '2'],
        ['--speed', '5'],
        ['--amplitude', '0.5'],
        ['--exchange-period', '125e-6'],
        ['--program', 'packaging'],
    ]
    for line in lines:
        assert tune.main([*line, '--output', str(tmp_path), '--json']) == 0
    plain, second, third, posed, loaded, slow, small, exact, other = studied
    for axis, own in enumerate((plain, second, third)):
        assert own.operation.load == load_at(robot.motion.home_m, axis, robot)
    at_pose = [load_at(pose, axis, robot) for axis in range(3)]
    assert posed.operation.load == at_pose[0] != plain.operation.load
    assert loaded.operation.load.inertia_kg_m2 > plain.operation.load.inertia_kg_m2
    assert loaded.robot.dynamics.payload_mass_kg == 2.0
    assert (plain.operation.speed_rad_s, slow.operation.speed_rad_s) == (10.0, 5.0)
    assert (plain.operation.amplitude, small.operation.amplitude) == (1.0, 0.5)
    assert (plain.robot.bus.exchange_period_s, exact.robot.bus.exchange_period_s) == (1e-3, 125e-6)
    assert (plain.program.name, other.program.name) == (
        'experiment 1, pick and place',
        'packaging cycle 25/305/25 mm',
    )
    capsys.readouterr()


@pytest.mark.long
def test_the_exchange_period_reaches_the_program_and_the_workspace(tmp_path):
    found = []
    for period_s in (None, 125e-6):
        own = run.Study(study.Settings(exchange_period_s=period_s), tmp_path, 'test', silent)
        variant = own.variant(own.robot, '')
        exchanged = [loops[-1].margins.gain_margin_db for _, loops in variant.workspace]
        found.append((variant.effect.tcp_error_max_m, exchanged))
    errors_m, margins_db = zip(*found, strict=True)
    assert errors_m[0] != errors_m[1]
    assert errors_m == pytest.approx([errors_m[1]] * 2, abs=5e-6)  # 3 um apart (docs/measured.md)
    assert np.max(np.subtract(margins_db[1], margins_db[0])) > 3.0  # exchanging costs margin with light loads


def test_recording_of_the_requested_axis_is_evaluated(excited, robot, tmp_path, monkeypatch):
    excited.save(tmp_path / 'trace.npz')
    asked = []
    monkeypatch.setattr(measured_response, 'identify', lambda _trace, axis, *_: asked.append(axis) or [])
    for axis in (1, 3):
        settings_ = study.Settings(axis=axis, recording=str(tmp_path / 'trace.npz'))
        run.Study(settings_, tmp_path, 'test', silent).measured()
    assert asked == [1, 3]


def excite(arguments, tmp_path, capsys):
    path = tmp_path / 'scope.npz'
    assert tune.main(['--excite', str(path), *arguments, '--json']) == 0
    capsys.readouterr()
    return Trace.load(path)


@pytest.mark.long
def test_options_of_an_excitation_change_their_quantities(tmp_path, capsys):
    plain = excite(['--speed', '5'], tmp_path, capsys)
    second = excite(['--speed', '5', '--axis', '2', '--amplitude', '0.5'], tmp_path, capsys)
    position = excite(['--speed', '5', '--place', 'position'], tmp_path, capsys)
    noisy, other = (
        excite(['--speed', '5', '--noise', '1', '--seed', seed], tmp_path, capsys) for seed in ('0', '1')
    )
    added = [np.sqrt(np.mean(trace['current_added'] ** 2, axis=0)) for trace in (plain, second)]
    assert added[0][0] > 0.0
    assert added[1][1] == pytest.approx(0.5 * added[0][0], rel=1e-6)
    assert added[0][1:].tolist() == [0.0, 0.0]
    assert added[1][[0, 2]].tolist() == [0.0, 0.0]
    assert (plain.meta['axis'], second.meta['axis']) == (1, 2)
    assert 'position_added' not in plain.signals
    assert np.ptp(position['position_added'][:, 0]) > 0.0
    spread = [float(np.std(trace['current'] - plain['current'])) for trace in (noisy, other)]
    assert spread == pytest.approx([measurement.NOISE.current_a] * 2, rel=0.05)
    assert noisy['current'].tobytes() != other['current'].tobytes()


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['--place', 'position'], '--place requires --excite'),
        (['--noise', '1'], '--noise requires --excite'),
        (['--excite', 'x.npz', '--exchange-period', '1e-3'], '--propose or --exchange-period'),
        (
            ['--excite', 'x.npz', '--set', 'K_Pvel=1'],
            'cannot be combined with --recording, --set, --sweep, --propose or --exchange-period',
        ),
        (['--axis', '6'], 'invalid choice'),
        (['--noise', '-1', '--excite', 'x.npz'], "'-1' must be a number between 0 and 1000"),
        (['--seed', '-1', '--excite', 'x.npz'], "'-1' must be a whole number between 0"),
    ],
)
def test_inapplicable_options_are_rejected_by_name(arguments, sentence, capsys):
    with pytest.raises(SystemExit) as end:
        tune.main(arguments)
    assert end.value.code == 2
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['--payload', '10.5'], 'the payload is 10.5 kg, but must be between 0 and 10 kg'),
        (['--speed', '20.1'], 'the speed of the bench is 20.1 rad/s, but must be between 0 and 20'),
        (['--amplitude', '0'], 'the amplitude is 0, but must be between 0.001 and 100'),
        (['--exchange-period', '2e-3'], 'bus.exchange_period_s is 0.002, but must be between'),
    ],
)
def test_numbers_out_of_range_are_rejected_with_the_limit(arguments, sentence, capsys, tmp_path):
    assert tune.main([*arguments, '--output', str(tmp_path)]) == 1
    assert sentence in capsys.readouterr().err


def test_excited_loops_are_the_same_bits_for_a_master_that_commands_torques(excited, robot):
    model = robot.replace(control__feed_forward='model')
    again = axis_excitation.record(model, axis_excitation.Excitation(Place.PLANT, 0, POSE, 5.0))
    for name, values in excited.signals.items():
        np.testing.assert_array_equal(again[name], values, err_msg=name)
