"""Tests of the report page: numbers of the runs, small size, and no network access."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

import delta3_pacdrive as d3
from delta3_pacdrive.errors import ReportError
from delta3_pacdrive.recording.signals import CURRENT_SIGNALS, SIGNALS, TORQUE_SIGNALS, TRUE_SIGNALS
from delta3_pacdrive.studies.framework.figure_style import AXIS_COLOURS, NORM_COLOUR
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.report_page import page
from delta3_pacdrive.studies.report_page.packed_columns import resolution_of
from delta3_pacdrive.studies.report_page.plots import DERIVED, quantity
from delta3_pacdrive.studies.runs import runs
from delta3_pacdrive.studies.runs.run_comparison import compare, move_figures
from delta3_pacdrive.studies.runs.run_signals import energy_of_round
from page_data import document_of, signals_of

ORIGIN = Provenance('delta3 report <a> & "b"', None, 'abc (delta3.yaml)', ('experiment1 123',), 'numpy 2')
BASE_BYTES, BYTES_PER_S = 1_000_000, 100_000  # what a page may take
ROUNDING = 1.0 + 1e-6  # of half a step
NOTHING = '\N{EN DASH}'  # in a cell


@pytest.fixture(scope='module')
def one():
    return runs.load('packaging')


@pytest.fixture(scope='module')
def text(one):
    return page.page([one], ORIGIN)


@pytest.fixture(scope='module')
def other():
    return runs.load('packaging', 'rich')


@pytest.fixture(scope='module')
def both(one, other):
    return page.page([one, other], ORIGIN)


class Tags(HTMLParser):
    """Reads tags, their attributes and the texts of a page, and checks that opened tags are closed."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.texts, self.open = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag not in ('meta', 'link', 'input'):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1:] not in (['script'], ['style']):
            self.texts.append(data.strip())


def test_the_numbers_in_the_page_are_those_of_the_trace(one, text, robot):
    time_s, found = signals_of(document_of(text)['runs'][0])
    np.testing.assert_allclose(time_s, one.window.time_s, rtol=0.0, atol=1e-9)
    usual = {name for name in DERIVED if not name.startswith('jacobian_')}
    assert set(found) == {*SIGNALS, *TORQUE_SIGNALS, *CURRENT_SIGNALS, *TRUE_SIGNALS, *usual}
    for name in (*SIGNALS, *TORQUE_SIGNALS, *CURRENT_SIGNALS, *TRUE_SIGNALS):
        step = resolution_of(name, quantity(name)[0], robot.bus.increments_per_rev)
        assert np.abs(found[name] - one.window[name]).max() <= 0.5 * step * ROUNDING, name


def test_page_and_simulate_give_the_same_energy_of_a_round(one, text, both):
    found = energy_of_round(one.whole, one.robot, one.program.repeat)
    assert f'<p>Energy: {found.text(one.program.repeat)}.</p>' in text
    assert '>Energy' not in both.replace('<p>Energy of <b>', '')
    assert both.count('<p>Energy of <b>') == 2


def test_the_page_compares_currents_with_their_limits_and_warns_of_a_hot_motor(one, text):
    assert re.search(
        r'<p>Currents: peak ([\d.]+ / ){2}[\d.]+ A, (\d+ / ){2}\d+ % of the peak current \(17 A\); rms', text
    )
    assert '<b>Warning</b>' not in text
    hot = replace(one, robot=one.robot.replace(motor__nominal_current_a=0.1))
    assert page.page([hot], ORIGIN).count('<p><b>Warning</b>: motor ') == 3


