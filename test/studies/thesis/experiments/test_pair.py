"""Tests of the comparison of any two runs as model and robot: programs, traces, and foreign tables."""

import json

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.framework.study import silent
from delta3_pacdrive.studies.runs import runs
from delta3_pacdrive.studies.thesis.experiments import figures, report
from delta3_pacdrive.studies.thesis.experiments.compared_signals import QUANTITIES, Run
from delta3_pacdrive.studies.thesis.experiments.comparison import Comparison
from delta3_pacdrive.studies.thesis.experiments.run import PairStudy, Study, compared
from delta3_pacdrive.studies.thesis.experiments.study import Pair, Settings

SHORT = """
moves:
- move_l: {to_m: [0.03, 0.02, -0.77]}
- move_l: {to_m: [0.0, 0.0, -0.75]}
"""


@pytest.fixture(scope='module')
def nominal():
    return runs.load('experiment1')


@pytest.fixture(scope='module')
def built():
    return runs.load('experiment1', 'rich')


def table_of(run, path, names, rate_hz=1000.0, origin_s=5.0):
    """Write some signals of a run, on the side of the arms, as a table without a bus cycle."""
    part, gear = run.window, run.robot.dynamics.gear_ratio
    time_s = np.arange(round((part.time_s[-1] - part.time_s[0]) * rate_hz) + 1) / rate_hz + part.time_s[0]
    told = {
        'arm_position': part['motor_position'] / gear,
        'arm_speed': part['motor_speed'] / gear,
        'arm_position_reference': part['motor_command'] / gear,
        'current': part['current'],
        'tcp_actual': part['tcp_actual'],
        'tcp_error_norm': np.linalg.norm(part['tcp_error'], axis=1)[:, None],
    }
    signals = {
        name: np.column_stack([np.interp(time_s, part.time_s, column) for column in told[name].T])
        for name in names
    }
    trace_file.save(Trace(time_s + origin_s, signals), path)
    return runs.load(str(path))


def by_signal(rows):
    return {row.signal: row for row in rows if row.column in ('', 'all')}


def test_two_programs_have_the_figures_of_the_experiment(nominal, built):
    found = compared(Pair(nominal, built, attributed=False))
    model, robot = (Run.of(run.whole, run.robot) for run in (nominal, built))
    assert found.comparison.statistics() == Comparison.of(model, robot).statistics()
    assert found.number is None
    assert report.summary(found)['claims'] == []


def test_a_table_of_a_robot_has_the_figures_of_its_trace(nominal, built, tmp_path):
    names = ('arm_position', 'arm_speed', 'arm_position_reference', 'current')
    table = table_of(built, tmp_path / 'robot.csv', names)
    exact = by_signal(compared(Pair(nominal, built, attributed=False)).comparison.statistics())
    found = by_signal(compared(Pair(nominal, table, 'correlation', attributed=False)).comparison.statistics())
    assert found.keys() == {name for name in QUANTITIES if not name.endswith(('_true', '_at'))}
    for name in ('arm_angle', 'arm_speed', 'arm_acceleration', 'current', 'tcp', 'tcp_error_norm'):
        for statistic in ('robot_max', 'robot_rms', 'model_rms'):
            of_trace = exact['current_at' if name == 'current' else name]  # the table has no other samples
            assert getattr(found[name], statistic) == pytest.approx(getattr(of_trace, statistic), rel=0.02), (
                name
            )
    # what a robot lags behind its model is a shift for whoever aligns by motion
    assert found['current'].deviation_rms == pytest.approx(exact['current_at'].deviation_rms, rel=0.1)


def test_signals_that_are_missing_are_named_and_the_others_compared(nominal, built, tmp_path):
    table = table_of(built, tmp_path / 'robot.csv', ('arm_position', 'tcp_error_norm'), 700.0)
    found = compared(Pair(nominal, table, attributed=False))
    assert by_signal(found.comparison.statistics()).keys() == {'arm_angle', 'tcp', 'tcp_error_norm'}
    assert any('these signals are not in both runs: arm_speed, arm_acceleration, current' in note
               for note in report.summary(found)['notes'])  # fmt: skip
    assert any('both are compared every 1.42857 ms' in note for note in found.notes)
    drawn = figures.by_name(found)
    assert [name.partition('_11_')[2][:2] for name in drawn] == ['01', '02', '07', '08']
    for draw in drawn.values():
        draw()


