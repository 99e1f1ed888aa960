"""Tests of experiments 1 to 3 (chapters 10, 11.1): differences of robot and model, and their causes."""

import csv
import dataclasses
import itertools
import json
import math

import numpy as np
import pytest

from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.cli import experiment, experiment_graph
from delta3_pacdrive.parameters import flatten
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.simulation import run
from delta3_pacdrive.studies.runs.run_signals import delayed, slope
from delta3_pacdrive.studies.thesis.experiments import figures, report
from delta3_pacdrive.studies.thesis.experiments.attribution import (
    EFFECTS,
    attribute,
    effects_of,
    shapley,
    with_effects,
)
from delta3_pacdrive.studies.thesis.experiments.compared_signals import OF_SAMPLES, QUANTITIES, Run
from delta3_pacdrive.studies.thesis.experiments.comparison import Comparison
from delta3_pacdrive.studies.thesis.experiments.conclusions import conclusions, truth

EXPERIMENTS = (1, 2, 3)
ROUNDING = 1e-12  # relative, of sums of a few hundred numbers
CHORD_M = 2e-6  # between the chords of two set points in joint angles and in space, and the increments
TEXT = 1e-9  # relative, of numbers that went through a file
SEED = 5


@pytest.fixture(scope='module')
def rich():
    """Return the parameters of the robot with every effect on."""
    return parameters.load('rich')


@pytest.fixture(scope='module')
def compared(robot, rich):
    """Return the comparison of each experiment."""
    found = {}
    for number in EXPERIMENTS:
        program = programs.load(f'experiment{number}', robot.motion)
        runs = (Run.of(run(program, each), each) for each in (robot, rich))
        found[number] = Comparison.of(*runs)
    return found


@pytest.fixture(scope='module')
def short_program(robot):
    moves = [{'move_l': {'to_m': [0.03, 0.02, -0.77]}}, {'move_l': {'to_m': [0.0, 0.0, -0.75]}}]
    return programs.parse({'moves': moves}, robot.motion)


# comparison -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize('number', EXPERIMENTS)
def test_angles_and_tcp_are_alike_but_error_norm_and_current_are_not(number, compared):
    rows = compared[number].statistics()
    found = conclusions(rows)
    assert [f.claim.split()[0] for f in found] == ['small', 'small', 'clear', 'clear']
    assert all(f.holds for f in found)
    whole = {row.signal: row for row in rows if row.column in ('', 'all')}
    assert whole['tcp_error_norm_true'].robot_rms > 2.0 * whole['tcp_error_norm'].robot_rms
    assert f'{whole["tcp_error_norm_true"].robot_max:.3f} mm' in truth(rows)


def test_model_with_the_exact_exchange_period_is_not_a_robot(robot, compared):
    program = programs.load('experiment3', robot.motion)
    exact = robot.replace(bus__exchange_period_s=125e-6)
    comparison = Comparison.of(compared[3].model, Run.of(run(program, exact), exact))
    found = conclusions(comparison.statistics())
    assert [f.holds for f in found] == [True, True, False, False]


def test_a_run_does_not_deviate_from_itself(compared):
    model = compared[1].model
    rows = Comparison.of(model, model).statistics()
    assert {row.deviation_max for row in rows} == {0.0}
    assert {row.signal for row in rows} == set(QUANTITIES)


def test_the_reference_of_the_arms_is_the_reference_of_the_tcp(compared, robot):
    model = compared[3].model
    by_arms = kinematics.forward(compared[3].measured(model.reference['arm_angle']), robot.kinematics)
    assert np.abs(by_arms - compared[3].measured(model.reference['tcp'])).max() < CHORD_M


def test_true_error_is_the_sum_of_measured_and_hidden_errors(compared):
    robot = compared[2].robot
    missed = np.linalg.norm(robot.actual['tcp_true'] - robot.actual['tcp'], axis=1)
    seen, true = robot.actual['tcp_error_norm'][:, 0], robot.actual['tcp_error_norm_true'][:, 0]
    assert (np.abs(true - missed) <= seen + 1e-12).all()
    assert (true > seen).all()  # the arms as built are off by more than the drives ever see


def test_a_delayed_ramp_is_the_ramp_of_that_time_before():
    ramp = np.arange(10.0)[:, None] * [1.0, -2.0, 0.5]
    for cycles in (0.0, 1.75, 2.0):
        late = delayed(ramp, cycles)
        first = math.ceil(cycles + 1e-9)
        assert np.isnan(late[: math.floor(cycles) + 1]).all()
        assert late[first + 1 :] == pytest.approx(ramp[first + 1 :] - cycles * ramp[1])


