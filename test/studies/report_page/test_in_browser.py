"""Tests of the report page in a real browser: drawings and their common time."""

import re
from pathlib import Path

import numpy as np
import pytest

from browser import Visit
from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.recording.record_file import SavedRecord
from delta3_pacdrive.recording.signals import SIGNALS, TRUE_SIGNALS
from delta3_pacdrive.scene.parts import RODS
from delta3_pacdrive.scene.poses import poses
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.report_page import page
from delta3_pacdrive.studies.report_page.packed_columns import resolution_of
from delta3_pacdrive.studies.report_page.plots import quantity
from delta3_pacdrive.studies.runs import runs
from report_views import READY, middle_of, pixels, place_of, seek, until

INSTANTS_S = (0.0, 0.111, 0.35, 0.62, 0.75)  # within four moves of the packaging cycle
ROUNDING = 1.0 + 1e-6  # of half a step
PIXELS = 2.0  # between what is drawn and where it has to be
DOT = (230, 0, 126)  # colour of the mark at the TCP
NOTHING = '\N{EN DASH}'  # of a value that nobody tells
NEAR = 60  # between colours, for edges that are blended


@pytest.fixture(scope='module')
def one():
    return runs.load('packaging', to_s=0.8)


@pytest.fixture(scope='module')
def written(one, tmp_path_factory):
    """Write a page of one run and a page of two; return their addresses and the second run."""
    folder, origin = tmp_path_factory.mktemp('pages'), Provenance.of('test')
    built = runs.load('packaging', 'rich', to_s=0.8)
    page.write(folder / 'one.html', [one], origin)
    page.write(folder / 'two.html', [one, built], origin)
    return (folder / 'one.html').as_uri(), (folder / 'two.html').as_uri(), built


@pytest.fixture(scope='module')
def opened(browser, written):
    with Visit(browser, written[0]) as found:
        found.page.wait_for_selector(READY, state='attached')
        yield found


@pytest.fixture
def visit(opened):
    """Return the visit of the page of one run, as it was when it was opened."""
    opened.page.evaluate(
        'delta3.clock.pause(); delta3.clock.showAll(); delta3.clock.seek(0); delta3.stage.look("iso");'
        'magnify.value = 0; magnify.dispatchEvent(new Event("input"))'
    )
    opened.page.get_by_label('command').check()
    return opened


def tcp_at(run, time_s):
    """Return the TCP [m] of the actual angles in the bus cycle at a time."""
    row = round((time_s - run.window.time_s[0]) / run.period_s)
    theta = run.window['motor_position'][row] / run.robot.dynamics.gear_ratio
    return kinematics.forward(theta, run.robot)


def test_page_loads_no_external_resources(visit, written):
    visit.page.evaluate('delta3.clock.play()')
    until(visit, 'delta3.clock.time > 0.1')
    assert visit.requests == [written[0]]
    assert visit.complaints == []


def test_tcp_is_drawn_at_the_forward_kinematics(visit, one):
    visit.page.get_by_label('command').uncheck()
    for time_s in INSTANTS_S:
        seek(visit, time_s)
        stage = pixels(visit)[:, : int(visit.page.locator('canvas').first.bounding_box()['width'])]
        drawn = middle_of(np.abs(stage - DOT).max(axis=2) < NEAR)
        assert np.linalg.norm(drawn - place_of(visit, tcp_at(one, time_s))) < PIXELS, time_s


ONLY_THE_PLATE = """
    delta3.stage.robot.parts.forEach((part, name) => { part.visible = name === 'plate' });
    delta3.stage.robot.showPart = () => {};
    delta3.stage.ghosts.forEach(ghost => { ghost.shown = false });
    delta3.stage.dots[0].material.visible = false;
    delta3.stage.paths.forEach(path => { path.line.material.visible = false })
"""


def test_plate_is_drawn_at_the_forward_kinematics(browser, written, one):
    with Visit(browser, written[0]) as visit:
        visit.page.wait_for_selector(READY, state='attached')
        visit.page.get_by_role('button', name='top').click()
        visit.page.evaluate(ONLY_THE_PLATE)
        check_plate(visit, one)


