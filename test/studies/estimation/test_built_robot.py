"""Tests of estimates from built robots: with the thesis' model and with the complete model."""

import contextlib
import json
import shlex

import numpy as np
import pytest

import pages
from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.benchmarks import estimation as benchmark
from delta3_pacdrive.cli import estimate
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.studies.estimation import missing_effects as missing
from delta3_pacdrive.studies.estimation.before_after import compare
from delta3_pacdrive.studies.estimation.measurement import simulate
from delta3_pacdrive.studies.estimation.missing_effects import fit_built
from delta3_pacdrive.studies.estimation.model_check import check
from delta3_pacdrive.studies.estimation.models import GeometryModel
from delta3_pacdrive.studies.estimation.problem import Problem
from delta3_pacdrive.studies.estimation.quantities import (
    GROUPS,
    TABLE,
    start_values,
    values_of,
    with_effects_of,
    with_values,
)
from delta3_pacdrive.studies.estimation.replay_model import ReplayModel
from estimated import LIMITS, THROUGH, quiet, shown

HARDLY_SEEN = ('R', 'd_g', 'a_6', 'gain_1', 'gain_2', 'gain_3')  # by the current once per bus cycle
WITHIN = 0.05


@pytest.fixture(scope='module')
def rich():
    return parameters.load('rich')


@pytest.fixture(scope='module')
def recorded(program, rich):
    """Return the bus signals of a built robot on the exciting program of these tests."""
    return simulation.run(program, rich)


@pytest.fixture(scope='module')
def excited(rich):
    """Return the bus signals of a built robot that moves fast, and then slowly."""
    slow = {'speed_m_s': 0.6, 'acceleration_m_s2': 10.0, 'jerk_m_s3': 500.0}
    moves = [{'move_sb': {'through_m': THROUGH, **LIMITS}}, {'move_sb': {'through_m': THROUGH[:2], **slow}}]
    return simulation.run(programs.parse({'start_m': THROUGH[-1], 'moves': moves}, rich.motion), rich)


def test_the_right_model_of_a_built_robot_leaves_the_noise_of_its_sensors(recorded, rich):
    model, values = ReplayModel(recorded, rich), values_of(rich)
    assert model.settle(values)
    (residuals,) = model.residuals(values)
    assert np.sqrt(np.mean(residuals**2)) == pytest.approx(model.blocks[0].sigma, rel=0.15)
    # masses and rotors are where the plant has them: once, and behind the gears or not
    for other in ({'m_n': 1.02 * values['m_n']}, {'I_m': 1.1 * values['I_m']}):
        assert np.sqrt(np.mean(model.residuals(values | other)[0] ** 2)) > 1.1 * model.blocks[0].sigma


@pytest.mark.long
def test_from_30_percent_off_every_identifiable_quantity_of_a_built_robot_is_found(excited, rich):
    def build(robot):
        return [ReplayModel(excited, robot)]

    quantities = GROUPS['motor'].chosen(known=HARDLY_SEEN, robot=rich)
    problem = Problem(quantities, build(rich), rich)
    found = fit_built(problem, start_values(quantities, rich, 0.3), build)
    assert check(problem, found).holds
    true, seen = values_of(rich), shown(found)
    print({s: (e.value / true[s] - 1.0, e.half_width / TABLE[s].extent(true[s])) for s, e in seen.items()})
    assert seen.keys() >= {
        'K_m',
        'F_v',
        'F_s',
        'F_b',
        'c_g',
        'b_g',
        'T_c',
        'offset_1',
        'offset_2',
        'offset_3',
    }
    for symbol, e in seen.items():
        extent = TABLE[symbol].extent(true[symbol])
        if e.half_width < WITHIN * extent:
            assert abs(e.value - true[symbol]) < WITHIN * extent, symbol
        # one of eighteen may be a little outside of its 95 %
        assert abs(e.value - true[symbol]) < 1.3 * e.half_width, symbol
    inside = [abs(e.value - true[symbol]) < e.half_width for symbol, e in seen.items()]
    assert sum(inside) >= len(inside) - 1


@pytest.mark.long
def test_95_percent_intervals_hold_the_truth_on_built_robots():
    found = benchmark.built(40)
    assert 0.92 <= found['pooled'] <= 0.98
    assert all(rate >= 0.85 for rate in found['coverage'].values())
    assert found['coverage'].keys() >= {'K_m', 'F_s', 'F_b', 'w_st', 'c_g', 'b_g', 'offset_1'}


