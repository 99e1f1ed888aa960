"""Facts about parameter estimation (chapter 9): what signals tell, what they do not, and how sure the figures are."""

import dataclasses
import json
import struct

import numpy as np
import pytest

from delta3_pacdrive import dynamics, parameters, simulation
from delta3_pacdrive.analysis.estimation import excitation, measurement, solver, thesis_setup
from delta3_pacdrive.analysis.estimation.geometry_model import GeometryModel
from delta3_pacdrive.analysis.estimation.identifiability import Verdict, analyse, analyse_jacobian
from delta3_pacdrive.analysis.estimation.motor_models import TorqueModel, WindingModel
from delta3_pacdrive.analysis.estimation.problem import Problem
from delta3_pacdrive.analysis.estimation.quantities import (
    COMBINATIONS,
    GROUPS,
    TABLE,
    start_values,
    values_of,
    with_values,
)
from delta3_pacdrive.analysis.estimation.replay_model import ReplayModel
from delta3_pacdrive.analysis.estimation.run import Settings, Study
from delta3_pacdrive.analysis.estimation.solver import QUIET, fit, whiteness_of
from delta3_pacdrive.cli import estimate
from delta3_pacdrive.errors import EstimationError, TraceError
from delta3_pacdrive.motion import program as programs
from delta3_pacdrive.recording import trace_csv
from delta3_pacdrive.recording.trace import Trace

EXACT = 1e-3  # relative, without noise; the issue asks for 1e-2
SEEDS = 40
COVERAGE = (0.85, 1.0)  # of the 95 % intervals of one quantity over so many seeds, which are fixed
POOLED = (0.91, 0.98)  # of all quantities together: twice as wide holds 99.99 %, half as wide 67 %
# rms of error over half width: 0.51 where 95 % are right, 0.26 with intervals twice as wide, 1.02 with half as wide
SCATTER = (0.43, 0.60)
REPLAYED = 0.02  # without noise but through the increments of encoders, from once per bus cycle
THROUGH = [[0.0, 0.25, -0.86], [-0.3, 0.1, -0.74], [-0.1, -0.3, -0.9], [0.25, -0.2, -0.75], [0.2, 0.0, -0.8]]
LIMITS = {'speed_m_s': 2.5, 'acceleration_m_s2': 30.0, 'jerk_m_s3': 1500.0}


@pytest.fixture(scope='module')
def program(robot):
    moves = [{'move_sb': {'through_m': THROUGH, **LIMITS}}]
    return programs.parse({'start_m': THROUGH[-1], 'moves': moves}, robot.motion)


@pytest.fixture(scope='module')
def scope(program, robot):
    """Return exact signals of every period of the current loop."""
    return measurement.simulate(program, robot)


@pytest.fixture(scope='module')
def bus(program, robot):
    """Return exact signals of every bus cycle, and the TCP as a laser tracker sees it."""
    return measurement.simulate(program, robot, 'bus')


MODELS = {
    'motor': lambda trace, robot: [WindingModel(trace, robot), TorqueModel(trace, robot)],
    'masses': lambda trace, robot: [TorqueModel(trace, robot)],
    'geometry': lambda trace, robot: [GeometryModel(trace, robot)],
}
IDENTIFIABLE = {
    'motor': {'R', 'L', 'K_m', 'F_v', 'F_s', 'I_m'},
    'masses': {'m_b', 'F_v', 'F_s', 'm_nt', 'm_br r_Gb', 'I_b', 'm_c + r m_fb'},
    'geometry': {'l_A', 'l_B', 'alpha_1', 'alpha_2', 'alpha_3', 'R_A - R_B'},
}


def problem_of(group, trace, robot, free=(), known=(), models=None):
    quantities = GROUPS[group].chosen(free, known)
    return Problem(quantities, models or MODELS[group](trace, robot), robot)


def estimate_from(problem, robot, off):
    return fit(problem, start_values(problem.quantities, robot, off))


def shown(found):
    """Return the estimates that mean anything, by symbol."""
    return {e.symbol: e for e in found.estimates if e.verdict is Verdict.IDENTIFIABLE}


def errors(found, robot):
    """Return the errors of these estimates, relative to what changes of each are compared with."""
    true, combined = values_of(robot), {c.symbol: c for c in COMBINATIONS}
    out = {}
    for symbol, e in shown(found).items():
        truth = true[symbol] if symbol in true else combined[symbol].value(true, robot)
        out[symbol] = (e.value - truth) / (TABLE[symbol].extent(truth) if symbol in TABLE else abs(truth))
    return out


def verdicts(problem, robot):
    x = start_values(problem.quantities, robot, 0.0)
    return {f.symbol: f.verdict for f in analyse(problem, x).findings}


# measurement