def check_plate(visit, one):
    background = None
    for time_s in INSTANTS_S:
        seek(visit, time_s)
        drawn = place_of(visit, tcp_at(one, time_s))
        x, y = np.rint(drawn).astype(int)
        around = pixels(visit)[y - 60 : y + 60, x - 60 : x + 60]
        background = around[0, 0] if background is None else background
        corner = np.array([x - 60, y - 60])
        plate = corner + middle_of(np.abs(around - background).max(axis=2) > 20.0)
        assert np.linalg.norm(plate - drawn) < PIXELS, time_s


@pytest.mark.long
def test_each_arm_is_drawn_with_the_lengths_of_the_parameters(browser, robot, tmp_path):
    corrected = robot.replace(kinematics__upper_arm_correction_m=(2e-3, -1e-3, 0.0))
    run = runs.load('packaging', str(parameters.write(corrected, tmp_path / 'corrected.yaml')), to_s=0.2)
    page.write(tmp_path / 'page.html', [run], Provenance.of('test'))
    with Visit(browser, (tmp_path / 'page.html').as_uri()) as visit:
        visit.page.wait_for_selector(READY, state='attached')
        seek(visit, 0.1)
        row = round((0.1 - run.window.time_s[0]) / run.period_s)
        theta = run.window['motor_position'][row] / corrected.dynamics.gear_ratio
        there = poses(theta, corrected)
        for rod in RODS:
            drawn = visit.page.evaluate(f'delta3.stage.robot.parts.get("forearm{rod}").position.toArray()')
            assert drawn == pytest.approx(there.of(f'forearm{rod}')[0], abs=1e-6), rod


def test_numbers_in_the_browser_are_those_of_the_trace(visit, one, robot):
    series = 'delta3.report.runs[0].columns'
    for name in (*SIGNALS, *TRUE_SIGNALS):
        values = one.window[name]
        held = np.array(visit.page.evaluate(f'{series}[{name!r}].map(column => Array.from(column))')).T
        step = resolution_of(name, quantity(name)[0], robot.bus.increments_per_rev)
        assert np.abs(held - values).max() <= 0.5 * step * ROUNDING, name


@pytest.mark.long
def test_samples_of_a_record_are_held_until_the_next_one_with_their_values(browser, one, tmp_path):
    step, names = 62.5e-6, tuple(f'axis1.phase_current_{n}' for n in range(8))
    values = np.arange(320.0)[:, np.newaxis] + 1000.0 * np.arange(8)
    start_s = one.window.meta['start_cycle'] * one.period_s
    record = SavedRecord(
        Path('s.npz'), names, ('A',) * 8, start_s + 0.3, step, values, 'a fault', start_s + 0.31
    )
    page.write(tmp_path / 'page.html', [one], Provenance.of('test'), records=[record])
    with Visit(browser, (tmp_path / 'page.html').as_uri()) as visit:
        visit.page.wait_for_selector(READY, state='attached')
        held = np.array(
            visit.page.evaluate('delta3.report.records[0].columns.A.map(column => Array.from(column))')
        ).T
        assert np.abs(held - values).max() <= 1e-4
        panel = 'delta3.plots.panels[0]'
        times = visit.page.evaluate(f'Array.from({panel}.chart.data[0])')
        assert times == pytest.approx(0.3 + step * np.arange(320), abs=1e-9)
        told = f'{panel}.entries.map(one => one.value.textContent)'
        seek(visit, 0.3 + 100.4 * step)
        assert [float(text) for text in visit.page.evaluate(told)] == pytest.approx(values[100])
        seek(visit, 0.5)
        assert set(visit.page.evaluate(told)) == {NOTHING}
        assert (
            visit.page.evaluate(f'{panel}.entries.map(one => one.entry.dataset.dash)')
            == ['0'] * 6 + ['1'] * 2
        )
        assert visit.page.evaluate(
            f'{panel}.chart.series[1].paths !== delta3.plots.panels[1].chart.series[1].paths'
        )
        visit.page.locator('#records tr[data-from]').click()
        low, high = visit.page.evaluate('delta3.clock.window')
        assert low < 0.3 < 0.3 + 319 * step < high < 0.4
        assert visit.page.get_by_label('trigger of s.npz: a fault').is_visible()
        assert visit.complaints == []


