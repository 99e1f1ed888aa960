"""Tests of ``delta3 report`` and ``delta3 compare``: files, output and rejections."""

import json
import re

import numpy as np
import pytest

from bags import messages, record
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.trace import Trace
from page_data import document_of


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def trace(here):
    assert main(['simulate', 'experiment1', '--trace', 'a.npz', '--json']) == 0
    return here / 'a.npz'


def test_report_writes_one_file_and_names_it(here, trace, capsys):
    capsys.readouterr()
    assert main(['report', 'a.npz', 'experiment1', '--parameters', ',rich', '--output', 'page.html']) == 0
    assert capsys.readouterr().out == 'page.html\n'
    assert {path.name for path in here.iterdir()} == {'a.npz', 'page.html'}
    text = (here / 'page.html').read_text(encoding='utf-8')
    assert [run['kind'] for run in document_of(text)['runs']] == ['trace', 'program']
    assert 'delta3 report a.npz experiment1 --parameters ,rich --output page.html' in text


def test_folder_with_bags_of_several_robots_expands_to_all(here, capsys):
    (here / 'hall').mkdir()
    for name in ('robot2', 'robot1'):  # the order of a page is that of their names
        record(here / 'hall' / name, messages())
    (here / 'hall' / 'notes').mkdir()
    (here / 'hall' / 'list.txt').write_text('robot3')
    assert main(['report', 'hall', '--output', 'page.html']) == 0
    runs = document_of((here / 'page.html').read_text(encoding='utf-8'))['runs']
    assert [run['name'] for run in runs] == ['robot1', 'robot2']
    with pytest.raises(SystemExit):
        main(['report', 'hall', '--parameters', 'delta3,rich,', '--output', 'other.html'])
    assert '--parameters names 3 files, but there are 2 runs' in capsys.readouterr().err
    assert main(['report', str(here / 'hall' / 'notes'), '--output', 'other.html']) == 1
    assert 'it is not a bag' in capsys.readouterr().err


def test_report_shows_the_requested_section(here, trace, capsys):
    capsys.readouterr()
    assert main(['report', 'a.npz', '--from', '0.2', '--to', '0.4', '--json']) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['files'] == ['report.html']
    assert result['bytes'] == (here / 'report.html').stat().st_size
    (run,) = document_of((here / 'report.html').read_text(encoding='utf-8'))['runs']
    assert (run['first_s'], run['cycles']) == (pytest.approx(0.2), 201)