def test_the_oscilloscope_sees_the_simulation_to_the_last_bit(program, scope, robot):
    exact = simulation.run(program, robot.replace(bus__exchange_period_s=125e-6))
    cycles = len(exact.time_s)
    for name in ('shaft_position', 'shaft_speed'):
        assert scope[name][: 16 * cycles : 16].tobytes() == exact[name].tobytes()
    assert np.abs(scope['current'][::16] - exact['current']).max() < 1e-12  # K_m I / K_m in the telegram


def test_current_and_voltage_obey_the_winding(scope, robot):
    motor, rows = robot.motor, measurement.moving_rows(scope)
    current, voltage, speed = (scope[name][rows] for name in ('current', 'phase_voltage', 'motor_speed'))
    final = (voltage - motor.torque_constant_n_m_a / 3.0 * speed) / (motor.winding_resistance_ohm / 2.0)
    decay = np.exp(-62.5e-6 * motor.winding_resistance_ohm / motor.winding_inductance_h)
    assert np.abs((final + (current - final) * decay)[:-1] - current[1:]).max() < 1e-12


def test_the_same_seed_is_the_same_noise_and_no_noise_is_none(bus, robot):
    one, again, other = (measurement.with_noise(bus, robot, 1.0, seed) for seed in (3, 3, 4))
    assert one['current'].tobytes() == again['current'].tobytes() != other['current'].tobytes()
    assert np.std(one['current'] - bus['current']) == pytest.approx(measurement.NOISE.current_a, rel=0.05)
    quiet = measurement.with_noise(bus, robot, 0.0, 3)
    assert all(quiet[name].tobytes() == bus[name].tobytes() for name in bus.signals)


def test_a_program_that_changes_the_payload_is_no_measurement(robot):
    with pytest.raises(EstimationError, match='payload'):
        measurement.simulate(programs.load('packaging', robot.motion), robot)


# models


def test_the_equation_of_motion_is_linear_in_three_constants(robot):
    generator = np.random.default_rng(7)
    theta, rates, accelerations = generator.uniform(-0.2, 0.8, (3, 50, 3)) * [[[1.0]], [[5.0]], [[100.0]]]
    record = dynamics.inertia(robot)[0]
    moment = record['weight'][0] * robot.kinematics.upper_arm_length_m / robot.dynamics.gravity_m_s2
    constants = [record['arm'][0], record['plate'], moment]
    torque = dynamics.regressor(theta, rates, accelerations, robot) @ constants
    assert np.abs(torque - dynamics.inverse(theta, rates, accelerations, robot)).max() < 1e-10


def test_values_go_into_parameters_and_come_back(robot):
    changed = {'R': 3.0, 'm_b': 1.1, 'alpha_2': 2.0, 'R_B': 0.06}
    back = values_of(with_values(robot, changed))
    assert all(back[symbol] == pytest.approx(value, rel=1e-14) for symbol, value in changed.items())
    with pytest.raises(EstimationError, match='cannot be'):
        with_values(robot, {'R': -1.0})


@pytest.mark.parametrize('off', [0.3, -0.3])
@pytest.mark.parametrize('group', MODELS)
def test_without_noise_every_identifiable_quantity_is_found_from_30_percent_off(
    group, off, scope, bus, robot
):
    trace = bus if group == 'geometry' else scope
    found = estimate_from(problem_of(group, trace, robot), robot, off)
    assert found.converged
    assert shown(found).keys() == IDENTIFIABLE[group]
    assert max(map(abs, errors(found, robot).values())) < EXACT


def test_what_was_weighed_makes_the_other_masses_identifiable(scope, robot):
    problem = problem_of('masses', scope, robot, known=['m_fb', 'm_payload'])
    found = estimate_from(problem, robot, 0.3)
    assert shown(found).keys() == {'m_b', 'm_c', 'm_n', 'F_v', 'F_s'}
    assert max(map(abs, errors(found, robot).values())) < EXACT


def errors_in_half_widths(found, robot):
    """Return the errors of all estimates that mean anything, in half widths of their intervals, by symbol."""
    true = values_of(robot)
    truth = true | {c.symbol: c.value(true, robot) for c in COMBINATIONS}
    return {symbol: (e.value - truth[symbol]) / e.half_width for symbol, e in shown(found).items()}