def test_runs_of_different_cycle_times_are_compared_at_those_of_the_longer_one(robot, short_program):
    slow = robot.replace(bus__cycle_time_s=2e-3, bus__exchange_period_s=500e-6)
    fast, coarse = (Run.of(run(short_program, each), each) for each in (robot, slow))
    for comparison in (Comparison.of(fast, coarse), Comparison.of(coarse, fast)):
        assert comparison.model.period_s == comparison.robot.period_s == 2e-3
        assert np.diff(comparison.time_s) == pytest.approx(2e-3)
    of_fast = Comparison.of(fast, coarse).model
    rows = np.searchsorted(fast.cycle, 2 * of_fast.cycle)
    for name in ('arm_angle', 'current_at', 'tcp_error_norm'):
        np.testing.assert_array_equal(of_fast.actual[name], fast.actual[name][rows], err_msg=name)
    alike = slope(fast.actual['arm_speed'][rows], 2e-3)
    np.testing.assert_array_equal(of_fast.actual['arm_acceleration'], alike)


def test_of_currents_no_sample_is_left_out_where_a_longer_cycle_is_compared(robot, short_program):
    slow = robot.replace(bus__cycle_time_s=2e-3)
    fast, coarse = (Run.of(run(short_program, each), each) for each in (robot, slow))
    found = Comparison.of(fast, coarse)
    rows = np.searchsorted(fast.cycle, 2 * found.model.cycle)[:-1]
    pairs = {name: fast.actual[name][rows[:, None] + np.arange(2)] for name in ('current', *OF_SAMPLES)}
    for name, expected in (
        ('current', pairs['current'].mean(axis=1)),
        ('current_min', pairs['current_min'].min(axis=1)),
        ('current_max', pairs['current_max'].max(axis=1)),
        ('current_rms', np.sqrt((pairs['current_rms'] ** 2).mean(axis=1))),
    ):
        np.testing.assert_allclose(found.model.actual[name][:-1], expected, rtol=1e-12, err_msg=name)


def test_a_recording_that_has_only_the_currents_of_the_at_is_compared_by_these(robot, short_program):
    whole = run(short_program, robot)
    bare = {name: values for name, values in whole.signals.items() if not name.startswith('current_')}
    poor = Run.of(Trace(whole.time_s, bare, whole.meta), robot)
    found = Comparison.of(Run.of(whole, robot), poor)
    rows = {(row.signal, row.column): row for row in found.statistics()}
    assert rows['current', 'all'].deviation_max == 0.0
    assert rows['current', 'all'].model_max == np.abs(whole['current'][whole.meta['start_cycle'] :]).max()
    assert ('current_at', 'all') not in rows
    assert 'current_at' not in found.missing


def test_a_gap_in_a_recording_costs_only_its_cycles(robot, short_program, compared):
    whole = run(short_program, robot)
    keep = np.ones(len(whole.time_s), dtype=bool)
    keep[300:310] = False
    torn = Trace(
        whole.time_s[keep], {name: values[keep] for name, values in whole.signals.items()}, whole.meta
    )
    comparison = Comparison.of(Run.of(whole, robot), Run.of(torn, robot))
    assert {row.deviation_max for row in comparison.statistics()} == {0.0}
    cycles = int(comparison.counted.sum())
    assert len(comparison.measured(comparison.deviation('current'))) == cycles - 10


# attribution ----------------------------------------------------------------------------------------------------------


def test_every_switch_of_the_rich_plant_is_an_effect(rich):
    switches = {f.name for f in dataclasses.fields(rich.rich) if f.type is bool} - {'enabled'}
    assert {effect.switch for effect in EFFECTS.values()} == switches
    optional = ('parallelogram', 'frame', 'elastic_rods')
    assert effects_of(rich.replace(**{f'rich__{name}': True for name in optional})) == tuple(EFFECTS)
    assert effects_of(rich) == tuple(name for name in EFFECTS if name not in optional)


def test_robot_with_all_effects_is_unchanged_and_without_any_nominal(rich, robot, short_program):
    assert flatten(with_effects(rich, EFFECTS)) == flatten(rich)
    bare = run(short_program, with_effects(rich, ()))
    plain = run(short_program, robot.replace(bus__exchange_period_s=125e-6))
    for name, values in plain.signals.items():
        assert bare[name].tobytes() == values.tobytes()