def test_compare_prints_the_figures_of_the_difference(trace, capsys):
    capsys.readouterr()
    assert main(['compare', 'a.npz', 'experiment1', '--parameters', 'rich', '--json']) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['runs'] == ['a.npz', 'experiment1 (rich)']
    assert result['alignment']['by'] == 'program start'
    assert not result['same']
    assert result['parameters']['rich.enabled'] == [False, True]
    assert main(['compare', 'a.npz', 'experiment1', '--parameters', 'rich']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == 'experiment1 (rich) minus a.npz'
    (current,) = [line.split() for line in lines if line.startswith('current ')]
    assert float(current[1]) == pytest.approx(result['signals']['current']['rms'], rel=1e-3)
    assert '  rich.enabled: False and True' in lines


def test_runs_are_aligned_by_the_requested_method_and_report_it(here, trace, capsys):
    whole = Trace.load(trace)
    whole.meta['start_cycle'] += 50  # whoever recorded it has noted it too late
    whole.save(here / 'late.npz')

    def found(*how):
        options = ['a.npz', 'late.npz', '--from', '0', '--to', '0.5', *how]
        capsys.readouterr()
        assert main(['compare', *options, '--json']) == 0
        result = json.loads(capsys.readouterr().out)
        assert main(['report', *options]) == 0
        text = (here / 'report.html').read_text(encoding='utf-8')
        (told,) = re.findall(r'late.npz</b> minus <b>a.npz</b>, (.*); motor commands correlate', text)
        cycles = result['cycles'], result['model_and_robot']['cycles']
        shifts = result['alignment']['shift_s'], document_of(text)['runs'][1]['shift_s']
        return result['alignment']['by'], told, cycles, shifts

    by_start = found('--align', 'start')
    assert found() == by_start
    assert by_start == ('program start', 'aligned by program start', (501, 501), (0.0, 0.0))
    shift_s = pytest.approx(0.05, abs=1e-9)
    for name in ('correlation', 'best'):
        by, told, cycles, shifts = found('--align', name)
        assert (by, cycles, shifts) == ('best correlation', (451, 451), (shift_s, shift_s))
        assert told == 'shifted by +0.050 s for the best correlation'
    by, told, _, shifts = found('--align', 'none')
    assert (by, shifts) == ('their own times', (0.0, 0.0))
    assert told == 'aligned by their own times'


def test_compare_reports_that_a_trace_matches_its_program(trace, capsys):
    capsys.readouterr()
    assert main(['compare', 'a.npz', 'experiment1']) == 0
    told = capsys.readouterr().out
    assert 'all signals are bit-identical' in told
    assert 'parameters: identical' in told


@pytest.mark.parametrize(
    'arguments',
    [['report', 'a.npz'], ['compare', 'a.npz', 'a.npz'], ['view', 'a.npz']],
    ids=lambda words: words[0],
)
def test_parameters_for_a_recording_with_its_own_are_rejected(arguments, trace, here, capsys):
    capsys.readouterr()
    assert main([*arguments, '--parameters', 'rich']) == 1
    sentence = 'error: --parameters is rich, but a.npz contains the parameters of its robot\n'
    assert capsys.readouterr().err == sentence
    assert [path.name for path in here.iterdir()] == ['a.npz']


def test_gap_in_one_of_two_runs_is_reported(here, trace, capsys):
    whole = Trace.load(trace)
    Trace(whole.time_s[:-5], {name: v[:-5] for name, v in whole.signals.items()}, whole.meta).save(
        here / 'b.npz'
    )
    capsys.readouterr()
    assert main(['compare', 'a.npz', 'b.npz', '--to', '99']) == 0
    told = capsys.readouterr().out
    assert 'all signals are bit-identical in the common cycles' in told
    assert '5 cycles were not compared: they are in one run only' in told


def test_plot_names_the_program_starts_of_a_trace_without_an_own_start(here, capsys):
    time_s = np.arange(50) * 1e-3
    meta = {'cycle_time_s': 1e-3, 'starts': [10, 30], 'gear_ratio': 32.0}
    Trace(time_s, {'current': np.zeros((50, 3))}, meta).save(here / 'c.npz')
    assert main(['plot', 'c.npz', '--signals', 'current']) == 0
    assert 'note: programs started at 0.01, 0.03 s' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['report', 'missing.npz'], 'there is no recording missing.npz'),
        (['report', 'missing'], 'missing'),
        (['report', 'torn.npz'], 'torn.npz is not a trace file'),
        (['report', 'notes.md'], 'notes.md:3:1: the program: unknown key'),
        (['report', 'bag'], 'bag: it was cut off or is damaged (it contains no messages)'),
        (['report', 'empty'], 'empty: it is not a bag: metadata.yaml is missing'),
        (['report', 'bare.npz'], 'the recording contains no valid cycle_time_s'),
        (
            ['report', 'experiment1', '--output', 'no/page.html'],
            'cannot write no/page.html: there is no folder no',
        ),
        (['report', 'experiment1', '--output', 'empty'], 'cannot write empty: it is a folder'),
        (
            ['report', 'bare.npz', '--output', 'bare.npz'],
            'cannot write bare.npz: the name of a page must end',
        ),
        (['report', 'experiment1', '--parameters', 'none.yaml'], 'none.yaml'),
        (['report', 'experiment1', '--from', '77'], 'the recording contains no cycle of that window'),
        (['compare', 'experiment1', 'missing.npz'], 'there is no recording missing.npz'),
    ],
)
def test_invalid_input_of_a_report_gives_one_message_and_leaves_no_file(here, arguments, sentence, capsys):
    (here / 'torn.npz').write_bytes(b'PK\x03\x04 torn')
    (here / 'notes.md').write_text('# A page\n\nNo program: at all\n', encoding='utf-8')
    (here / 'empty').mkdir()
    record(here / 'bag', [], types={})
    time_s = np.arange(5) * 1e-3
    Trace(time_s, {'current': np.zeros((5, 3))}, {}).save(here / 'bare.npz')
    before = sorted(here.rglob('*'))
    assert main(arguments) == 1
    out, error = capsys.readouterr()
    assert out == ''
    (line,) = error.splitlines()
    assert line.startswith('error: ')
    assert sentence in line
    assert sorted(here.rglob('*')) == before


@pytest.mark.parametrize('name', ['huge.npz', 'huge.csv'])
@pytest.mark.parametrize('command', ['report', 'compare'])
@pytest.mark.filterwarnings('error')
def test_numbers_outside_the_computable_range_are_rejected(command, name, here, trace, capsys):
    run = Trace.load(trace)
    signals = {key: values.copy() for key, values in run.signals.items()}
    signals['current'][500:600] = -1e300
    trace_file.save(Trace(run.time_s, signals, run.meta), here / name)
    capsys.readouterr()
    assert main([command, 'a.npz', name]) == 1
    sentence = f'error: {name}: its current reaches 1e+300, the limit of signals is 1e+12\n'
    assert capsys.readouterr().err == sentence
    assert not (here / 'report.html').exists()


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['compare', 'a.npz'], 'compare takes two runs, not 1'),
        (['report', 'a', '--from', '2', '--to', '1'], '--from is 2, but must be less than --to, 1'),
        (['report', 'a', 'b', '--parameters', ',,'], '--parameters names 3 files, but there are 2 runs'),
        (['report', 'a', '--parameters', 'b,c'], '--parameters names 2 files, but there is 1 run'),
        (['report', *'abcde'], 'a report takes at most 4 runs, not 5'),
    ],
)
def test_options_that_do_not_fit_are_a_usage_error(arguments, sentence, capsys):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert sentence in capsys.readouterr().err