@pytest.mark.parametrize('group', MODELS)
def test_the_truth_lies_in_the_intervals_at_their_rate(group, scope, bus, robot):
    exact = bus if group == 'geometry' else scope
    off = {symbol: [] for symbol in IDENTIFIABLE[group]}
    for seed in range(SEEDS):
        noisy = measurement.with_noise(exact, robot, 1.0, seed)
        found = estimate_from(problem_of(group, noisy, robot), robot, 0.3)
        for symbol, error in errors_in_half_widths(found, robot).items():
            off[symbol].append(error)
    rates = {symbol: np.mean(np.abs(own) <= 1.0) for symbol, own in off.items()}
    pooled = np.concatenate(list(off.values()))
    scatter, rate = float(np.sqrt(np.mean(pooled**2))), float(np.mean(np.abs(pooled) <= 1.0))
    print(group, rates, scatter, rate)
    assert len(pooled) == SEEDS * len(IDENTIFIABLE[group])
    assert all(COVERAGE[0] <= own <= COVERAGE[1] for own in rates.values())
    assert POOLED[0] <= rate <= POOLED[1]
    assert SCATTER[0] <= scatter <= SCATTER[1]
    # the bounds would see intervals of another width
    for factor in (0.5, 2.0):
        assert not SCATTER[0] <= scatter / factor <= SCATTER[1]
        assert not POOLED[0] <= np.mean(np.abs(pooled) <= factor) <= POOLED[1]


@pytest.mark.parametrize('group', MODELS)
def test_intervals_hold_without_noise_and_are_those_of_the_sensors(group, scope, bus, robot):
    exact = bus if group == 'geometry' else scope
    found, noisy = (
        estimate_from(problem_of(group, trace, robot), robot, 0.3)
        for trace in (exact, measurement.with_noise(exact, robot, 1.0, 0))
    )
    assert max(map(abs, errors_in_half_widths(found, robot).values())) < 1.0
    for symbol, e in shown(found).items():
        assert e.half_width == pytest.approx(shown(noisy)[symbol].half_width, rel=0.4)


def test_intervals_of_a_replay_hold_although_its_encoder_has_no_increments(bus, robot):
    problem = problem_of('motor', bus, robot, known=['R', 'L'], models=[ReplayModel(bus, robot)])
    found = estimate_from(problem, robot, 0.3)
    assert found.whiteness[0].rms < QUIET * problem.blocks[0].sigma
    off = errors_in_half_widths(found, robot)
    assert off.keys() == {'K_m', 'F_v', 'F_s', 'I_m'}
    assert max(map(abs, off.values())) < 1.0


def test_quantities_that_went_far_start_a_second_time_beside_what_the_others_found(scope, robot, monkeypatch):
    problem = problem_of('motor', scope, robot)
    start = start_values(problem.quantities, robot, 0.3)
    right = fit(problem, start)
    valley = right.x * np.array([4.0, 0.2, 1.0, 1.0, 1.0, 1.0])
    calls = []

    def once(_problem, _start, _on_iterate, resume):
        calls.append(None if resume is None else resume.x)
        white = [
            dataclasses.replace(w, rms=w.rms * (2.0 if resume is None else 1.0)) for w in right.whiteness
        ]
        x = valley if resume is None else right.x
        return dataclasses.replace(right, x=x, whiteness=tuple(white))

    monkeypatch.setattr(solver, '_fit_once', once)
    assert fit(problem, start).x.tolist() == right.x.tolist()
    assert calls[0] is None
    np.testing.assert_array_equal(calls[1], [*start[:2], *right.x[2:]])
    calls.clear()
    valley = right.x
    fit(problem, start)  # nothing has gone far
    assert len(calls) == 1


# identifiability


def test_verdicts_tell_invisible_confounded_weak_and_identifiable():
    generator = np.random.default_rng(1)
    a, b, c = generator.standard_normal((3, 1000))
    columns = np.stack([a, 2.0 * a, 1e-2 * b, np.zeros(1000), c], axis=-1)
    report = analyse_jacobian([columns], ['a', 'twice', 'weak', 'nothing', 'c'], 1e-8)
    assert [f.verdict for f in report.findings] == [
        Verdict.CONFOUNDED,
        Verdict.CONFOUNDED,
        Verdict.WEAK,
        Verdict.INVISIBLE,
        Verdict.IDENTIFIABLE,
    ]
    assert report.findings[0].partners == ('twice',)
    assert report.findings[1].partners == ('a',)
    assert report.rank == len(report.estimated) == 3
    assert report.shows(np.array([1.0, 2.0, 0.0, 0.0, 0.0]))
    assert not report.shows(np.array([1.0, -2.0, 0.0, 0.0, 0.0]))
    assert report.findings[4].relative_error == pytest.approx(1.0 / np.linalg.norm(c), rel=0.01)


def test_nearly_collinear_quantities_are_named():
    generator = np.random.default_rng(2)
    a, b, c = generator.standard_normal((3, 1000))
    report = analyse_jacobian([np.stack([a, a + 0.01 * b, c], axis=-1)], ['a', 'b', 'c'], 1e-8)
    (group,) = report.collinear
    assert group.symbols == ('a', 'b')
    assert group.condition_index > 100.0