def lines_of(page):
    """Return the arguments of each line of the block of a page that says that it is run here."""
    (block,) = (
        block
        for block in pages.blocks(pages.SOURCE / 'docs' / page)
        if block.mark == 'elsewhere' and (pages.SOURCE / block.words).samefile(__file__)
    )
    found = [shlex.split(line, comments=True) for line in block.text.splitlines()]
    assert all(program == 'delta3' for program, *_ in found)
    return [arguments for _, *arguments in found]


@pytest.fixture(scope='module')
def applied(excited, tmp_path_factory):
    """Run the commands of the documentation with a shorter recording; return folder, report and exit statuses."""
    folder, statuses = tmp_path_factory.mktemp('applied'), {}
    with contextlib.chdir(folder):
        for arguments in lines_of('tuning.md'):
            if arguments[:2] == ['simulate', 'excitation']:
                excited.save(folder / arguments[arguments.index('--trace') + 1])
                continue
            if arguments[0] == 'estimate':
                arguments += ['--known', 'R,L,I_m,d_g,a_6,z_b']
            statuses[arguments[0]] = main(arguments)
    out = folder / 'estimation'
    return out, json.loads((out / 'report.json').read_text()), statuses


@pytest.mark.long
def test_the_story_of_a_log_ends_with_a_model_that_is_nearer(applied):
    folder, *_ = applied
    excitation, estimation, comparison = lines_of('control_engineer.md')
    assert [excitation, estimation] == lines_of('tuning.md')[:2]
    with contextlib.chdir(folder.parent):
        assert main(['simulate', 'experiment1', '--parameters', 'rich', '--trace', 'robot.csv']) == 0
        assert main(['compare', 'experiment1', 'robot.csv', '--no-attribution', '--output', 'before']) == 0
        assert main([*comparison, '--no-attribution']) == 0

    def rms(name, signal):
        found = json.loads((folder.parent / name / 'report.json').read_text())['signals']
        (row,) = [row for row in found if row['signal'] == signal and row['column'] in ('all', '')]
        return row['deviation_rms']

    assert rms('after', 'tcp_error_norm') < rms('before', 'tcp_error_norm') / 3.0
    assert rms('after', 'current') < rms('before', 'current') / 2.0


@pytest.mark.long
def test_nominal_model_does_not_explain_a_built_robot_and_missing_effects_are_named(applied):
    _, report, statuses = applied
    assert report['model_holds'] is False
    assert report['verdict'][0] == 'THE MODEL DOES NOT EXPLAIN THE DATA'
    lacking = report['missing']
    assert lacking['model_holds'] is True
    named = {one['effect'] for one in lacking['effects']}
    assert {'gear', 'friction', 'sensors', 'ripple'} <= named
    assert 'stiction and Stribeck effect' in lacking['sentence']
    # what is applied explains the data: that is no error
    assert statuses == {'estimate': 0, 'simulate': 0}


@pytest.mark.long
def test_no_interval_of_a_model_that_does_not_hold_leaves_out_the_truth(applied, rich):
    _, report, _ = applied
    true = values_of(rich)
    for row in report['estimates']:
        if row['estimate'] is not None and row['low_95'] is not None:
            assert row['low_95'] <= true[row['quantity']] <= row['high_95'], row['quantity']
    assert any(row['low_95'] is not None for row in report['estimates'])


@pytest.mark.long
def test_applied_result_is_a_parameter_file_with_source_and_interval_of_each_value(applied, rich):
    folder, report, _ = applied
    path = folder / 'fitted.yaml'
    assert any(name.endswith('fitted.yaml') for name in report['files'])
    fitted = parameters.load(path)
    assert fitted.motor.static_friction_n_m == pytest.approx(rich.motor.static_friction_n_m, rel=0.02)
    assert fitted.rich.gear_backlash_rad == pytest.approx(rich.rich.gear_backlash_rad, rel=WITHIN)
    text = path.read_text()
    lines = [line for line in text.splitlines() if 'static_friction_n_m:' in line]
    (line,) = [line for line in lines if '  # F_s +- ' in line]  # the rotary axis has a friction of its own
    assert '(95 %); from ' in line
    assert 'robot.npz' in line
    assert text.startswith('# command: ')
    assert '# the model explains the data' in text