def test_effect_without_magnitude_or_switch_is_invalid(rich, robot):
    assert effects_of(robot) == ()
    assert 'cogging' not in effects_of(rich.replace(rich__cogging_torque_n_m=0.0))
    assert set(effects_of(rich.replace(rich__sensors=False))) == set(effects_of(rich)) - {
        'current_sensors',
        'encoders',
    }


def test_effects_with_a_common_switch_are_separable(rich):
    only = with_effects(rich, ['encoders']).rich
    assert only.effects.sensors
    assert only.encoder_noise_rad == rich.rich.encoder_noise_rad
    assert only.current_noise_a == 0.0
    assert only.current_gain_error == (0.0, 0.0, 0.0)
    assert not only.effects.ripple


def test_shapley_values_are_the_mean_over_all_orders():
    values = np.random.default_rng(SEED).normal(size=(16, 2))
    expected = np.zeros((4, 2))
    for order in itertools.permutations(range(4)):
        mask = 0
        for player in order:
            expected[player] += values[mask | 1 << player] - values[mask]
            mask |= 1 << player
    assert shapley(values) == pytest.approx(expected / math.factorial(4))


def test_shapley_values_of_additive_effects_are_their_projections_on_the_total():
    """The worth is a mean square, so that each share is mean(d_i d)."""
    waves = np.random.default_rng(SEED).normal(size=(5, 200))
    on = np.array([[mask >> i & 1 for i in range(5)] for mask in range(32)])
    worth = ((on @ waves) ** 2).mean(axis=1)
    assert shapley(worth) == pytest.approx((waves * waves.sum(axis=0)).mean(axis=1))


def test_a_number_of_coalitions_that_fits_no_players_is_rejected():
    with pytest.raises(ValueError, match='coalitions is 3'):
        shapley(np.zeros(3))


@pytest.fixture(scope='module')
def attributed(robot, rich, short_program):
    """Return the attribution of a robot with friction, encoders and geometric errors."""
    some = with_effects(rich, ['friction', 'encoders', 'geometry'])
    told = []
    model = Run.of(run(short_program, robot), robot)
    found = attribute(short_program, model, robot, some, lambda _, done, total: told.append((done, total)))
    assert told == [(done, 8) for done in range(9)]
    return found


def test_the_shares_add_up_to_the_difference(attributed):
    assert attributed.effects == ('friction', 'encoders', 'geometry')
    assert attributed.simulations == 8
    for outcome in attributed.outcomes.values():
        whole = sum(outcome.share.values()) + outcome.other
        assert whole == pytest.approx(outcome.total, rel=ROUNDING, abs=ROUNDING * abs(outcome.robot))


def test_unknown_effect_is_named(attributed):
    assert attributed.other_parameters == ('bus.exchange_period_s',)
    assert abs(attributed.outcomes['current', 'deviation'].other) > 0.0


def test_geometry_explains_the_true_error_and_none_of_the_measured_error(attributed):
    def percent(signal, effect):
        outcome = attributed.outcomes[signal, 'deviation']
        return outcome.percent(outcome.share[effect])

    assert percent('tcp_error_norm_true', 'geometry') > 90.0
    assert percent('tcp_error_norm', 'friction') > 80.0
    for signal in ('arm_angle', 'current', 'tcp_error_norm'):
        assert abs(percent(signal, 'geometry')) < 5.0


# report ---------------------------------------------------------------------------------------------------------------


def _read(path):
    """Return the comments, the header and the rows of a table."""
    lines = path.read_text(encoding='utf-8').splitlines()
    comments = [line for line in lines if line.startswith('#')]
    header, *rows = csv.reader(lines[len(comments) :])
    return comments, header, rows


@pytest.fixture(scope='module')
def folder(tmp_path_factory, rich):
    """Return the folder that the command leaves for experiment 3 with a robot of two effects."""
    place = tmp_path_factory.mktemp('experiment')
    robot = parameters.write(with_effects(rich, ['gear', 'geometry']), place / 'two.yaml')
    status = experiment.main(
        ['3', '--robot', str(robot), '--seed', '9', '--output', str(place / 'out'), '--json']
    )
    assert status == 0
    return place / 'out'