@pytest.mark.parametrize('model', [TorqueModel, ReplayModel])
def test_masses_show_in_three_sums_only(model, scope, bus, robot):
    trace = scope if model is TorqueModel else bus
    found = verdicts(problem_of('masses', trace, robot, models=[model(trace, robot)]), robot)
    assert {s for s, v in found.items() if v is Verdict.CONFOUNDED} == {'m_c', 'm_fb', 'm_n', 'm_payload'}


def test_without_the_torque_constant_masses_show_in_ratios_only(scope, robot):
    found = estimate_from(problem_of('masses', scope, robot, free=['K_m']), robot, 0.1)
    assert shown(found).keys() == {'m_nt / K_m', 'm_br r_Gb / K_m', 'F_s / K_m', 'F_v / K_m'}
    assert max(map(abs, errors(found, robot).values())) < EXACT


def test_rotor_and_brake_inertia_show_in_their_sum_only(scope, robot):
    found = estimate_from(problem_of('motor', scope, robot, free=['I_brake']), robot, 0.3)
    assert {'I_m', 'I_brake'}.isdisjoint(shown(found))
    assert abs(errors(found, robot)['I_m + I_brake']) < EXACT


def test_a_measuring_frame_that_may_turn_hides_the_common_azimuth(bus, robot):
    problem = problem_of('geometry', bus, robot, free=['r_z', 'theta0_1', 'theta0_2', 'theta0_3'])
    found = estimate_from(problem, robot, 0.1)
    assert {'alpha_1', 'alpha_2', 'alpha_3', 'r_z'}.isdisjoint(shown(found))
    assert {'alpha_2 - alpha_1', 'alpha_3 - alpha_1', 'theta0_1', 'l_A'} <= shown(found).keys()
    assert max(map(abs, errors(found, robot).values())) < EXACT


def test_resistance_and_inductance_need_the_voltage(scope, bus, robot):
    blind = problem_of('motor', scope, robot, models=[TorqueModel(scope, robot)])
    found = verdicts(blind, robot)
    assert found['R'] is found['L'] is Verdict.INVISIBLE
    assert found['F_s'] is found['I_m'] is Verdict.IDENTIFIABLE
    closed_loop = problem_of('motor', bus, robot, models=[ReplayModel(bus, robot)])
    x = start_values(closed_loop.quantities, robot, 0.0)
    hidden = {f.symbol: f for f in analyse(closed_loop, x).findings}
    plain = {f.symbol: f for f in analyse(problem_of('motor', scope, robot), x).findings}
    assert hidden['R'].verdict is Verdict.WEAK
    assert hidden['R'].sensitivity < 1e-2 * plain['R'].sensitivity
    assert hidden['K_m'].sensitivity > 1e2 * hidden['R'].sensitivity


def test_residuals_know_whether_they_are_white():
    noise = np.random.default_rng(3).standard_normal((4000, 3))
    coloured = noise.copy()
    for n in range(1, len(coloured)):
        coloured[n] += 0.9 * coloured[n - 1]
    assert whiteness_of(noise).lag == 1
    assert 10 < whiteness_of(coloured).lag < 40  # 0.9^lag falls below 0.1 at 22


# once per bus cycle, and the thesis


def test_samples_once_per_cycle_catch_the_ripple_and_look_like_another_inertia(bus, robot):
    found = estimate_from(problem_of('masses', bus, robot), robot, 0.3)
    assert abs(errors(found, robot)['I_b']) > 0.05


def test_a_replay_takes_single_masses_that_no_robot_has_if_their_sums_are_right(bus, robot):
    model, true = ReplayModel(bus, robot), values_of(robot)
    other = true | {'m_n': true['m_n'] + true['m_payload'] + 0.1, 'm_payload': -0.1}
    difference = model.residuals(other)[0] - model.residuals(true)[0]
    assert np.abs(difference).max() < 1e-6


def test_a_replay_finds_motor_parameters_from_bus_cycles(bus, robot):
    problem = problem_of('motor', bus, robot, known=['R', 'L'], models=[ReplayModel(bus, robot)])
    found = estimate_from(problem, robot, 0.3)
    assert shown(found).keys() == {'K_m', 'F_v', 'F_s', 'I_m'}
    assert max(map(abs, errors(found, robot).values())) < REPLAYED


def test_quotients_through_encoders_are_chance(bus, robot):
    (quotient,) = thesis_setup.quotients_of(bus, robot, symbols=['F_s'], steps=[1e-4])
    assert quotient.through_encoder > 50.0 * quotient.ideal
    assert abs(quotient.agreement) < 0.2
    (wide,) = thesis_setup.quotients_of(bus, robot, symbols=['F_s'], steps=[0.1])
    assert wide.agreement > 0.8