def test_slider_robot_plots_and_table_show_the_same_instant(visit, one):
    share = 0.55
    visit.page.evaluate(
        'share => { slider.value = share * slider.max; slider.dispatchEvent(new Event("input")) }', share
    )
    first, last = one.window.time_s[[0, -1]]
    time_s = first + share * (last - first)
    assert visit.page.evaluate('delta3.clock.time') == pytest.approx(time_s, abs=1e-6)
    assert visit.page.locator('#time').text_content() == f'{time_s:.3f} s'
    seek(visit, round(time_s, 3))
    lines = visit.page.evaluate(
        '[...document.querySelectorAll(".u-over .now")].map(line => '
        'line.getBoundingClientRect().left - line.parentElement.getBoundingClientRect().left - '
        'line.parentElement.clientWidth * (delta3.clock.time - delta3.clock.first)'
        ' / (delta3.clock.last - delta3.clock.first))'
    )
    assert len(lines) >= 6
    assert np.abs(lines).max() < 1.0
    row = round((round(time_s, 3) - first) / one.period_s)
    current = visit.page.locator('figure', has_text='Current').locator('output').first.text_content()
    assert float(current) == pytest.approx(one.window['current_mean'][row, 0], abs=1e-3)
    driven = visit.page.locator('tr.driven td').first.text_content()
    move = next(each for each in one.moves if each.start_s <= time_s < each.end_s)
    assert driven == str(move.number)


def test_to_zoom_one_plot_zooms_all_of_them(visit):
    over = visit.page.locator('.u-over').first
    box = over.bounding_box()
    visit.page.mouse.move(box['x'] + 0.25 * box['width'], box['y'] + 30)
    visit.page.mouse.down()
    visit.page.mouse.move(box['x'] + 0.5 * box['width'], box['y'] + 40, steps=4)
    visit.page.mouse.up()
    window = visit.page.evaluate('delta3.clock.window')
    whole = visit.page.evaluate('[delta3.clock.first, delta3.clock.last]')
    length = whole[1] - whole[0]
    assert window[0] == pytest.approx(whole[0] + 0.25 * length, abs=0.01)
    assert window[1] == pytest.approx(whole[0] + 0.5 * length, abs=0.01)
    scales = visit.page.evaluate(
        'delta3.plots.panels.filter(panel => panel.chart)'
        '.map(panel => [panel.chart.scales.x.min, panel.chart.scales.x.max])'
    )
    assert len(scales) >= 6
    np.testing.assert_allclose(scales, [window] * len(scales))
    over.dblclick()
    assert visit.page.evaluate('delta3.clock.window') == whole


def test_click_on_a_plot_selects_that_instant(visit):
    box = visit.page.locator('.u-over').first.bounding_box()
    visit.page.mouse.click(box['x'] + 0.75 * box['width'], box['y'] + 30)
    first, last = visit.page.evaluate('[delta3.clock.first, delta3.clock.last]')
    assert visit.page.evaluate('delta3.clock.time') == pytest.approx(first + 0.75 * (last - first), abs=0.005)


def test_playback_continues_at_its_speed_and_stops_on_request(visit):
    seek(visit, 0.0)
    visit.page.select_option('#speed', '0.1')
    # Within the page and by pictures of an own time, so that it is the same however slow the browser is.
    played = visit.page.evaluate(
        """() => new Promise(resolve => {
            const button = document.getElementById("play"), clock = delta3.clock, shown = [];
            const paced = window.requestAnimationFrame;
            let now = 0;
            window.requestAnimationFrame = draw => setTimeout(() => draw(now += 250));
            const frame = () => new Promise(drawn => requestAnimationFrame(drawn));
            clock.addEventListener("time", async function look() {
                shown.push([now / 1000, clock.time]);
                if (clock.time < 0.2) return;
                clock.removeEventListener("time", look);
                button.click();
                const stopped = clock.time;
                await frame();
                await frame();
                window.requestAnimationFrame = paced;
                resolve({shown, stopped, after: clock.time, playing: clock.playing});
            });
            button.click();
        })"""
    )
    wall_s, time_s = np.transpose(played['shown'])
    np.testing.assert_allclose(time_s, 0.1 * (wall_s - wall_s[0]), atol=1e-9)
    assert played['playing'] is False
    assert played['after'] == played['stopped'] == time_s[-1] >= 0.2