def test_a_page_has_every_signal_of_a_trace_and_hides_those_on_request_at_first(tmp_path, robot):
    path = tmp_path / 'all.npz'
    d3.simulate('experiment1', signals=['*']).save(path)
    run = runs.load(str(path))
    document = document_of(page.page([run], ORIGIN))
    _, found = signals_of(document['runs'][0])
    # of these a page has norms and columns
    lacking = set(run.window.signals) - set(found)
    assert lacking == {'master', 'tcp_velocity', 'tcp_acceleration', 'jacobian'}
    np.testing.assert_allclose(
        found['jacobian_condition'], run.window['jacobian'][:, :1], rtol=0.0, atol=1e-6
    )
    for name, first in (('master', 'distance'), ('jacobian', 'condition')):
        for n, column in enumerate((first, 'speed', 'acceleration')):
            values = run.window[name][:, n : n + 1]  # rounded to a step of 1e-3 at most
            np.testing.assert_allclose(found[f'{name}_{column}'], values, rtol=0.0, atol=1e-3, err_msg=column)
    np.testing.assert_array_equal(found['status_word'], run.window['status_word'])
    assert np.abs(found['drive_voltage'] - run.window['drive_voltage']).max() <= 0.5e-3 * ROUNDING
    plots = {plot['signals'][0]['name']: plot for plot in document['plots']}
    assert (
        set(found) - {name for plot in document['plots'] for name in (s['name'] for s in plot['signals'])}
        == set()
    )
    outputs, voltage = plots['outputs'], plots['drive_voltage']
    assert outputs['columns'] == ['gripper', '1', '2', '3', '4', '5', '6', '7']
    assert (voltage['title'], voltage['unit'], voltage['shown']) == ('drive voltage', 'V', False)
    assert voltage['what'].startswith('voltage command of a phase')


def test_a_page_keeps_within_a_megabyte_and_a_tenth_of_one_for_each_second(one, text, both):
    length_s = one.window.time_s[-1] - one.window.time_s[0]
    assert len(text.encode()) <= BASE_BYTES + BYTES_PER_S * length_s
    assert len(both.encode()) <= BASE_BYTES + BYTES_PER_S * 2.0 * length_s


def test_page_is_complete_without_external_references(text, both):
    for whole in (text, both):
        tags = Tags(whole)
        assert tags.open == []
        links = [value for _, given in tags.tags for name, value in given.items() if name in ('src', 'href')]
        assert links == ['data:,']
        assert "default-src 'none'" in whole


@pytest.mark.parametrize('name', ['</script><b>{{script}}', '<!-- <script>'])
def test_a_name_cannot_break_the_page(name, one):
    found = page.page([replace(one, title=name)], ORIGIN)
    assert document_of(found)['runs'][0]['title'] == name
    assert '<' not in re.search(r'id="report">(.*?)</script>', found, re.DOTALL)[1]
    tags = Tags(found)
    assert [tag for tag, _ in tags.tags].count('script') == 2
    assert tags.texts.count(name) >= 1


def test_moves_and_marks_of_the_page_are_those_of_the_run(one, text):
    (run,) = document_of(text)['runs']
    assert run['moves'] == [[m.number, m.kind, m.start_s, m.end_s] for m in one.moves]
    assert [[m.time_s, m.kind, m.text] for m in one.marks] == run['marks']
    assert run['payloads'][:2] == [[0.0, 0.5], [pytest.approx(one.moves[2].start_s), 0.0]]


def test_table_of_moves_has_the_figures_of_each(one, text):
    rows = re.findall(r'<tr data-from="([\d.]+)".*?>(.*?)</tr>', text)
    assert len(rows) == len(one.moves)
    cells = [re.findall(r'<td.*?>(.*?)</td>', row) for _, row in rows]
    for (begin, _), own, move in zip(rows, cells, one.moves, strict=True):
        figures = move_figures(one, move)
        assert float(begin) == pytest.approx(move.start_s, abs=1e-6)
        assert own[:2] == [str(move.number), move.kind]
        assert float(own[4]) == pytest.approx(figures.duration_s, abs=1e-3)
        assert float(own[6]) == pytest.approx(figures.current_peak_a, abs=1e-2)
        assert float(own[8]) == pytest.approx(1e3 * figures.tcp_error_max_m, abs=1e-3)


def test_page_shows_states_of_drives_and_a_dash_for_unknown_limits(one):
    unknown = replace(one, moves=tuple(replace(move, limited_by='') for move in one.moves))
    texts = Tags(page.page([unknown], ORIGIN)).texts
    assert {'limited by', 'Drives', 'enabled', 'free', 'axis 3'} <= set(texts)
    assert texts.count(NOTHING) >= len(one.moves)
    assert 'Drives' not in Tags(page.page([replace(one, drives=())], ORIGIN)).texts


