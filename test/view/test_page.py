"""Tests of the page, in a real browser, fed with plain values."""

import json
import time
from contextlib import contextmanager
from dataclasses import replace
from io import BytesIO

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy import ndimage

from browser import Visit
from delta3_pacdrive import kinematics
from delta3_pacdrive.cell.cell_scene import Kind, Thing
from delta3_pacdrive.view import readout
from delta3_pacdrive.view.jog import HEARTBEAT_HZ, SILENT_S
from delta3_pacdrive.view.values import CellInstant, DriveFacts, Facts, InputFacts, Instant, PartPlace

pytest.importorskip('viser', reason='the page needs the extra "view"')

from delta3_pacdrive.view.page import Page  # it needs no viser before it is made
from delta3_pacdrive.view.serving import HOST, held

WAIT_S = 180.0  # a browser without a graphics card, on a machine that has other things to do
WIDTH, HEIGHT = 1280, 800
MARK_M = 0.02
PLACES = ((0.0, 0.0, -0.75), (0.25, 0.1, -0.85), (-0.3, 0.05, -0.8), (0.1, -0.35, -0.9), (-0.15, 0.3, -0.72))


def instant_at(place, robot, time_s=1.0, lag=(0.0, 0.0, 0.0)):
    return Instant(time_s, kinematics.inverse(np.array(place), robot), np.array(lag))


def wait_for(condition, what, seconds=WAIT_S):
    deadline = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < deadline, f'not within {seconds:g} s: {what}'
        time.sleep(0.02)
    return found


@pytest.fixture(scope='module')
def page(robot):
    """Return a page with controls."""
    with held(HOST, None) as place:
        made = Page(robot, place, 'a robot of the tests')
    made.add_controls()
    try:
        yield made
    finally:
        made.close()


@pytest.fixture(scope='module')
def visit(page, browser):
    """Return a visit of the page in a browser."""
    with Visit(browser, page.url, WIDTH, HEIGHT) as made:
        wait_for(lambda: page.watched, 'the browser connects')
        yield made


