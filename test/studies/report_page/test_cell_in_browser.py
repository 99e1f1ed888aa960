"""Tests of the cell of a report in a real browser: positions of parts and belts over time."""

from dataclasses import replace

import numpy as np
import pytest

from browser import Visit
from cell_truth import picks_from_a_belt
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.report_page import page
from delta3_pacdrive.studies.runs import runs
from report_views import READY, middle_of, pixels, place_of, seek

INSTANTS_S = (0.9, 1.1, 1.25, 1.45, 2.2)  # riding, in hand, in the box
BELT_M_S, MARKS_M = 0.5, 0.1
ROUNDED_M = 5e-6
PIXELS = 2.0  # between what is drawn and where it has to be
HALF_HEIGHT_M = 0.01
PLACES = 'delta3.stage.cell.places(delta3.clock.time, delta3.stage.robot.tcp)'
ONLY_THE_CELL = """
    delta3.stage.robot.group.visible = false;
    delta3.stage.ghosts.forEach(ghost => { ghost.shown = false });
    delta3.stage.dots[0].material.visible = false;
    delta3.stage.paths.forEach(path => { path.line.material.visible = false });
    delta3.stage.look('top')
"""
ONLY_PARTS = ONLY_THE_CELL + (
    '; delta3.stage.cell.group.children.forEach(one => { one.visible = one === delta3.stage.cell.boxes })'
)
NO_PARTS = ONLY_THE_CELL + '; delta3.stage.cell.boxes.visible = false'


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    path = tmp_path_factory.mktemp('runs') / 'belted.npz'
    picks_from_a_belt()[0].save(path)
    return runs.load(str(path), to_s=2.5)


@pytest.fixture(scope='module')
def address(run, tmp_path_factory):
    path = tmp_path_factory.mktemp('pages') / 'belted.html'
    page.write(path, [run], Provenance.of('test'))
    return path.as_uri()


@pytest.fixture(scope='module')
def opened(browser, address):
    """Return a visit of the page with all elements visible in 3-D."""
    with Visit(browser, address) as found:
        found.page.wait_for_selector(READY, state='attached')
        yield found


@pytest.fixture
def visit(browser, address):
    """Return a visit whose 3-D may be changed."""
    with Visit(browser, address) as found:
        found.page.wait_for_selector(READY, state='attached')
        yield found


def there(run, time_s):
    """Return the places [m] of the parts of a run at a time, those in hand at the actual TCP, by their numbers."""
    row = round((time_s - run.window.time_s[0]) / run.period_s)
    cycle = round(time_s / run.period_s) + run.window.meta['start_cycle']
    tcp = tuple(run.window['tcp_actual'][row])
    return {part['number']: np.array(place) for part, place, _ in run.cell.at(cycle, tcp)}


def stage_of(visit):
    """Return the pixels of the stage."""
    return pixels(visit)[:, : int(visit.page.locator('canvas').first.bounding_box()['width'])]


def test_parts_are_where_belt_and_tcp_have_them_at_any_time(opened, run):
    seen = set()
    for time_s in INSTANTS_S:
        seek(opened, time_s)
        drawn = {one['number']: one['at'] for one in opened.page.evaluate(PLACES)}
        expected = there(run, time_s)
        assert drawn.keys() == expected.keys(), time_s
        for number, place in drawn.items():
            assert np.linalg.norm(place - expected[number]) < ROUNDED_M, (time_s, number)
        seen |= drawn.keys()
    assert seen == {1, 2}
    assert opened.complaints == []


def test_between_two_bus_cycles_a_part_is_between_its_places(opened, run):
    seek(opened, 0.9005)
    (drawn,) = opened.page.evaluate(PLACES)
    before, after = there(run, 0.9)[1], there(run, 0.901)[1]
    np.testing.assert_allclose(drawn['at'], 0.5 * (before + after), atol=ROUNDED_M)