@pytest.mark.long
def test_applied_estimates_bring_the_model_closer_to_the_robot(applied):
    folder, report, _ = applied
    (row,) = report['applied']['before_after']
    assert row['rms']['tcp_error_norm_m']['factor'] > 3.0
    assert row['rms']['current_in_the_band_of_the_motion_a']['factor'] > 3.0
    # what is left of the current is the noise of the sensors, as their parameters have it
    raw, slow = row['rms']['current_a'], row['rms']['current_in_the_band_of_the_motion_a']
    assert raw['factor'] > 2.0
    assert 0.9 * raw['floor'] < raw['after'] < 1.1 * raw['floor']
    assert 0.0 < slow['floor'] < 0.5 * raw['floor']
    assert row['rms']['tcp_error_norm_m']['floor'] is None
    assert 'which explains the remainder' in row['text'][0]
    for name in ('figure_11_06_before_after.png', 'figure_11_08_before_after.png'):
        assert (folder / name).exists()


def test_the_error_norm_before_and_after_is_that_of_the_bus(recorded, rich):
    found = compare(recorded, rich, rich)
    first = int(np.searchsorted(recorded.time_s, found.time_s[0]))
    rows = slice(first, first + len(found.time_s))
    own = np.linalg.norm(recorded['tcp_error'][rows], axis=1)
    assert np.abs(found.robot.error_norm - own)[10:].max() < 0.01 * own.max()


def test_exit_status_without_apply_reports_a_failing_model(bus, tmp_path, capsys):
    trace = tmp_path / 'robot.npz'
    bus.save(trace)
    wrong = tmp_path / 'heavy.yaml'
    parameters.write(parameters.load().replace(dynamics__gravity_m_s2=6.0), wrong)
    known = 'R,L,K_m,' + ','.join(GROUPS['motor'].effects)
    arguments = [str(trace), '--parameters', str(wrong), '--known', known, '--output', str(tmp_path / 'out')]
    assert estimate.main(arguments) == 1
    told = capsys.readouterr()
    assert told.out.startswith('THE MODEL DOES NOT EXPLAIN THE DATA')
    assert 'no valid interval' in told.out
    assert told.err.strip().endswith(
        'error: the model does not explain the data, so its estimates do not apply to the robot'
    )


def test_arms_that_differ_are_found_where_the_tcp_was_measured(program, rich):
    only = rich.replace(
        **{f'rich__{name}': False for name in ('forearm_rods', 'gear', 'friction', 'ripple', 'sensors')}
    )
    nominal = only.replace(rich__enabled=False)
    trace = simulate(program, only, 'bus')
    group = GROUPS['geometry']

    def build(robot):
        return [GeometryModel(trace, robot)]

    quantities = group.chosen()
    problem = Problem(quantities, build(nominal), nominal)
    start = start_values(quantities, nominal, 0.0)
    plain = fit_built(problem, start, build)
    assert not check(problem, plain).holds
    better = missing.search(group, build, nominal, (quantities, plain.x), (), quiet)
    assert [one.effect for one in better.lacking] == ['geometry']
    assert better.check.holds
    assert better.rms < 0.1


def test_effects_represent_their_quantities_and_are_switched_on(robot):
    group = GROUPS['motor']
    assert group.named(['gear', 'R']) == ('c_g', 'd_g', 'b_g', 'R')
    freed = group.chosen(['friction', 'gear'])
    built = with_effects_of(robot, freed)
    effects = built.rich.effects
    assert (effects.friction, effects.gear, effects.sensors, effects.ripple) == (True, True, False, False)
    assert built.bus.exchange_period_s == 125e-6
    assert with_effects_of(robot, group.chosen()) is robot
    on = with_effects_of(robot, group.chosen(['sensors']))
    assert on.rich.current_gain_error == (0.0, 0.0, 0.0)
    assert with_values(on, {'gain_2': 0.01, 'offset_3': 0.02}).rich.current_gain_error == (0.0, 0.01, 0.0)
    assert {q.symbol for q in group.chosen(known=['sensors'], robot=built)}.isdisjoint({'gain_1', 'offset_1'})
    with pytest.raises(EstimationError, match='friction, gear, ripple, sensors'):
        group.chosen(['stiction'])
