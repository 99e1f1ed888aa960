"""Tests of estimation runs: interrupted, resumed, repeated, with every option."""

import json
import shlex
import struct

import numpy as np
import pytest

import pages
from delta3_pacdrive import parameters
from delta3_pacdrive.cli import estimate
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording import trace_csv
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.estimation import excitation
from delta3_pacdrive.studies.estimation.run import Settings, Study
from estimated import IDENTIFIABLE, THROUGH, quiet

# session and command line


def settings_of(folder, bus, **fields):
    trace = folder / 'measured.npz'
    bus.save(trace)
    return Settings('geometry', (str(trace),), start_off=0.3, **fields)


def test_interrupted_estimation_continues_from_its_last_iterate(bus, tmp_path):
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


def test_corrections_of_arms_do_not_start_the_group_geometry(bus, tmp_path):
    robot = parameters.load().replace(kinematics__upper_arm_correction_m=(1e-4, 0.0, 0.0))
    path = parameters.write(robot, tmp_path / 'corrected.yaml')
    settings = settings_of(tmp_path, bus, parameters=str(path))
    with pytest.raises(EstimationError, match=r'requires equal arms, but .*corrected\.yaml has corrections'):
        Study(settings, tmp_path / 'run', 'test', quiet)


def test_estimation_does_not_continue_with_other_inputs(bus, tmp_path):
    settings = settings_of(tmp_path, bus)
    Study(settings, tmp_path / 'run', 'test', quiet).run()
    Trace(bus.time_s, bus.signals, bus.meta | {'changed': True}).save(settings.inputs[0])
    with pytest.raises(EstimationError, match='have changed'):
        Study.resumed(tmp_path / 'run', 'test', quiet)
    with pytest.raises(EstimationError, match='no estimation began'):
        Study.resumed(tmp_path, 'test', quiet)


def test_command_writes_its_own_reproduction_command(bus, tmp_path, capsys, drawn):
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


def test_unsuitable_input_of_an_estimation_gives_one_message(bus, scope, tmp_path, capsys):
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
        ('--known', 'm_b,nonsense', '--group', 'masses'): "'nonsense' is not a quantity",
        ('--known', 'R,L,K_m,F_v,F_s,I_m'): 'nothing to estimate',
        ('experiment1', 'experiment2'): 'only one program',
        (cut(bus, 'motor_command'), '--group', 'thesis'): 'no signal motor_command',
        (cut(bus, 'tcp_error'), '--validate', 'experiment1'): '--validate takes recordings',
        ('--validate', 'a.npz'): '--validate takes programs',
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
            'cannot write out.xlsx: the name ends in .xlsx, but must end in .npz, .csv or .parquet',
        ),
        (['--measurement', 'out'], 'the name has no ending'),
        (['--design', 'own.xlsx'], 'the name of a program must end in .yaml'),
        (['x', '--resume', 'y'], '--resume uses the inputs'),
    ],
)
def test_options_out_of_range_are_rejected_before_the_run(arguments, sentence, capsys):
    with pytest.raises(SystemExit) as caught:
        estimate.main(arguments)
    assert caught.value.code == 2
    assert sentence in capsys.readouterr().err


def test_unreadable_input_keeps_an_earlier_estimation(bus, tmp_path):
    settings = settings_of(tmp_path, bus)
    Study(settings, tmp_path / 'run', 'test', quiet).run()
    before = {path.name: path.read_bytes() for path in (tmp_path / 'run').iterdir()}
    arguments = ['nowhere.npz', '--output', str(tmp_path / 'run')]
    assert estimate.main(arguments) == 1
    assert {path.name: path.read_bytes() for path in (tmp_path / 'run').iterdir()} == before


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


@pytest.mark.long
def test_the_estimation_of_the_thesis_runs_as_the_documentation_has_it(tmp_path, capsys):
    report = run_json(['--group', 'thesis', '--output', str(tmp_path)], capsys)
    assert any('returned the initial values' in sentence for sentence in report['explanation'])
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


def test_written_measurement_is_the_estimated_one(short, tmp_path, capsys):
    for name in ('own.npz', 'own.csv'):
        base = ['--group', 'masses', '--known', 'm_fb,m_payload', '--output', str(tmp_path / 'out')]
        one = run_json([short, *base, '--noise', '1', '--measurement', str(tmp_path / name)], capsys)
        again = run_json([str(tmp_path / name), *base, '--start-off', '0.3'], capsys)
        assert estimates(one) == estimates(again)


@pytest.fixture
def designed(monkeypatch):
    """Have designs made of a few curves only; return the list of groups and seeds that are asked for."""
    wanted, design = [], excitation.design

    def quick(group, parameters, seed, on_progress=None):
        wanted.append((group, seed))
        return design(group, parameters, seed=seed, tries=2, refinements=2, on_progress=on_progress)

    monkeypatch.setattr(excitation, 'design', quick)
    return wanted


def test_a_design_is_a_program_for_the_group_with_its_seed(tmp_path, robot, designed, capsys):
    path = tmp_path / 'own.yaml'
    for group, seed in (('geometry', '5'), ('masses', '6'), ('motor', '7')):
        assert estimate.main(['--group', group, '--design', str(path), '--seed', seed]) == 0
        assert f'# seed: {seed}' in path.read_text()
        assert programs.load(path, robot.motion).statements
    assert designed == [('geometry', 5), ('masses', 6), ('masses', 7)]
    capsys.readouterr()


def test_design_of_the_documentation_runs_unchanged_with_few_curves(tmp_path, designed, monkeypatch, capsys):
    page = pages.SOURCE / 'docs/tuning.md'
    (block,) = (
        block
        for block in pages.blocks(page)
        if block.mark == 'elsewhere' and (pages.SOURCE / block.words).samefile(__file__)
    )
    monkeypatch.chdir(tmp_path)
    for line in block.text.splitlines():
        program, *arguments = shlex.split(line, comments=True)
        assert program == 'delta3'
        assert main(arguments) == 0
    assert designed == [('masses', 0)]
    assert 'own.yaml: good, program' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['run.npz', '--seed', '1'], 'the inputs are traces: --seed would have no effect'),
        (['run.csv', '--sampling', 'bus', '--seed', '2'], 'the inputs are traces: --sampling, --seed would'),
        (['run.npz', '--measurement', 'own.npz'], 'the inputs are traces: --measurement would'),
        (['--group', 'thesis', '--method', 'replay'], 'fixed signals and quantities: --method would'),
        (['--group', 'thesis', '--free', 'K_m'], 'fixed signals and quantities: --free would'),
        (
            ['--group', 'geometry', '--sampling', 'bus'],
            'is sampled once per bus cycle: --sampling would',
        ),
        (['--design', 'own.yaml', '--start-off', '0.1'], '--design only writes a program: --start-off would'),
        (['experiment1', '--design', 'own.yaml'], '--design only writes a program: INPUT would'),
        (['--resume', 'folder', '--noise', '2'], 'the settings of the folder: --noise would'),
    ],
)
def test_option_without_effect_is_rejected(arguments, sentence, capsys):
    assert estimate.main(arguments) == 1
    assert sentence in capsys.readouterr().err