def seen_at(page, visit, point_m):
    """Return the position of a point in the picture of a browser with an unchanged view [pixels].

    What a busy browser tells of its camera may be late.
    """
    camera, scene = page.server.initial_camera, visit.page.locator('canvas').first.bounding_box()
    forward = np.subtract(camera.look_at, camera.position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    down = np.cross(forward, right)
    x, y, depth = (
        np.dot(np.subtract(point_m, camera.position), axis) / np.linalg.norm(axis)
        for axis in (right, down, forward)
    )
    focal = 0.5 * scene['height'] / np.tan(0.5 * camera.fov)
    return np.array([0.5 * scene['width'], 0.5 * scene['height']]) + focal * np.array([x, y]) / depth


def mark_in(picture):
    """Return the middle of the largest magenta spot in a picture [pixels], None if there is none."""
    red, green, blue = (picture[..., n].astype(float) for n in range(3))
    spots, count = ndimage.label((red > 1.4 * green) & (blue > 1.4 * green) & (red > 90.0))
    sizes = np.bincount(spots.ravel())[1:]
    if not count or sizes.max() < 20:
        return None
    return np.flip(ndimage.center_of_mass(spots == 1 + sizes.argmax())) + 0.5


def test_picture_is_sent_immediately_and_complete(page, visit, robot, monkeypatch):
    order = []
    whole = page.server.atomic

    @contextmanager
    def atomic():
        with whole():
            yield
        order.append('whole')

    monkeypatch.setattr(page.server, 'atomic', atomic)
    monkeypatch.setattr(page.server, 'flush', lambda: order.append('sent'))
    page.show(instant_at(PLACES[0], robot))
    assert order[-2:] == ['whole', 'sent']


def test_plate_is_at_the_forward_kinematics(page, visit, robot):
    below = np.array([0.0, 0.0, -0.06])  # the plate, where nothing is in front of it
    mark = page.server.scene.add_icosphere(
        '/robot/plate/mark', MARK_M, color=(255, 0, 255), position=below, cast_shadow=False
    )
    for n, place in enumerate(PLACES):
        instant = instant_at(place, robot, 1.0 + n)
        page.show(instant)
        tcp = kinematics.forward(instant.theta_rad, robot)
        deadline = time.monotonic() + WAIT_S
        while True:  # the picture may be one of a moment ago
            png = visit.page.screenshot(timeout=1e3 * WAIT_S)
            found, expected = mark_in(255 * plt.imread(BytesIO(png))), seen_at(page, visit, tcp + below)
            if found is not None and np.abs(found - expected).max() <= 2.0:
                break
            assert time.monotonic() < deadline, (place, found, expected)
    mark.remove()


def test_page_loads_from_its_own_server_only(page, visit, robot):
    page.show(instant_at(PLACES[0], robot))
    page.read(Facts(state='idle', phase='CP4', cycle=17))
    visit.page.get_by_text('idle', exact=True).wait_for()
    own = page.url.partition('//')[2]
    foreign = [url for url in visit.requests if own not in url and not url.startswith(('data:', 'blob:'))]
    assert foreign == []


def test_readout_is_on_the_page(page, visit, robot):
    drives = (DriveFacts('ENABLED', 'free'), DriveFacts('FAULT', 'held'), DriveFacts('READY', 'held'))
    sentence = 'axis2: following error over its limit (8111)'
    facts = Facts(state='error', phase='CP4', cycle=4711, override=0.8, fault=sentence, drives=drives)
    page.show(instant_at(PLACES[1], robot, 4.7, (1e-4, -2e-4, 0.0)))
    page.read(facts)  # at once after it, with nothing to show afterwards: drives are read as well
    for text in ('error', 'CP4', '4711', '80 %', 'brake free', 'fault'):
        visit.page.get_by_text(text, exact=True).first.wait_for()
    assert visit.page.get_by_role('alert').filter(has_text='axis2').inner_text() == sentence


def test_a_click_is_a_wish_and_its_answer_is_shown(page, visit):
    for button, action in (('Hold', 'hold'), ('EMERGENCY STOP', 'emergency_stop'), ('Enable', 'enable')):
        visit.page.get_by_role('button', name=button, exact=True).click()
        wait_for(lambda: page.commands, f'the command of {button}')
        assert page.commands.popleft().action == action
    page.report('the robot is idle: only what moves can be held', refused=True)
    visit.page.get_by_text('only what moves can be held').first.wait_for()


def test_held_button_sends_beats_until_its_release(page, visit):
    visit.page.get_by_role('tab', name='Jog').click()
    button = visit.page.get_by_role('button', name='hold +x')
    button.scroll_into_view_if_needed()
    box = button.bounding_box()
    visit.page.mouse.move(box['x'] + box['width'] / 2, box['y'] + box['height'] / 2)
    visit.page.mouse.down()
    wait_for(lambda: len(page.commands) >= 10, 'ten beats')
    visit.page.mouse.up()
    time.sleep(SILENT_S)
    page.commands.clear()
    time.sleep(10.0 / HEARTBEAT_HZ)
    assert not page.commands


def test_points_are_taught_by_name_and_written_as_yaml(page, visit):
    visit.page.get_by_role('tab', name='Teach').click()
    visit.page.get_by_role('button', name='Teach this point').click()
    wait_for(lambda: page.commands, 'the command')
    assert (page.commands[0].action, page.commands.popleft().text) == ('teach', 'p1')
    page.controls.teach('p1', (0.1, -0.25, -0.8))
    page.controls.teach('over: it', (0.0, 0.0, -0.75))
    visit.page.get_by_text('"p1": [0.100000, -0.250000, -0.800000]').wait_for()
    visit.page.get_by_text('"over: it": [0.000000, 0.000000, -0.750000]').wait_for()


@pytest.mark.long
def test_procedures_have_a_tab_with_their_results(page, visit):
    visit.page.get_by_role('tab', name='Commissioning').click()
    visit.page.get_by_role('button', name='Run the procedure').click()
    wait_for(lambda: page.commands, 'a click')
    command = page.commands.popleft()
    assert (command.action, command.text) == ('procedure', 'axis1 S-0-0148')
    page.report_procedure('axis1', 'axis1: searches the reference')
    page.report_procedure('axis2', 'axis2: 8924 motion <blocked>', failed=True)
    page.report_procedure('axis1', 'axis1: done')
    visit.page.get_by_text('axis1: done').wait_for()
    visit.page.get_by_text('axis2: 8924 motion <blocked>').wait_for()
    assert visit.page.get_by_text('axis1: searches the reference').count() == 0


def test_two_browsers_show_the_same_and_one_may_disconnect(page, visit, browser, robot):
    with Visit(browser, page.url, 390, 844) as other:
        wait_for(lambda: len(page.server.get_clients()) == 2, 'the second browser')
        page.read(Facts(state='moving', phase='CP4', cycle=2222))
        page.show(instant_at(PLACES[2], robot))
        visit.page.get_by_text('2222', exact=True).wait_for()
        other.page.get_by_text('2222', exact=True).wait_for(state='attached')
    wait_for(lambda: len(page.server.get_clients()) == 1, 'the second browser has gone')
    page.read(Facts(state='idle', phase='CP4', cycle=3333))
    page.show(instant_at(PLACES[2], robot, 2.0))
    visit.page.get_by_text('3333', exact=True).wait_for()
    assert page.watched


@pytest.mark.long
def test_the_page_connects_again_when_it_is_served_again(robot, browser):
    with held(HOST, None) as place:
        first = Page(robot, place, 'one')
    with Visit(browser, first.url, WIDTH, HEIGHT) as visit:
        wait_for(lambda: first.watched, 'the browser connects')
        first.close()
        with held(HOST, int(first.url.rpartition(':')[2])) as place:
            again = Page(robot, place, 'another one')
        try:
            wait_for(lambda: again.watched, 'the browser has found the new page')
            again.read(Facts(state='idle', phase='CP4', cycle=77))
            again.show(instant_at(PLACES[0], robot))
            visit.page.get_by_text('77', exact=True).wait_for()
        finally:
            again.close()


@pytest.mark.long
def test_page_without_permission_has_no_buttons(robot, browser):
    with held(HOST, None) as place:
        page = Page(robot, place, 'only to look at')
    try:
        page.note('This page only shows the robot.')
        with Visit(browser, page.url, WIDTH, HEIGHT) as visit:
            visit.page.get_by_text('This page only shows the robot.').wait_for()
            assert visit.page.get_by_text('EMERGENCY STOP').count() == 0
    finally:
        page.close()


BELT = Thing(Kind.BELT, 'line', (0.0, 0.0, -0.95), 0.0, (1.2, 0.4), 1000.0)
CRATE = PartPlace(0, 'crate', (0.3, 0.3, 0.2), (0.0, -0.3, -0.95), 0.0)


def shows(visit, page, point_m, wanted):
    """Wait until a place of the picture has a colour, or has it no more."""
    deadline = time.monotonic() + WAIT_S
    while True:
        picture = 255 * plt.imread(BytesIO(visit.page.screenshot(timeout=1e3 * WAIT_S)))
        x, y = np.rint(seen_at(page, visit, point_m)).astype(int)
        red, _, blue = picture[y, x, :3].astype(float)
        if (red > 1.1 * blue) == wanted:  # that of the first type of parts, in bright light
            return
        assert time.monotonic() < deadline, picture[y, x]


@pytest.mark.long
def test_a_page_shows_the_cell_that_its_robot_has(page, visit, robot):
    instant = replace(instant_at(PLACES[0], robot, 20.0), cell=CellInstant((CRATE,), {'line': 0.02}))
    top = (0.0, -0.3, -0.75)
    page.use(robot)  # with no trace of where it has been, which may lie before the place that is looked at
    page.show(instant)
    shows(visit, page, top, False)  # nobody has told of a cell yet
    page.show_cell([BELT])
    page.show(replace(instant, time_s=20.1))
    shows(visit, page, top, True)
    visit.page.get_by_text('Look', exact=True).click()
    switch = visit.page.get_by_label('cell', exact=True)
    switch.click()
    shows(visit, page, top, False)
    switch.click()
    shows(visit, page, top, True)
    page.use(robot)  # another robot has come up in the same cell
    page.show(replace(instant, time_s=20.2))
    shows(visit, page, top, True)
    page.show_cell([])
    shows(visit, page, top, False)
    switch.wait_for(state='detached')


def test_inputs_have_a_tab_with_their_sources(page, visit, robot):
    tab = visit.page.get_by_role('tab', name='Inputs')
    page.read(Facts(state='idle', phase='CP4'))
    assert tab.count() == 0
    inputs = (InputFacts('start', False), InputFacts('part_there', True, True))
    page.read(Facts(state='idle', phase='CP4', inputs=inputs, payload_kg=None))
    tab.click()
    visit.page.get_by_text('part_there').first.wait_for()
    visit.page.get_by_text('on, set').first.wait_for()
    assert visit.page.get_by_text('payload').count() == 0
    for row, word, value in ((0, 'on', True), (1, 'off', False), (1, 'auto', 'auto')):
        visit.page.get_by_role('button', name=word, exact=True).nth(row).click()
        wait_for(lambda: page.commands, f'the command {word}')
        command = page.commands.popleft()
        assert (command.action, json.loads(command.text)) == (
            'input',
            {'name': inputs[row].name, 'value': value},
        )
    page.read(
        Facts(waiting='no word of a robot')
    )  # a robot that is started again: nothing moves away from a finger
    assert tab.count() == 1
    page.read(Facts(state='idle', phase='CP4'))
    tab.wait_for(state='detached')


@pytest.mark.parametrize(('width', 'beside'), [(249, 1), (366, 2)])
def test_bars_stay_in_the_panel_of_a_phone_and_of_a_screen(width, beside, browser, robot):
    far = np.full(3, -99.0)
    shown = readout.bars(
        Instant(1.0, np.zeros(3), far, far, far),
        (DriveFacts('ENABLED', 'free'),) * 3,
        readout.Scales.of(robot),
    )
    page = browser.new_page()
    try:
        page.set_content(f'<div id="panel" style="width:{width}px;font-family:sans-serif">{shown}</div>')
        boxes = page.evaluate(
            '[...document.querySelectorAll("#panel, #panel *")].map((e) => e.getBoundingClientRect().toJSON())'
        )
        grids = page.evaluate(
            '[...document.querySelectorAll("#panel div")].map((e) => getComputedStyle(e).gridTemplateColumns)'
        )
    finally:
        page.close()
    assert max(box['right'] for box in boxes) <= boxes[0]['right']
    assert [len(columns.split()) for columns in grids if columns != 'none'] == [beside] * 3