def test_the_folder_holds_figures_11_17_to_11_24_and_all_that_the_report_names(folder):
    document = json.loads((folder / 'report.json').read_text(encoding='utf-8'))
    names = {path.name for path in folder.iterdir()}
    assert {path.rpartition('/')[2] for path in document['files']} == names
    assert sorted(name[:12] for name in names if name.startswith('figure')) == [
        f'figure_11_{n}' for n in range(17, 25)
    ]
    assert {
        'signals.csv',
        'table.csv',
        'attribution.csv',
        'attribution.png',
        'model.yaml',
        'robot.yaml',
    } < names


def test_the_table_is_that_of_the_signals(folder):
    _, header, rows = _read(folder / 'signals.csv')
    cells = np.array([[float(cell) if cell else math.nan for cell in row] for row in rows])
    column = dict(zip(header, cells.T, strict=True))
    measured = column['time [s]'] >= 0.0
    _, names, table = _read(folder / 'table.csv')
    entries = [dict(zip((name.split()[0] for name in names), row, strict=True)) for row in table]
    for signal, axis, factor, unit in (
        ('current', '2', 1.0, 'A'), ('arm_angle', '1', math.degrees(1.0), 'rad'), ('tcp_error_norm', '', 1e3, 'm'),
    ):  # fmt: skip
        (entry,) = (e for e in entries if (e['signal'], e['column']) == (signal, axis))
        label = f'{signal}_{axis}'.rstrip('_')
        model, robot = (factor * column[f'{label} {who} [{unit}]'][measured] for who in ('model', 'robot'))
        largest, square = np.abs(model), robot**2
        if signal == 'current':  # of all samples, not of their mean in a cycle
            largest = np.maximum(-column['current_min_2 model [A]'], column['current_max_2 model [A]'])[
                measured
            ]
            square = column['current_rms_2 robot [A]'][measured] ** 2
        assert float(entry['model_max']) == pytest.approx(largest.max(), rel=TEXT)
        assert float(entry['robot_rms']) == pytest.approx(math.sqrt(square.mean()), rel=TEXT)
        assert float(entry['deviation_max']) == pytest.approx(np.abs(robot - model).max(), rel=TEXT)


def test_every_output_names_its_origin_and_the_files_repeat_it(folder, robot):
    document = json.loads((folder / 'report.json').read_text(encoding='utf-8'))
    origin = document['provenance']
    written = {name: parameters.load(folder / f'{name}.yaml') for name in ('model', 'robot')}
    assert flatten(written['model']) == flatten(robot)
    assert written['robot'].rich.sensor_seed == 9
    for parameter in written.values():
        assert parameter.checksum in origin['parameters']
    assert origin['command'].startswith('delta3 experiment 3 --robot')
    assert 'experiment3' in origin['inputs']
    for name in report.TABLES:
        comments, _, _ = _read(folder / name)
        assert comments == [f'# {key}: {text}' for key, text in origin.items()]
    assert origin['command'].encode() in (folder / 'figure_11_24_tcp_error_norm.png').read_bytes()


def test_report_explains_the_acceleration_and_is_independent_of_a_seed(folder):
    document = json.loads((folder / 'report.json').read_text(encoding='utf-8'))
    assert 'slope' in document['acceleration']
    assert document['notes'] == ['the robot has no sensor noise, so --seed changes nothing']
    assert document['provenance']['seed'] == 'none'


def test_report_without_attribution_removes_that_of_an_earlier_one(tmp_path, capsys):
    for name in ('attribution.csv', 'attribution.png', 'figure_11_01_tcp_path.png', 'report.json'):
        (tmp_path / name).write_text('old')
    (tmp_path / 'notes.txt').write_text('mine')
    assert experiment.main(['1', '--no-attribution', '--output', str(tmp_path)]) == 0
    names = {path.name for path in tmp_path.iterdir()}
    assert names.isdisjoint({'attribution.csv', 'attribution.png'})
    assert (tmp_path / 'notes.txt').read_text() == 'mine'
    assert json.loads((tmp_path / 'report.json').read_text(encoding='utf-8'))['attribution'] is None
    printed = capsys.readouterr().out
    assert 'reproduced' not in printed
    assert 'Claims:' in printed
    assert 'Attribution (Shapley' not in printed


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (
            ['--parameters', 'nowhere.yaml'],
            'cannot read parameter file nowhere.yaml: No such file or directory',
        ),
        (
            ['--output', '/proc/nowhere'],
            'cannot write to /proc/nowhere: the folder /proc may not be written: No such file or directory',
        ),
    ],
)
def test_invalid_request_gives_one_message(arguments, sentence, capsys):
    assert experiment.main(['1', *arguments]) == 1
    assert capsys.readouterr().err == f'error: {sentence}\n'