@pytest.mark.parametrize(
    ('key', 'time_s', 'window_s'),
    [
        ('ArrowRight', 0.402, None),
        ('ArrowLeft', 0.398, None),
        ('Shift+ArrowRight', 0.44, None),
        ('Shift+ArrowLeft', 0.36, None),
        ('Home', 'first', None),
        ('End', 'last', None),
        ('+', 0.4, 0.1),
        ('-', 0.4, 0.4),
        ('0', 0.4, 'all'),
        ('Control+ArrowRight', 0.4, None),
    ],
)
def test_each_key_steps_by_bus_cycles_jumps_to_an_end_or_zooms(key, time_s, window_s, visit, one):
    # with a bus cycle of 1 ms, steps of a millisecond would pass for steps of a cycle
    visit.page.evaluate(
        'document.activeElement.blur(); delta3.clock.period = 0.002; delta3.clock.show(0.3, 0.5)'
    )
    seek(visit, 0.4)
    visit.page.keyboard.press(key)
    clock = visit.page.evaluate(
        """period => {
            const { time, window, first, last } = delta3.clock;
            delta3.clock.period = period;
            return { time, window, first, last };
        }""",
        one.period_s,
    )
    assert clock['time'] == pytest.approx(clock.get(time_s, time_s), abs=1e-9)
    if time_s == 0.4:  # else the window may follow the instant
        whole = clock['last'] - clock['first']
        wanted = {'all': whole, None: 0.2}.get(window_s, window_s)
        assert np.diff(clock['window']) == pytest.approx(wanted, abs=1e-9)


def test_the_space_key_plays_and_pauses(visit):
    visit.page.evaluate('document.activeElement.blur()')
    for is_playing in (True, False):
        visit.page.keyboard.press('Space')
        assert visit.page.evaluate('delta3.clock.playing') is is_playing


def test_lines_in_plots_are_at_faults_and_events_in_their_colours_and_nowhere_else(visit):
    kinds = {0.1: 'start', 0.2: 'fault', 0.3: 'event', 0.4: 'output', 0.5: 'event'}
    drawn, places, colours = visit.page.evaluate(
        """async marks => {
            const [run] = delta3.report.runs, before = run.marks, drawn = [];
            const { chart } = delta3.plots.panels.find(one => one.chart), { ctx } = chart;
            ctx.fillRect = function (x, y, width, height) {
                if (width === devicePixelRatio) drawn.push([x, this.fillStyle]);
            };
            run.marks = marks;
            chart.redraw();
            await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
            delete ctx.fillRect;
            run.marks = before;
            const colours = {};
            for (const kind of ['fault', 'event']) {
                ctx.fillStyle = getComputedStyle(document.documentElement).getPropertyValue(`--${kind}`).trim();
                colours[kind] = ctx.fillStyle;
            }
            return [drawn, marks.map(([time]) => Math.round(chart.valToPos(time, 'x', true))), colours];
        }""",
        [[time_s, kind, ''] for time_s, kind in kinds.items()],
    )
    wanted = [
        [place, colours[kind]]
        for place, kind in zip(places, kinds.values(), strict=True)
        if kind in ('fault', 'event')
    ]
    assert drawn[: len(wanted)] == wanted
    assert all(line in wanted for line in drawn)
    assert colours['fault'] != colours['event']


def test_ghost_of_the_command_is_offset_by_the_magnified_error(visit, one):
    visit.page.evaluate('magnify.value = 40; magnify.dispatchEvent(new Event("input"))')
    assert visit.page.locator('#magnified').text_content() == '\u00d7100'
    seek(visit, 0.111)
    row = round((0.111 - one.window.time_s[0]) / one.period_s)
    expected = one.window['tcp_actual'][row] + 100.0 * one.window['tcp_error'][row]
    ghost = visit.page.evaluate('delta3.stage.ghosts[0].robot.tcp')
    np.testing.assert_allclose(ghost, expected, atol=2e-6)