@pytest.mark.long
def test_part_is_drawn_at_its_position(visit, run):
    visit.page.evaluate(ONLY_PARTS)
    background = None
    for time_s in INSTANTS_S[:4]:
        seek(visit, time_s)
        place = there(run, time_s)[1] + [0.0, 0.0, HALF_HEIGHT_M]
        expected = place_of(visit, place)
        x, y = np.rint(expected).astype(int)
        around = pixels(visit)[y - 25 : y + 25, x - 25 : x + 25]
        background = around[0, 0] if background is None else background
        drawn = np.array([x - 25, y - 25]) + middle_of(np.abs(around - background).max(axis=2) > 20.0)
        assert np.linalg.norm(drawn - expected) < PIXELS, time_s


@pytest.mark.long
def test_marks_move_with_the_belt(visit):
    visit.page.evaluate(NO_PARTS)
    pictures = []
    for time_s in (0.9, 0.9 + MARKS_M / BELT_M_S, 0.9 + 0.5 * MARKS_M / BELT_M_S):
        seek(visit, time_s)
        pictures.append(stage_of(visit)[:700, 20:-20])
    differ = [np.abs(picture - pictures[0]).max(axis=2) > 20.0 for picture in pictures[1:]]
    visit.page.get_by_label('cell').uncheck()
    seek(visit, 0.9)
    belt = np.abs(stage_of(visit)[:700, 20:-20] - pictures[0]).max(axis=2) > 20.0
    assert belt.mean() > 0.02  # the belt is seen, and can be hidden
    assert differ[0].sum() < 0.1 * differ[1].sum()
    assert differ[1].sum() > 0.02 * belt.sum()


@pytest.mark.long
def test_gripped_part_replaces_the_payload(opened, run, browser, tmp_path):
    page.write(tmp_path / 'bare.html', [replace(run, cell=None)], Provenance.of('test'))
    with Visit(browser, (tmp_path / 'bare.html').as_uri()) as bare:
        bare.page.wait_for_selector(READY, state='attached')
        seen = []
        for each in (opened, bare):
            seek(each, 1.45)
            seen.append(each.page.evaluate('delta3.stage.robot.part("payload").visible'))
        assert seen == [False, True]
        assert bare.page.get_by_label('cell').count() == 0


def test_row_of_the_table_of_parts_selects_its_pick(opened, run):
    row = opened.page.locator('#parts0 tr[data-from]').nth(1)
    assert row.locator('td').first.text_content() == '1'
    row.click()
    picked = (run.cell.parts[1]['picked_cycle'] - run.window.meta['start_cycle']) * run.period_s
    assert opened.page.evaluate('delta3.clock.time') == pytest.approx(picked, abs=1e-6)
    assert 'driven' in row.get_attribute('class')
    seek(opened, 0.9)
    assert 'driven' not in row.get_attribute('class')


@pytest.mark.long
def test_a_part_that_was_lost_has_the_colour_of_faults_in_both_themes(browser, run, tmp_path):
    parts = [run.cell.parts[0], run.cell.parts[1] | {'outcome': 'lost'}]
    page.write(
        tmp_path / 'lost.html',
        [replace(run, cell=replace(run.cell, parts=tuple(parts)))],
        Provenance.of('test'),
    )
    with Visit(browser, (tmp_path / 'lost.html').as_uri()) as visit:
        visit.page.wait_for_selector(READY, state='attached')
        told = []
        for _ in range(2):
            seek(visit, 0.9)
            told.append(
                visit.page.evaluate(
                    '(() => { const { cell } = delta3.stage; const style = getComputedStyle('
                    'document.documentElement); const own = cell.colours[0].clone();'
                    'cell.boxes.getColorAt(0, own); return ["#" + own.getHexString(),'
                    ' style.getPropertyValue("--fault").trim(), style.getPropertyValue("--part1").trim()] })()'
                )
            )
            visit.page.locator('#theme').click()
        assert all(drawn == fault != usual for drawn, fault, usual in told)
        assert told[0][1] != told[1][1]