@pytest.mark.parametrize('off', [0.3, 0.0])
def test_least_squares_on_the_closed_loop_returns_its_initial_values(off, bus, robot):
    trace = measurement.with_noise(bus, robot, 1.0, 0)
    attempt = thesis_setup.attempt_once(trace, robot, 1e-4, off)
    assert max(map(abs, attempt.moved)) < thesis_setup.STUCK


# exciting programs


def test_the_packaged_program_excites_better_than_the_experiments(robot):
    packaged = programs.load('excitation', robot.motion)
    for group in ('masses', 'geometry'):
        own = excitation.quality(packaged, group, robot)
        for name in ('experiment1', 'experiment2', 'experiment3'):
            other = excitation.quality(programs.load(name, robot.motion), group, robot)
            assert own.condition < other.condition
    worst = max(
        f.relative_error for f in excitation.quality(packaged, 'masses', robot).findings if f.symbol == 'F_v'
    )
    assert worst < 0.01


def test_a_design_improves_and_the_same_seed_designs_the_same(robot):
    one, again = (excitation.design('geometry', robot, seed=5, tries=3, refinements=8) for _ in range(2))
    assert one.document == again.document
    assert one.condition <= one.first_condition
    assert one.evaluations >= 11
    programs.parse(one.document, robot.motion)


# CSV traces


def test_a_csv_trace_comes_back_to_the_last_bit(bus, tmp_path):
    back = trace_csv.read(trace_csv.write(bus, tmp_path / 'run.csv'))
    assert back.meta == bus.meta
    assert back.time_s.tobytes() == bus.time_s.tobytes()
    for name in bus.signals:
        assert back[name].tobytes() == bus[name].tobytes()


def test_units_in_the_header_are_turned_into_si(tmp_path):
    columns = [f'motor_speed_{i} [rpm]' for i in '123'] + [f'tcp_measured_{i} [mm]' for i in 'xyz']
    path = tmp_path / 'run.csv'
    path.write_text('\n'.join([','.join(['time [ms]', *columns]), '0,60,0,0,1,2,3', '1,0,0,0,4,5,6']))
    trace = trace_csv.read(path)
    assert trace.time_s.tolist() == [0.0, 0.001]
    assert trace['motor_speed'][0, 0] == pytest.approx(2.0 * np.pi)
    assert trace['tcp_measured'][1] == pytest.approx([4e-3, 5e-3, 6e-3])


# written down from the definitions of the units, not from the reader's table
ONE_UNIT_IN_SI = {
    's': 1.0, 'ms': 0.001, 'rad': 1.0, 'deg': 0.017453292519943295, 'rev': 6.283185307179586, 'rad/s': 1.0,
    'deg/s': 0.017453292519943295, 'rpm': 0.10471975511965977, 'A': 1.0, 'mA': 0.001, 'm': 1.0, 'mm': 0.001, 'V': 1.0,
    'N m': 1.0,
}  # fmt: skip
IN_UNITS = {'s': 'time', 'rad': 'motor_position', 'rad/s': 'motor_speed', 'A': 'current', 'm': 'tcp_measured',
            'V': 'phase_voltage', 'N m': 'coupling_torque'}  # fmt: skip


@pytest.mark.parametrize('unit', ONE_UNIT_IN_SI)
def test_every_unit_is_what_it_says(unit, tmp_path):
    assert trace_csv.UNITS.keys() == ONE_UNIT_IN_SI.keys()
    signal = IN_UNITS[trace_csv.UNITS[unit][0]]
    suffixes = 'xyz' if signal == 'tcp_measured' else '123'
    columns = (
        [f'time [{unit}]']
        if signal == 'time'
        else ['time [s]', *(f'{signal}_{i} [{unit}]' for i in suffixes)]
    )
    path = tmp_path / 'run.csv'
    path.write_text(
        f'{",".join(columns)}\n{",".join(["0"] * len(columns))}\n{",".join(["1"] * len(columns))}\n'
    )
    trace = trace_csv.read(path)
    values = trace.time_s[1] if signal == 'time' else trace[signal][1]
    assert np.all(np.abs(values / ONE_UNIT_IN_SI[unit] - 1.0) < 1e-15)


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('', 'no column time'),
        ('time [s]\n', 'no row of numbers'),
        ('time [s],speed [rad/s]\n0,1\n', 'unknown column'),
        ('time,current_1 [A],current_2 [A],current_3 [A]\n0,1,2,3\n', 'must tell its unit'),
        ('time [s],current_1 [V],current_2 [A],current_3 [A]\n0,1,2,3\n', 'must tell its unit'),
        ('time [s],current_1 [A],current_2 [A]\n0,1,2\n', 'not all three'),
        ('time [s],time [s]\n0,0\n', 'twice'),
        ('time [s]\n0\none\n', 'not only numbers'),
        ('time [s]\n0,1\n', 'has 2 values'),
        ('time [s]\nnan\n', 'not finite'),
        ('time [s]\n1\n0\n', 'do not increase'),
        ('# {"gear_ratio": \ntime [s]\n0\n', 'no JSON object'),
    ],
)
def test_a_bad_csv_trace_gets_one_sentence(text, reason, tmp_path):
    path = tmp_path / 'run.csv'
    path.write_text(text)
    with pytest.raises(TraceError, match=reason) as caught:
        trace_csv.read(path)
    assert '\n' not in str(caught.value)