def test_a_gap_of_the_robot_costs_only_its_instants(nominal, built, tmp_path):
    names = ('arm_position', 'arm_speed', 'current')
    table = table_of(built, tmp_path / 'robot.csv', names)
    rows = (tmp_path / 'robot.csv').read_text().splitlines()
    torn = tmp_path / 'torn.csv'
    torn.write_text('\n'.join(rows[:400] + rows[450:]) + '\n')
    found = compared(Pair(nominal, runs.load(str(torn)), attributed=False))
    whole = compared(Pair(nominal, table, attributed=False))
    missing = len(whole.comparison.measured(whole.comparison.deviation('current'))) - len(
        found.comparison.measured(found.comparison.deviation('current'))
    )
    assert missing == pytest.approx(50, abs=2)
    assert any('50 of' in note and 'samples are missing' in note for note in found.notes)


def test_signal_without_common_samples_counts_as_missing(nominal, built, tmp_path):
    table = table_of(built, tmp_path / 'robot.csv', ('arm_position', 'tcp_error_norm'))
    rows = (tmp_path / 'robot.csv').read_text().splitlines()
    held = [row if n < 10 else row.rpartition(',')[0] + ',' for n, row in enumerate(rows)]
    (tmp_path / 'short.csv').write_text('\n'.join(held) + '\n')
    found = compared(Pair(nominal, runs.load(str(tmp_path / 'short.csv')), attributed=False))
    assert 'tcp_error_norm' in compared(Pair(nominal, table, attributed=False)).comparison.names
    assert 'tcp_error_norm' in found.comparison.missing
    assert not any('error_norm' in name for name in figures.by_name(found))


def test_two_tables_are_compared_where_both_are(built, tmp_path):
    names = ('arm_position', 'arm_speed', 'current')
    one = table_of(built, tmp_path / 'a.csv', names, 1000.0, 3.0)
    other = table_of(built, tmp_path / 'b.csv', names, 1000.0, 800.0)
    found = compared(Pair(one, other, attributed=False))
    assert found.alignment.shift_s == pytest.approx(-797.0, abs=1e-6)
    assert found.comparison.counted.all()
    assert max(row.deviation_max_percent for row in found.comparison.statistics()) < 0.01


def test_runs_without_a_common_signal_are_rejected(nominal, built, tmp_path):
    table = table_of(built, tmp_path / 'a.csv', ('tcp_error_norm',))
    with pytest.raises(TraceError):
        compared(Pair(nominal, table))


def test_two_simulations_of_one_program_are_attributed(tmp_path):
    (tmp_path / 'short.yaml').write_text(SHORT)
    short = str(tmp_path / 'short.yaml')
    robot = parameters.load('rich').replace(
        rich__gear=False,
        rich__ripple=False,
        rich__sensors=False,
        rich__geometry=False,
        rich__forearm_rods=False,
    )
    parameters.write(robot, tmp_path / 'friction.yaml')
    model, other = runs.load(short), runs.load(short, str(tmp_path / 'friction.yaml'))
    found = compared(Pair(model, other))
    assert found.attribution.effects == ('friction',)
    outcome = found.attribution.outcomes['current', 'deviation']
    assert outcome.robot == pytest.approx(found.comparison.mean_square_deviation('current'))
    assert outcome.share['friction'] + outcome.other == pytest.approx(outcome.total)