def test_the_payload_is_drawn_while_the_robot_carries_it(visit, one):
    """Half a kilogram on the way there, nothing on the way back."""
    there, back = (one.moves[n] for n in (0, 2))
    seen = []
    for move in (there, back):
        seek(visit, 0.5 * (move.start_s + move.end_s))
        seen.append(visit.page.evaluate('delta3.stage.robot.parts.get("payload").visible'))
    assert seen == [True, False]


def test_click_on_a_move_of_a_shifted_run_selects_its_time_on_the_page(browser, written, tmp_path):
    """The table has the times of its run; the page shifts the second run by 0.25 s here."""
    text = Path(written[1].removeprefix('file://')).read_text(encoding='utf-8')
    begin, _, end = text.rpartition('"shift_s":')
    shifted = tmp_path / 'shifted.html'
    shifted.write_text(
        f'{begin}"shift_s":0.25{end[len(end) - len(end.lstrip(" -.0123456789e")) :]}', encoding='utf-8'
    )
    with Visit(browser, shifted.as_uri()) as visit:
        visit.page.wait_for_selector(READY, state='attached')
        assert visit.page.evaluate('delta3.report.runs.map(run => run.shift_s)') == [0.0, 0.25]
        for run, shift_s in enumerate((0.0, 0.25)):
            row = visit.page.locator(f'tr[data-run="{run}"]').nth(1)
            row.click()
            wanted = float(row.get_attribute('data-from')) + shift_s
            assert visit.page.evaluate('delta3.clock.time') == pytest.approx(wanted, abs=1e-9)
            assert 'driven' in row.get_attribute('class')


@pytest.mark.long
def test_a_page_of_two_runs_shows_their_difference(browser, written, one):
    built = written[2]
    with Visit(browser, written[1]) as visit:
        visit.page.wait_for_selector(READY, state='attached')
        seek(visit, 0.111)
        panel = visit.page.locator('figure.difference', has_text='Current').first
        assert 'Current: packaging (rich) \u2212 packaging' in panel.text_content()
        row = round((0.111 - one.window.time_s[0]) / one.period_s)
        difference = built.window['current_mean'][row] - one.window['current_mean'][row]
        shown = [float(text) for text in panel.locator('output').all_text_contents()]
        np.testing.assert_allclose(shown, difference, atol=2e-3)
        ghost = visit.page.evaluate('delta3.stage.ghosts.find(one => one.text.includes("rich")).robot.tcp')
        np.testing.assert_allclose(ghost, built.window['tcp_actual'][row], atol=1e-7)
        assert (visit.requests, visit.complaints) == ([written[1]], [])


@pytest.mark.parametrize(
    ('width', 'height', 'scheme'),
    [
        (1280, 800, 'dark'),
        (390, 844, 'light'),
        pytest.param(1280, 800, 'light', marks=pytest.mark.long),
        pytest.param(390, 844, 'dark', marks=pytest.mark.long),
    ],
)
def test_the_page_fits_the_screen_and_is_drawn_in_both_schemes(browser, written, width, height, scheme):
    with Visit(browser, written[1], width, height, scheme) as visit:
        visit.page.wait_for_selector(READY, state='attached')
        seek(visit, 0.35)
        assert visit.page.evaluate('document.documentElement.scrollWidth') <= width
        picture = pixels(visit)
        assert (picture[-3, 3].mean() < 60.0) == (scheme == 'dark')
        canvas = visit.page.locator('canvas').first.bounding_box()
        stage = picture[int(canvas['y']) : int(canvas['y'] + canvas['height']) - 5, : int(canvas['width'])]
        assert len(np.unique(stage.reshape(-1, 3), axis=0)) > 200  # a robot is there
        assert visit.complaints == []


def test_browser_without_3d_shows_all_other_elements(browser, written):
    with Visit(browser, 'about:blank') as visit:
        visit.page.add_init_script('HTMLCanvasElement.prototype.getContext = (get => function (kind, ...more) {'
            ' return kind.startsWith("webgl") ? null : get.call(this, kind, ...more) })'
            '(HTMLCanvasElement.prototype.getContext)')  # fmt: skip
        visit.page.goto(written[0])
        visit.page.wait_for_selector(READY, state='attached')
        assert 'No 3-D here' in visit.page.locator('#told').text_content()
        assert visit.page.locator('.u-over').count() >= 6


