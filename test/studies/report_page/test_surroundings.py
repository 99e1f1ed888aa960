"""Tests of the cell on a report page, and of its table of parts, against the run."""

import re
from dataclasses import replace

import numpy as np
import pytest

from cell_truth import packaging, picks_from_a_belt
from delta3_pacdrive.errors import ReportError
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.report_page import page
from delta3_pacdrive.studies.report_page.surroundings import PARTS_DRAWN, STAYS_DRAWN, STEP
from delta3_pacdrive.studies.report_page.tables import PARTS_SHOWN
from delta3_pacdrive.studies.runs import runs
from page_data import cell_of, document_of, parts_at

ORIGIN = Provenance.of('test')
BASE_BYTES, BYTES_PER_S = 1_000_000, 100_000  # what a page may take
NOTHING = '&ndash;'
ROUNDED_M = 3.0 * STEP  # of a place and two ways
STAY = {'cycle': 0, 'how': 'lying', 'at_m': [0.0, 0.0, -0.9], 'angle_rad': 0.0, 'belt': '', 'count': 0}


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('runs')


def loaded(made, path, **window):
    """Save the trace of a simulation, and load it as a run."""
    trace, truth = made
    trace.save(path)
    return runs.load(str(path), **window), truth


@pytest.fixture(scope='module')
def packaged(folder):
    return loaded(packaging(), folder / 'packaged.npz')


@pytest.fixture(scope='module')
def belted(folder):
    return loaded(picks_from_a_belt(direction_deg=10), folder / 'belted.npz')


def rows_of(text):
    """Return the cells of each row of the tables of parts."""
    tables = re.findall(r'id="parts\d+">(.*?)</section>', text, re.DOTALL)
    lines = [line for table in tables for line in re.findall(r'<tr.*?>(.*?)</tr>', table)[1:]]
    return [re.findall(r'<td.*?>(.*?)</td>', line) for line in lines]


def with_parts(run, count, stays=None, **more):
    """Return a run with as many parts; those of a packaging cycle are the patterns."""
    patterns = run.cell.parts
    parts = [
        patterns[n % len(patterns)] | {'number': n} | ({} if stays is None else {'stays': stays}) | more
        for n in range(count)
    ]
    return replace(run, cell=replace(run.cell, parts=tuple(parts), outcomes={'placed': count}))


@pytest.mark.parametrize('name', ['packaged', 'belted'])
def test_parts_of_the_page_are_where_the_simulation_has_them(name, request):
    run, truth = request.getfixturevalue(name)
    document = document_of(page.page([run], ORIGIN))
    cell = cell_of(document)
    first = round(document['runs'][0]['first_s'] / 1e-3) + run.window.meta['start_cycle']
    compared = set()
    for cycle in range(0, len(run.window.time_s), 5):
        tcp, at = truth.cycles[first + cycle]
        there = {part['number'] for part, _, _ in run.cell.at(first + cycle, tcp)}
        drawn = parts_at(cell, cycle, tcp)
        assert drawn.keys() == there
        for number, place in drawn.items():
            assert np.linalg.norm(place - at[number][0]) < ROUNDED_M
        compared |= there
    assert compared == {number for number, _, _ in cell['parts']}
    assert len(compared) >= 3


def test_things_types_and_outcomes_of_the_page_are_those_of_the_run(belted):
    run, _ = belted
    cell = cell_of(document_of(page.page([run], ORIGIN)))
    for drawn, thing in zip(cell['things'], run.cell.things, strict=True):
        assert drawn[0] == thing.kind
        np.testing.assert_allclose(drawn[1:], [*thing.at_m, thing.angle_rad, *thing.size_m], atol=1e-6)
    assert cell['sizes'] == [[0.06, 0.04, 0.02]]
    assert [part[1:] for part in cell['parts']] == [[0, 'placed'], [0, 'placed'], [0, 'passed']]


def test_page_of_a_section_of_a_run_contains_the_state_of_that_time(belted):
    run, _ = belted
    short = runs.load(run.name, from_s=0.9, to_s=1.1)
    cell = cell_of(document_of(page.page([short], ORIGIN)))
    assert [number for number, _, _ in cell['parts']] == [
        1
    ]  # the first one is placed, the third one not there yet
    assert cell['stays'][0, 1] == -1  # it came before
    assert [row[0] for row in rows_of(page.page([short], ORIGIN))] == ['1']
    assert '2 more parts are not listed.' in page.page([short], ORIGIN)