@pytest.mark.parametrize(
    ('other', 'why'),
    [
        (('experiment2', 'rich'), 'the programs are not the same'),
        (('experiment1', None), 'the robot has none of the effects'),
        (('a.npz', None), 'both runs must be programs'),
    ],
)
def test_unattributed_remainder_is_reported(other, why, nominal, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    trace_file.save(nominal.whole, 'a.npz')
    found = compared(Pair(nominal, runs.load(*other)))
    assert found.attribution is None
    assert any(why in note for note in found.notes)


def test_folder_of_a_pair_has_the_files_of_an_experiment(nominal, built, tmp_path):
    document = PairStudy(Pair(nominal, built, attributed=False), tmp_path / 'out', 'a test', silent).run()
    names = {path.name for path in (tmp_path / 'out').iterdir()}
    assert {'index.html', 'report.json', 'signals.csv', 'table.csv'} <= names
    assert len([name for name in names if name.startswith('figure_11_0')]) == 8
    assert json.loads((tmp_path / 'out' / 'report.json').read_text()) == document


# experiments with another bus cycle -----------------------------------------------------------------------------------


@pytest.fixture
def slow(tmp_path):
    return str(
        parameters.write(parameters.load('rich').replace(bus__cycle_time_s=2e-3), tmp_path / 'slow.yaml')
    )


@pytest.mark.long
def test_the_packaged_model_runs_with_the_bus_cycle_of_the_robot(slow, tmp_path):
    document = Study(Settings(1, robot=slow, attributed=False), tmp_path / 'out', 'a test', silent).run()
    assert document['period_s'] == 2e-3
    assert 'the model runs with the bus cycle of the robot, 2 ms' in document['notes']
    assert parameters.load(tmp_path / 'out' / 'model.yaml').bus.cycle_time_s == 2e-3


@pytest.mark.long
def test_requested_model_keeps_its_bus_cycle(slow, tmp_path):
    model = str(parameters.write(parameters.load(), tmp_path / 'model.yaml'))
    document = Study(Settings(1, model, slow, attributed=False), tmp_path / 'out', 'a test', silent).run()
    assert document['period_s'] == 2e-3
    assert (
        'the bus cycles are 1 ms of the model and 2 ms of the robot: both are compared every 2 ms'
        in document['notes']
    )
    assert parameters.load(tmp_path / 'out' / 'model.yaml').bus.cycle_time_s == 1e-3


# the command ----------------------------------------------------------------------------------------------------------


def test_command_reads_a_third_party_table_and_reports_the_shift(built, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    table_of(built, tmp_path / 'plain.csv', ('arm_position', 'arm_speed', 'current'), 700.0, 1234.5)
    text = (tmp_path / 'plain.csv').read_text().split('\n', 1)[1]
    rows = text.split('\n', 1)[1]
    (tmp_path / 'robot.csv').write_bytes(
        ('Gerät 7\n' + ';'.join(f'K{n}' for n in range(10)) + '\n' + rows.replace(',', ';').replace('.', ','))
        .encode('cp1252')
    )  # fmt: skip
    columns = ['skip_lines: 1', 'columns:', '- {column: K0, signal: time, unit: s}']
    for n, (name, unit) in enumerate((('arm_position', 'rad'), ('arm_speed', 'rad/s'), ('current', 'A'))):
        columns += [
            f'- {{column: K{3 * n + axis}, signal: {name}, axis: {axis}, unit: {unit}}}' for axis in (1, 2, 3)
        ]
    (tmp_path / 'columns.yaml').write_text('\n'.join(columns))
    arguments = ['compare', 'experiment1', 'robot.csv', '--columns', 'columns.yaml']
    assert main([*arguments, '--json']) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['alignment']['by'] == 'best correlation'
    assert result['alignment']['shift_s'] == pytest.approx(-1234.5, abs=2e-4)
    assert result['model_and_robot']['signals'][0]['signal'] == 'arm_angle'
    assert main([*arguments, '--output', 'out']) == 0
    out = capsys.readouterr().out
    assert 'aligned by best correlation, shifted by -1234' in out
    assert '(95 %)' in out
    assert 'those of delta3.yaml are used' in out
    assert (tmp_path / 'out' / 'index.html').exists()


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (
            ['experiment1', 'experiment2', '--columns', 'c.yaml'],
            'experiment1 is a program, the column file c.yaml',
        ),
        (['experiment1', 'a.csv', '--columns', ',missing.yaml'], 'cannot read column file missing.yaml'),
        (['experiment1', 'a.csv'], "a.csv has an unknown column 'K0'"),
    ],
)
def test_command_rejects_unreadable_input_with_one_message(
    arguments, sentence, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'a.csv').write_text('K0;K1\n0;1\n')
    assert main(['compare', *arguments]) == 1
    captured = capsys.readouterr()
    assert sentence in captured.err
    assert captured.err.count('\n') == 1