# each button and choice of the page is used once


@pytest.mark.parametrize(
    ('name', 'towards'),
    [('front', (0, -1, 0)), ('side', (1, 0, 0)), ('top', (0, 0, 1)), ('3-D', (0.6, -0.75, 0.27))],
)
def test_each_view_looks_from_its_named_direction(name, towards, visit):
    visit.page.get_by_role('button', name=name, exact=True).click()
    eye = visit.page.evaluate(
        'delta3.stage.camera.position.clone().sub(delta3.stage.controls.target).toArray()'
    )
    np.testing.assert_allclose(eye / np.linalg.norm(eye), towards, atol=0.02)


def test_the_button_of_the_theme_makes_the_page_dark_and_light_again(visit):
    for is_dark in (True, False):
        visit.page.locator('#theme').click()
        assert bool(pixels(visit)[-3, 3].mean() < 60.0) is is_dark


def test_each_speed_of_the_list_is_that_of_the_clock(visit):
    speeds = visit.page.locator('#speed option').evaluate_all('all => all.map(one => one.value)')
    assert speeds == ['0.01', '0.02', '0.05', '0.1', '0.25', '0.5', '1', '2', '4']
    for speed in speeds:
        visit.page.select_option('#speed', speed)
        assert visit.page.evaluate('delta3.clock.speed') == float(speed)


def test_buttons_show_less_more_and_all_of_the_time(visit):
    visit.page.evaluate('delta3.clock.show(0.3, 0.5); delta3.clock.seek(0.4)')
    whole = visit.page.evaluate('[delta3.clock.first, delta3.clock.last]')
    for name, window in (('closer', [0.35, 0.45]), ('wider', [0.3, 0.5]), ('all', whole)):
        visit.page.locator(f'#{name}').click()
        assert visit.page.evaluate('delta3.clock.window') == pytest.approx(window, abs=1e-9), name


def test_each_chip_shows_and_hides_the_plot_of_its_name(visit):
    chips = visit.page.locator('#chips button')
    titles = chips.all_text_contents()
    groups = visit.page.locator('#panels .group')
    assert len(titles) == groups.count() >= 6
    for n, title in enumerate(titles):
        group, chip = groups.nth(n), chips.nth(n)
        assert group.locator('figcaption b').first.text_content() == title
        before = group.is_visible()
        for shown in (not before, before):
            chip.click()
            assert group.is_visible() is shown
            assert chip.get_attribute('aria-pressed') == str(shown).lower()


def test_each_entry_of_a_legend_hides_its_curve_and_shows_it_again(visit):
    entries = visit.page.locator('#panels figure').filter(has_text='Current').first.locator('button.entry')
    shown = """delta3.plots.panels.find(one => one.element.textContent.startsWith('Current'))
               .chart.series.slice(1).map(one => one.show)"""
    whole = visit.page.evaluate(shown)
    assert all(whole)
    hidden = []
    for n in range(entries.count()):
        entries.nth(n).click()
        hidden.append({i for i, one in enumerate(visit.page.evaluate(shown)) if not one})
        entries.nth(n).click()
        assert visit.page.evaluate(shown) == whole
    assert all(hidden)
    assert set().union(*hidden) == set(range(len(whole)))
    assert sum(map(len, hidden)) == len(whole)  # each curve has one entry


def test_each_checkbox_shows_and_hides_its_element_of_the_scene(visit):
    found = """() => ({
        ...Object.fromEntries(delta3.stage.ghosts.map(one => [one.text, one.robot.group.visible])),
        'planned path': delta3.stage.paths.filter(one => one.style.kind === 'planned').every(one => one.line.visible),
        travelled: delta3.stage.paths.filter(one => one.style.kind === 'travelled').every(one => one.line.visible),
        workspace: delta3.stage.robot.parts.get('workspace').visible })"""
    seek(visit, 0.1)
    names = visit.page.locator('#options label').all_text_contents()
    assert names == ['command', 'true pose', 'planned path', 'travelled', 'workspace']
    for name in names:
        box = visit.page.locator('#options label').filter(has_text=re.compile(f'^{name}$')).locator('input')
        before, was = visit.page.evaluate(found), box.is_checked()
        for checked in (not was, was):
            box.set_checked(checked)
            seek(visit, 0.1)
            assert visit.page.evaluate(found) == before | {name: checked}