# session and command line


def quiet(*_):
    """Show nothing."""


def settings_of(folder, bus, **fields):
    trace = folder / 'measured.npz'
    bus.save(trace)
    return Settings('geometry', (str(trace),), start_off=0.3, **fields)


def test_an_interrupted_estimation_goes_on_from_its_last_iterate(bus, tmp_path):
    settings = settings_of(tmp_path, bus)
    whole = Study(settings, tmp_path / 'whole', 'test', quiet).run()

    def interrupt(stage, _done, _total):
        if stage.startswith('iteration 3'):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Study(settings, tmp_path / 'parts', 'test', interrupt).run()
    kept = json.loads((tmp_path / 'parts' / 'iterate.json').read_text())
    assert kept['iteration'] == 3
    seen = []
    resumed = Study.resumed(tmp_path / 'parts', 'test', lambda stage, *_: seen.append(stage))
    assert resumed.settings == settings
    report = resumed.run()
    assert next(stage for stage in seen if stage.startswith('iteration')).startswith('iteration 3')
    for one, other in zip(whole['estimates'], report['estimates'], strict=True):
        assert one['verdict'] == other['verdict']
        if one['estimate'] is not None:
            assert one['estimate'] == pytest.approx(other['estimate'], abs=1e-7)


def test_an_estimation_does_not_go_on_with_other_inputs(bus, tmp_path):
    settings = settings_of(tmp_path, bus)
    Study(settings, tmp_path / 'run', 'test', quiet).run()
    Trace(bus.time_s, bus.signals, bus.meta | {'changed': True}).save(settings.inputs[0])
    with pytest.raises(EstimationError, match='have changed'):
        Study.resumed(tmp_path / 'run', 'test', quiet)
    with pytest.raises(EstimationError, match='no estimation began'):
        Study.resumed(tmp_path, 'test', quiet)


def test_the_command_writes_what_repeats_it(bus, tmp_path, capsys):
    trace, folder = tmp_path / 'measured.csv', tmp_path / 'out'
    trace_csv.write(bus, trace)
    arguments = [str(trace), '--group', 'geometry', '--start-off', '0.3', '--output', str(folder), '--json']
    assert estimate.main(arguments) == 0
    report = json.loads(capsys.readouterr().out)
    assert report == json.loads((folder / 'report.json').read_text())
    origin = report['provenance']
    assert parameters.load().checksum in origin['parameters']
    assert 'scipy' in origin['versions']
    assert '--start-off 0.3' in origin['command']
    assert {row['quantity'] for row in report['estimates'] if row['estimate'] is not None} == IDENTIFIABLE[
        'geometry'
    ]
    for name in ('estimates', 'sensitivities', 'residuals_1'):
        lines = (folder / f'{name}.csv').read_text().splitlines()
        assert sum(line.startswith('# ') for line in lines) == len(origin)
    assert lines[len(origin)].startswith('time [s],residual of TCP x [m]')
    for name in ('estimates', 'sensitivities', 'residuals'):
        data = (folder / f'{name}.png').read_bytes()
        assert struct.unpack('>II', data[16:24])[0] >= 800
        assert b'versions' in data[:4000]