@pytest.mark.parametrize(
    'arguments',
    [
        ['4'],
        [],
        ['1', '--real-time-factor', '1'],
        ['1', '--seed', '-1'],
        ['1', '--graph', '--real-time-factor', 'nan'],
    ],
)
def test_a_bad_option_is_a_usage_error(arguments, capsys):
    with pytest.raises(SystemExit) as exit_:
        experiment.main(arguments)
    assert exit_.value.code == 2
    assert 'usage: delta3 experiment' in capsys.readouterr().err


def test_interruption_leaves_no_incomplete_report(tmp_path, monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    (tmp_path / 'report.json').write_text('old')
    monkeypatch.setattr('delta3_pacdrive.studies.thesis.experiments.attribution.attribute', interrupted)
    assert experiment.main(['1', '--output', str(tmp_path)]) == 130
    assert capsys.readouterr().err.endswith('interrupted: no report was written\n')
    assert {path.name for path in tmp_path.iterdir()} == {'model.yaml', 'robot.yaml'}


# nodes ----------------------------------------------------------------------------------------------------------------


def test_a_bag_is_never_overwritten(tmp_path):
    (tmp_path / 'bag_robot').mkdir()
    (tmp_path / 'report.json').write_text('old')
    assert experiment.main(['1', '--graph', '--output', str(tmp_path)]) == 1
    assert (tmp_path / 'report.json').read_text() == 'old'


def test_one_changed_bit_is_a_difference(robot, short_program):
    trace = run(short_program, robot)
    assert 'bit-identical in 17 signals' in experiment_graph.same_as(trace, trace)
    other = {name: values.copy() for name, values in trace.signals.items()}
    other['current'][300, 1] = np.nextafter(other['current'][300, 1], np.inf)
    changed = Trace(trace.time_s, other, trace.meta)
    assert experiment_graph.same_as(changed, trace) == 'nodes and simulation differ in current'


@pytest.mark.long
def test_a_seed_is_that_of_the_robot_s_sensors(tmp_path, capsys):
    bits, seeds = [], []
    for seed in ('5', '6', '5'):
        folder = tmp_path / str(len(bits))
        arguments = ['1', '--no-attribution', '--seed', seed, '--output', str(folder), '--json']
        assert experiment.main(arguments) == 0
        capsys.readouterr()
        rows = [
            line for line in (folder / 'signals.csv').read_text().splitlines() if not line.startswith('#')
        ]
        bits.append('\n'.join(rows))
        seeds.append(parameters.load(folder / 'robot.yaml').rich.sensor_seed)
        assert parameters.load(folder / 'model.yaml').checksum == parameters.load().checksum
    assert seeds == [5, 6, 5]
    assert bits[0] == bits[2] != bits[1]


def test_a_robot_with_two_rotary_axes_is_compared_with_one_without(robot, rich, short_program):
    turning = with_effects(rich, ['friction']).replace(rotary__present=True, rotary_2__present=True)
    found = attribute(
        short_program, Run.of(run(short_program, robot), robot), robot, turning, lambda *_: None
    )
    assert found.effects == ('friction',)
    assert {'rotary.present', 'rotary_2.present'} < set(found.other_parameters)


def test_mutually_cancelling_effects_are_shown_in_full(robot, rich, short_program):
    """The tilt of the plate compensates a part of the effect of geometric errors on the true TCP."""
    tilted = with_effects(rich.replace(rich__parallelogram=True), ['geometry', 'parallelogram'])
    found = attribute(short_program, Run.of(run(short_program, robot), robot), robot, tilted, lambda *_: None)
    outcome = found.outcomes['tcp_error_norm_true', 'deviation']
    assert outcome.percent(outcome.share['geometry']) > 100.0
    assert outcome.percent(outcome.share['parallelogram']) < 0.0
    for axes in figures.effects(found, 'robot').axes:
        left, right = axes.get_xlim()
        assert all(
            left < value < right
            for bar in axes.patches
            for value in (bar.get_x(), bar.get_x() + bar.get_width())
        )