def test_only_the_newest_parts_and_stays_are_drawn_and_listed_and_the_page_stays_small(packaged):
    run, _ = packaged
    short = runs.load(run.name, to_s=0.1)
    first = round(short.window.time_s[0] / 1e-3) + short.window.meta['start_cycle']
    noise = np.random.default_rng(1)
    stays = [
        STAY | {'cycle': int(c), 'at_m': noise.normal(size=3).tolist()} for c in first + np.arange(1, 21)
    ]
    many = with_parts(short, PARTS_DRAWN + 200, stays, reason='x' * 10_000)
    text = page.page([many], ORIGIN)
    cell = cell_of(document_of(text))
    assert cell['parts'][-1][0] == PARTS_DRAWN + 199
    assert (len(cell['parts']), cell['rows']) == (PARTS_DRAWN, STAYS_DRAWN)
    assert cell['stays'][-1, 0] == PARTS_DRAWN - 1
    rows = rows_of(text)
    assert [rows[0][0], rows[-1][0]] == [str(PARTS_DRAWN + 200 - PARTS_SHOWN), str(PARTS_DRAWN + 199)]
    assert f'{PARTS_DRAWN + 200 - PARTS_SHOWN} more parts are not listed.' in text
    length_s = short.window.time_s[-1] - short.window.time_s[0]
    assert len(text.encode()) <= BASE_BYTES + BYTES_PER_S * length_s


def test_unreachable_place_is_not_drawn_and_does_not_reduce_the_digits_of_others(packaged):
    run, _ = packaged
    own = run.cell.parts[0]
    far = own | {'number': 99, 'stays': [STAY | {'at_m': [1e15, 0.0, 0.0]}]}
    cell = cell_of(document_of(page.page([replace(run, cell=replace(run.cell, parts=(own, far)))], ORIGIN)))
    assert np.isnan(cell['places'][-1, 0])
    np.testing.assert_allclose(cell['places'][0, :3], own['stays'][0]['at_m'], atol=STEP)


def test_table_gives_the_outcome_of_each_part(packaged):
    run, _ = packaged
    text = page.page([run], ORIGIN)
    rows = rows_of(text)
    assert len(rows) == len(run.cell.parts)
    start = run.window.meta['start_cycle']
    for row, part in zip(rows, run.cell.parts, strict=True):
        assert row[:4] == [str(part['number']), part['type'], part['source'], part['outcome']]
        if part['picked_cycle'] < 0:
            assert row[4:] == [NOTHING] * 7
            continue
        assert float(row[4]) == pytest.approx(1e-3 * (part['picked_cycle'] - start), abs=1e-9)
        assert float(row[5]) == pytest.approx(1e-3 * (part['released_cycle'] - start), abs=1e-9)
        assert float(row[6]) == pytest.approx(1e3 * np.hypot(*part['pick_error_m'][:2]), abs=5.1e-3)
        assert row[7] == f'{part["where"]} {part["place"]}'
        assert float(row[8]) == pytest.approx(1e3 * np.hypot(*part['place_error_m'][:2]), abs=5.1e-3)
        assert float(row[9]) == pytest.approx(100.0 * part['hold_use'], abs=0.51)
    assert '10 placed' in text
    assert 'not listed' not in text


def test_lost_part_reports_the_reason_and_names_of_other_publishers_are_ignored(packaged):
    run, _ = packaged
    told = {'outcome': 'lost', 'reason': 'it <b>fell</b>', 'where': '', 'place': -1, 'type': '</table>'}
    text = page.page([with_parts(run, 1, **told)], ORIGIN)
    (row,) = rows_of(text)
    assert (row[1], row[3]) == ('&lt;/table&gt;', 'lost')
    assert row[7:9] == [NOTHING, NOTHING]
    assert row[10] == 'it &lt;b&gt;fell&lt;/b&gt;'


def test_of_two_runs_the_cell_of_the_first_is_drawn_and_the_parts_of_both_are_listed(packaged, belted):
    (one, _), (other, _) = packaged, belted
    text = page.page([one, other], ORIGIN, 'none')
    assert document_of(text)['cell'] == document_of(page.page([one], ORIGIN))['cell']
    assert len(rows_of(text)) == len(one.cell.parts) + len(other.cell.parts)
    assert ['data-run="1"' in line for line in re.findall(r'<tr .*?>', text)].count(True) >= 2


def test_a_run_without_a_cell_has_neither_cell_nor_table(packaged):
    run, _ = packaged
    text = page.page([replace(run, cell=None)], ORIGIN)
    assert 'cell' not in document_of(text)
    assert 'id="parts' not in text
    nothing = replace(run.cell, things=(), parts=(), outcomes={})
    assert 'cell' not in document_of(page.page([replace(run, cell=nothing)], ORIGIN))


def test_recording_of_an_older_version_lists_its_parts_without_drawing_them(packaged):
    run, _ = packaged
    old = with_parts(replace(run, cell=replace(run.cell, things=())), 3, [])
    text = page.page([old], ORIGIN)
    assert 'cell' not in document_of(text)
    assert len(rows_of(text)) == 3


@pytest.mark.parametrize(
    ('absent', 'told'),
    [
        (('tcp_actual', 'tcp_command'), r'no TCP position \(tcp_actual or tcp_command\)$'),
        (
            ('motor_position', 'motor_command'),
            r'no motor angles \(motor_position or motor_command\)$',
        ),
    ],
)
def test_run_without_a_pose_is_rejected_with_one_message(absent, told, packaged):
    run, _ = packaged
    signals = {name: values for name, values in run.window.signals.items() if name not in absent}
    part = Trace(run.window.time_s, signals, run.window.meta)
    with pytest.raises(ReportError, match=rf'^.*packaged.npz cannot be shown: it has {told}'):
        page.page([replace(run, window=part)], ORIGIN)