def test_what_cannot_be_estimated_from_gets_one_sentence(bus, scope, tmp_path, capsys):
    def cut(trace, *names):
        path = tmp_path / f'without_{"_".join(names)}.npz'
        Trace(trace.time_s, {k: v for k, v in trace.signals.items() if k not in names}, trace.meta).save(path)
        return str(path)

    standing = tmp_path / 'standing.npz'
    still = {name: np.zeros_like(values) for name, values in bus.signals.items()}
    Trace(bus.time_s, still).save(standing)
    cases = {
        ('nowhere.npz',): 'error: cannot read nowhere.npz: No such file',
        ('nowhere',): 'error: cannot read nowhere: No such file',
        (cut(bus, 'tcp_measured'), '--group', 'geometry'): 'every geometry closes',
        (cut(bus, 'motor_command'), '--group', 'masses'): 'needs motor_command',
        (cut(scope, 'current'), '--group', 'masses'): 'no signal current',
        (str(standing), '--group', 'masses'): 'nothing moves',
        ('--known', 'm_b,nonsense', '--group', 'masses'): "'nonsense' is no quantity",
        ('--known', 'R,L,K_m,F_v,F_s,I_m'): 'nothing is left',
        ('experiment1', 'experiment2'): 'only one program',
        (cut(bus, 'tcp_error'), '--group', 'thesis'): 'name a program',
        ('packaging', '--group', 'masses'): 'changes the payload',
        ('--resume', str(tmp_path)): 'no estimation began',
    }
    for arguments, reason in cases.items():
        output = [] if '--resume' in arguments else ['--output', str(tmp_path / 'out')]
        assert estimate.main([*arguments, *output]) == 1
        sentence = capsys.readouterr().err.strip().splitlines()[-1]
        assert sentence.startswith('error: '), arguments
        assert reason in sentence


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['--noise', '-1'], "--noise: '-1' must be a number between 0 and 1000"),
        (['--noise', '1001'], 'between 0 and 1000'),
        (['--seed', '-1'], "--seed: '-1' must be a whole number between 0 and"),
        (['--seed', '1.5'], 'must be a whole number'),
        (['--start-off', 'nan'], "--start-off: 'nan' must be a number between -0.9 and 9"),
        (['--start-off', '9.1'], 'between -0.9 and 9'),
        (
            ['--measurement', 'out.xlsx'],
            'cannot write out.xlsx: the name ends in .xlsx, but must end in .npz or .csv',
        ),
        (['--measurement', 'out'], 'the name has no ending'),
        (['--design', 'own.xlsx'], 'the name of a program must end in .yaml'),
        (['x', '--resume', 'y'], '--resume goes on with the inputs'),
    ],
)
def test_options_out_of_range_are_refused_before_anything_runs(arguments, sentence, capsys):
    with pytest.raises(SystemExit) as caught:
        estimate.main(arguments)
    assert caught.value.code == 2
    assert sentence in capsys.readouterr().err


def test_an_input_that_cannot_be_read_leaves_an_earlier_estimation_as_it_is(bus, tmp_path):
    settings = settings_of(tmp_path, bus)
    Study(settings, tmp_path / 'run', 'test', quiet).run()
    before = {path.name: path.read_bytes() for path in (tmp_path / 'run').iterdir()}
    arguments = ['nowhere.npz', '--output', str(tmp_path / 'run')]
    assert estimate.main(arguments) == 1
    assert {path.name: path.read_bytes() for path in (tmp_path / 'run').iterdir()} == before


# from 50 % off F_s lies above the break-away torque of the built robot, which is switched off


def test_a_start_above_the_break_away_torque_is_no_robot_that_cannot_be(bus, robot):
    model = ReplayModel(bus, robot)
    true = values_of(robot)
    for static in (1.5 * true['F_s'], 10.0 * true['F_s']):
        assert np.isfinite(model.residuals(true | {'F_s': static})[0]).all()
    rich = parameters.load('rich')
    assert with_values(rich, {'F_s': 0.5}).rich.break_away_torque_n_m == 0.5
    assert with_values(rich, {'F_s': 0.05}).rich.break_away_torque_n_m == rich.rich.break_away_torque_n_m


# every option changes what it should


def run_json(arguments, capsys):
    assert estimate.main([*arguments, '--json']) == 0
    return json.loads(capsys.readouterr().out)


def estimates(report):
    return {row['quantity']: row['estimate'] for row in report['estimates'] if row['estimate'] is not None}


@pytest.fixture(scope='module')
def short(tmp_path_factory):
    """Return the file of a short program."""
    path = tmp_path_factory.mktemp('program') / 'short.yaml'
    moves = '\n'.join(
        f'  - move_l: {{to_m: {p}, speed_m_s: 2.5, acceleration_m_s2: 30}}' for p in THROUGH[:3]
    )
    path.write_text(f'name: short\nstart_m: {THROUGH[-1]}\nmoves:\n{moves}\n')
    return str(path)


def test_the_estimation_of_the_thesis_runs_as_the_readme_has_it(tmp_path, capsys):
    report = run_json(['--group', 'thesis', '--output', str(tmp_path)], capsys)
    assert any('the initial values came back' in sentence for sentence in report['explanation'])
    assert {'K_m', 'F_s'} <= estimates(report).keys()


def test_bus_cycles_from_50_percent_off_are_estimated(short, tmp_path, capsys):
    arguments = [
        short,
        '--sampling',
        'bus',
        '--start-off',
        '0.5',
        '--known',
        'R,L,I_m',
        '--output',
        str(tmp_path),
    ]
    report = run_json(arguments, capsys)
    assert [row['signal'] for row in report['residuals']] == ['current by replay']
    for row in report['estimates']:
        assert row['start'] == pytest.approx(1.5 * row['true'])
        assert row['low_95'] <= row['true'] <= row['high_95']