def test_page_shows_its_origin_and_unusual_parameters(text, both):
    texts = Tags(text).texts
    assert all(line in texts for line in ORIGIN.lines().values() if line != 'none')
    assert {'motion.home_m', '-0.1525, 0, -0.85', '0, 0, -0.75'} <= set(texts)
    assert 'rich.enabled' not in texts
    assert {'rich.enabled', 'Parameters that differ'} <= set(Tags(both).texts)


def test_a_page_of_two_runs_holds_their_difference(one, other, both):
    document = document_of(both)
    found = compare(one, other)
    (difference,) = document['differences']
    time_s, signals = signals_of(difference)
    np.testing.assert_allclose(time_s, found.time_s, rtol=0.0, atol=1e-9)
    for name, values in found.differences.items():
        step = difference['signals'][name]['resolution']
        assert np.abs(signals[name] - values).max() <= 0.5 * step * ROUNDING, name
    assert [run['name'] for run in document['runs']] == ['packaging', 'packaging (rich)']


def test_run_aligned_by_its_motion_has_the_time_of_the_first(one):
    from dataclasses import replace

    later = replace(one, window=replace(one.window, time_s=one.window.time_s + 0.25))
    first, second = document_of(page.page([one, later], ORIGIN, 'correlation'))['runs']
    assert second['first_s'] == pytest.approx(first['first_s'])
    assert second['moves'][1][2] == pytest.approx(first['moves'][1][2] - 0.25)  # its own moves are not later


def test_axes_have_the_colours_of_the_figures(text):
    style = text.partition('<style>')[2].partition('@media')[0]
    found = dict(re.findall(r'--(axis[123]|norm): (#[0-9a-f]{6})', style))
    assert [found[f'axis{n}'].upper() for n in (1, 2, 3)] == [colour.upper() for colour in AXIS_COLOURS]
    assert found['norm'].upper() == NORM_COLOUR.upper()


def test_every_signal_has_a_plot(text):
    document = document_of(text)
    shown = {signal['name'] for plot in document['plots'] for signal in plot['signals']}
    assert shown == set(document['runs'][0]['signals'])


def test_noise_that_would_make_the_page_too_large_is_rounded_more(one):
    from dataclasses import replace

    part = replace(one.window, signals=dict(one.window.signals))
    noise = np.random.default_rng(4)
    for name in part.signals:
        part.signals[name] = part.signals[name] + noise.normal(size=part.signals[name].shape)
    found = page.page([replace(one, window=part)], ORIGIN)
    length_s = part.time_s[-1] - part.time_s[0]
    assert len(found.encode()) <= BASE_BYTES + BYTES_PER_S * length_s
    _, signals = signals_of(document_of(found)['runs'][0])
    assert np.abs(signals['current'] - part['current']).max() < 0.1


def test_too_many_or_too_long_runs_are_rejected_with_one_message(one):
    from dataclasses import replace

    with pytest.raises(ReportError, match=r'^a report takes at most 4 runs, not 5$'):
        page.page([one] * 5, ORIGIN)
    long = replace(one, window=replace(one.window, time_s=one.window.time_s * 100.0))
    with pytest.raises(
        ReportError, match=r'^the runs last 412 s, the limit of a page is 300 s: shorten them'
    ):
        page.page([long], ORIGIN)


def test_failed_write_of_a_page_leaves_no_file_and_keeps_an_old_one(one, tmp_path):
    (tmp_path / 'folder').mkdir()
    with pytest.raises(ReportError, match=r'^cannot write .*folder: '):
        page.write(tmp_path / 'folder', [one], ORIGIN)
    with pytest.raises(ReportError, match=r'^cannot write .*: it is a folder$'):
        page.require_writable_page(tmp_path / 'folder')
    with pytest.raises(ReportError, match=r'^cannot write .*: there is no folder .*missing$'):
        page.require_writable_page(tmp_path / 'missing' / 'a.html')
    assert [path.name for path in tmp_path.iterdir()] == ['folder']