def test_each_block_and_mark_of_the_track_selects_its_time(visit, one):
    blocks = visit.page.locator('#track .move')
    assert blocks.all_text_contents() == [str(move.number) for move in one.moves]
    for block, move in zip(blocks.all(), one.moves, strict=True):
        block.dispatch_event('click')
        assert visit.page.evaluate('delta3.clock.time') == pytest.approx(
            max(move.start_s, one.window.time_s[0]), abs=1e-6
        )
        assert block.get_attribute('title').startswith(f'move {move.number}, ')
    for mark in visit.page.locator('#track .mark').all():
        mark.dispatch_event('click')
        told = float(mark.get_attribute('title').partition(' s: ')[0])
        assert visit.page.evaluate('delta3.clock.time') == pytest.approx(told, abs=6e-4)


@pytest.mark.parametrize('way', ['click', 'Enter'])
def test_row_of_the_table_of_moves_selects_its_move(way, visit, one):
    move = one.moves[1]
    row = visit.page.locator('tr[data-from]').nth(1)
    if way == 'click':
        row.click()
    else:
        row.press('Enter')
    low, high = visit.page.evaluate('delta3.clock.window')
    assert visit.page.evaluate('delta3.clock.time') == pytest.approx(move.start_s, abs=1e-6)
    assert low < move.start_s < move.end_s < high < low + 2.0 * (move.end_s - move.start_s)


@pytest.mark.parametrize(('key', 'zooms'), [('Control', True), ('Shift', True), ('', False)])
def test_the_wheel_zooms_around_its_place_with_a_key_only(key, zooms, visit):
    before = visit.page.evaluate('delta3.clock.window')
    place = visit.page.evaluate(
        """key => {
            const { chart } = delta3.plots.panels.find(one => one.chart);
            const box = chart.over.getBoundingClientRect(), clientX = box.left + 0.25 * box.width;
            chart.over.dispatchEvent(new WheelEvent('wheel', {
                deltaY: -240, clientX, ctrlKey: key === 'Control', shiftKey: key === 'Shift', cancelable: true }));
            return 0.25;
        }""",
        key,
    )
    low, high = visit.page.evaluate('delta3.clock.window')
    if not zooms:
        assert [low, high] == before
        return
    middle = before[0] + place * (before[1] - before[0])
    assert high - low == pytest.approx(0.5 * (before[1] - before[0]), rel=1e-6)
    assert low + place * (high - low) == pytest.approx(middle, abs=2e-3)  # a pixel


def test_one_finger_moves_the_instant_and_two_zoom(visit):
    times, windows = visit.page.evaluate(
        """() => {
            const { chart } = delta3.plots.panels.find(one => one.chart), { over } = chart;
            const box = over.getBoundingClientRect(), times = [], windows = [];
            const touch = (kind, pointerId, share) => over.dispatchEvent(new PointerEvent(kind, {
                pointerId, pointerType: 'touch', clientX: box.left + share * box.width }));
            touch('pointerdown', 1, 0.2);
            for (const share of [0.3, 0.6]) { touch('pointermove', 1, share); times.push(delta3.clock.time) }
            touch('pointerdown', 2, 0.8);
            touch('pointermove', 2, 0.7);
            windows.push(delta3.clock.window);
            touch('pointermove', 2, 0.8);
            windows.push(delta3.clock.window);
            for (const id of [1, 2]) touch('pointerup', id, 0.5);
            touch('pointermove', 1, 0.1);
            times.push(delta3.clock.time);
            return [times, windows];
        }"""
    )
    first, last = visit.page.evaluate('[delta3.clock.first, delta3.clock.last]')
    place = [first + share * (last - first) for share in (0.3, 0.6, 0.6)]
    assert times == pytest.approx(place, abs=2e-3)
    before, after = windows
    assert after[1] - after[0] == pytest.approx(0.5 * (before[1] - before[0]), rel=1e-2)