def test_sampling_method_and_free_choose_models_and_quantities(short, tmp_path, capsys):
    base = [short, '--group', 'masses', '--output', str(tmp_path)]
    drive = run_json(base, capsys)
    assert [row['signal'] for row in drive['residuals']] == ['current by torques']
    assert drive['residuals'][0]['intervals_from'] == 'sensor noise'
    balance = run_json([*base, '--sampling', 'bus', '--method', 'balance'], capsys)
    assert [row['signal'] for row in balance['residuals']] == ['current by torques']
    assert balance['residuals'][0]['samples'] != drive['residuals'][0]['samples']
    freed = run_json([*base, '--free', 'K_m'], capsys)
    named = [{row['quantity'] for row in report['estimates']} for report in (drive, freed)]
    assert 'K_m' in named[1] - named[0]
    held = run_json([*base, '--known', 'm_fb,m_payload'], capsys)
    assert 'm_n' in estimates(held)
    assert 'm_n' not in estimates(drive)


def test_start_off_noise_and_seed_change_the_start_and_the_measurement(short, tmp_path, capsys):
    base = [short, '--group', 'masses', '--known', 'm_fb,m_payload', '--output', str(tmp_path)]
    reports = {
        options: run_json([*base, *options], capsys)
        for options in (
            (),
            ('--start-off', '-0.2'),
            ('--noise', '1'),
            ('--noise', '1', '--seed', '1'),
            ('--noise', '3'),
        )
    }
    starts = {options: report['estimates'][0]['start'] for options, report in reports.items()}
    true = reports[()]['estimates'][0]['true']
    assert starts.pop(('--start-off', '-0.2')) == pytest.approx(0.8 * true)
    assert all(start == pytest.approx(1.3 * true) for start in starts.values())
    rms = {options: report['residuals'][0]['rms'] for options, report in reports.items()}
    assert rms[('--noise', '3')] == pytest.approx(3.0 * rms[('--noise', '1')], rel=0.05)
    assert rms[()] < 1e-2 * rms[('--noise', '1')]
    assert rms[('--noise', '1')] != rms[('--noise', '1', '--seed', '1')]
    assert reports[('--noise', '1')]['residuals'][0]['intervals_from'] == 'residuals'


def test_the_measurement_that_is_written_is_the_one_that_was_estimated_from(short, tmp_path, capsys):
    for name in ('own.npz', 'own.csv'):
        base = ['--group', 'masses', '--known', 'm_fb,m_payload', '--output', str(tmp_path / 'out')]
        one = run_json([short, *base, '--noise', '1', '--measurement', str(tmp_path / name)], capsys)
        again = run_json([str(tmp_path / name), *base, '--start-off', '0.3'], capsys)
        assert estimates(one) == estimates(again)


def test_a_design_is_a_program_for_the_group_with_its_seed(tmp_path, robot, monkeypatch, capsys):
    path, wanted = tmp_path / 'own.yaml', []
    design = excitation.design

    def quick(group, parameters, seed, on_progress=None):
        wanted.append((group, seed))
        return design(group, parameters, seed=seed, tries=2, refinements=2, on_progress=on_progress)

    monkeypatch.setattr(excitation, 'design', quick)
    for group, seed in (('geometry', '5'), ('masses', '6'), ('motor', '7')):
        assert estimate.main(['--group', group, '--design', str(path), '--seed', seed]) == 0
        assert f'# seed: {seed}' in path.read_text()
        assert programs.load(path, robot.motion).statements
    assert wanted == [('geometry', 5), ('masses', 6), ('masses', 7)]
    capsys.readouterr()


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['run.npz', '--noise', '1'], 'the inputs are traces: --noise would change nothing'),
        (['run.csv', '--sampling', 'bus', '--seed', '2'], 'the inputs are traces: --sampling, --seed would'),
        (['run.npz', '--measurement', 'own.npz'], 'the inputs are traces: --measurement would'),
        (['--group', 'thesis', '--method', 'replay'], 'of its own: --method would'),
        (['--group', 'thesis', '--free', 'K_m'], 'of its own: --free would'),
        (
            ['--group', 'geometry', '--sampling', 'bus'],
            'once per bus cycle and has one model: --sampling would',
        ),
        (['--design', 'own.yaml', '--start-off', '0.1'], '--design only writes a program: --start-off would'),
        (['experiment1', '--design', 'own.yaml'], '--design only writes a program: INPUT would'),
        (['--resume', 'folder', '--noise', '2'], 'the settings of the folder: --noise would'),
    ],
)
def test_an_option_that_would_change_nothing_is_refused(arguments, sentence, capsys):
    assert estimate.main(arguments) == 1
    assert sentence in capsys.readouterr().err
