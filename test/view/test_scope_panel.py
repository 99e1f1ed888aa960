"""Tests of the oscilloscope on the page: requests, and drawings of a record."""

import json
from unittest.mock import MagicMock

import numpy as np
import pytest

from browser import Visit
from delta3_pacdrive import parameters
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.recording.acquisition import Mode, Record, setting
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, DRIVES
from delta3_pacdrive.view.scope_panel import ScopePanel, setting_of
from delta3_pacdrive.view.serving import HOST, held

WIDTH, HEIGHT = 1280, 1000
CHANNELS = ['axis1.current', 'axis1.speed', 'axis3.current_reference', 'axis2.S-0-0104']
FILLED_IN = {
    'channels': 'axis1.current, axis2.speed',
    'mode': 'single',
    'trigger': 'none',
    'source': '',
    'level': 0.0,
    'edge': 'usual',
    'pre_trigger_s': 0.0,
    'duration_s': 0.5,
    'rate_hz': 16000.0,
}


def asked(robot, **more):
    return setting_of(json.dumps(FILLED_IN | more), robot)


def record_of(robot, trigger='axis1.current', samples=1600):
    values = np.arange(samples * len(CHANNELS), dtype=float).reshape(samples, -1)
    wanted = setting(
        robot, CHANNELS, 16000.0, samples / 16000.0, trigger, pre_trigger_s=0.01 if trigger else 0.0
    )
    return Record(wanted, 32_000, values, 160 if trigger else None)


def test_request_equals_the_recording_of_the_command(robot):
    names = ['axis1.current', 'axis2.speed']
    assert asked(robot) == setting(robot, names, 16000.0, 0.5)
    assert asked(robot, trigger='program', pre_trigger_s=0.1, rate_hz=4000) == setting(
        robot, names, 4000.0, 0.5, 'program', pre_trigger_s=0.1
    )
    on_channel = {'trigger': 'channel', 'source': 'axis3.current', 'level': 2.5, 'edge': 'falling'}
    assert asked(robot, **on_channel, mode='normal') == setting(
        robot, names, 16000.0, 0.5, 'axis3.current', 2.5, 'falling', mode='normal'
    )
    assert asked(robot, mode='rolling').mode is Mode.ROLLING


@pytest.mark.parametrize(
    ('command', 'why'),
    [
        ({'channels': ' , '}, 'an oscilloscope needs a channel, such as axis1.current'),
        ({'channels': 'axis1.curent'}, 'did you mean'),
        ({'trigger': 'channel', 'source': ' '}, 'a trigger on a channel needs that channel'),
        ({'rate_hz': 1e6}, 'the rate is 1e[+]06, but must be between 1 and 16000 Hz'),
        ({'rate_hz': None}, "the rate is 'None', but must be between 1 and 16000 Hz"),
        ({'duration_s': float('nan')}, 'the duration is nan, but must be between 0 and 100000 s'),
        ({'duration_s': 0}, 'has no samples'),
        ({'level': '1'}, "the level is '1', but must be between -1e[+]12 and 1e[+]12$"),
        ({'trigger': 'fault', 'pre_trigger_s': 1.0}, 'the pre-trigger of 1 s must be shorter'),
        ({'edge': 'sharp'}, 'sharp.? is not a valid edge: rising, falling, both, change'),
        ({'mode': 'endless'}, 'endless.? is not a valid mode: single, normal, rolling'),
        ({'mode': 'normal'}, 'the mode normal needs a trigger'),
        (
            {'duration_s': 7},
            'a page draws at most 200000 values, 112000 samples of 2 channels are 224000: choose',
        ),
    ],
)
def test_settings_that_cannot_be_recorded_or_drawn_are_rejected(command, why, robot):
    with pytest.raises(ParameterError, match=why):
        asked(robot, **command)


def drawn(record):
    """Return the charts that a record leaves: labels and unit, and the columns that are drawn."""
    gui, charts = MagicMock(), []

    def add(*_, **options):
        handle = MagicMock()
        labels = [one['label'] for one in options['series']]
        charts.append((labels, options['axes'][1].get('label'), handle))
        return handle

    gui.add_uplot.side_effect = add
    panel = ScopePanel(gui, MagicMock(), DRIVES)
    panel.show(record)
    return charts, panel


def test_every_sample_is_drawn_in_a_chart_for_each_unit_over_time_from_the_trigger_on(robot):
    record = record_of(robot)
    charts, panel = drawn(record)
    assert [(labels, unit) for labels, unit, _ in charts] == [
        (['t [ms]', 'axis1.current', 'axis3.current_reference'], 'A'),
        (['t [ms]', 'axis1.speed'], 'rad/s'),
        (['t [ms]', 'axis2.S-0-0104'], '1/s'),
    ]
    of_unit = [[0, 2], [1], [3]]
    for (_, _, handle), columns in zip(charts, of_unit, strict=True):
        time_ms, *values = handle.data
        np.testing.assert_allclose(time_ms, (np.arange(1600) - 160) / 16.0, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(np.column_stack(values), record.values[:, columns])
    panel.show(record)
    assert len(charts) == 3  # the same ones


def test_without_a_trigger_time_begins_with_the_record(robot):
    charts, _ = drawn(record_of(robot, None))
    assert charts[0][2].data[0][0] == 0.0


def test_the_drives_that_can_be_chosen_are_those_of_the_robot():
    gui, offered = MagicMock(), {}

    def add(label, options, **_):
        offered[label] = MagicMock(options=options)
        return offered[label]

    gui.add_dropdown.side_effect = add
    panel = ScopePanel(gui, MagicMock(), DRIVES)
    assert offered['drive'].options == DRIVES
    panel.use(ALL_DRIVES)
    assert offered['drive'].options == ALL_DRIVES


@pytest.fixture(scope='module')
def page(robot):
    """Return a page to look at a robot only, with an oscilloscope."""
    pytest.importorskip('viser', reason='the page needs the extra "view"')
    from delta3_pacdrive.view.page import Page

    with held(HOST, None) as place:
        made = Page(robot, place, 'a robot of the tests')
    made.add_scope()
    try:
        yield made
    finally:
        made.close()


@pytest.mark.long
def test_users_fill_in_the_form_and_see_the_record_or_the_reason(page, browser, robot):
    with Visit(browser, page.url, WIDTH, HEIGHT) as visit:
        web = visit.page
        web.get_by_text('Oscilloscope', exact=True).click()
        web.get_by_role('button', name='Add this channel').click()
        web.get_by_label('duration s').fill('0.25')
        web.get_by_label('duration s').press('Enter')
        web.wait_for_timeout(1000)
        web.get_by_role('button', name='Record', exact=True).click()
        web.get_by_role('button', name='End recording').click()
        web.wait_for_timeout(1000)
        first, last = page.commands
        names = ['axis1.current_reference', 'axis1.current', 'axis1.position_command']
        assert setting_of(first.text, robot) == setting(robot, names, 16000.0, 0.25)
        assert (first.action, last.action) == ('scope', 'end_scope')
        page.report_scope('the oscilloscope of axis1 is in use by somebody', refused=True)
        web.get_by_text('Refused').first.wait_for()
        assert (
            web.get_by_text('in use by somebody').count() == 2
        )  # beside the fields, and where nobody overlooks it
        record = record_of(robot)
        page.scope.show(record)
        web.get_by_text('1600 samples of 4 channels at 16000 Hz; 0 is bus time 2.010000 s').wait_for()
        for name in record.names:
            web.get_by_text(name, exact=False).first.wait_for()


def test_a_robot_that_turns_out_to_have_a_rotary_axis_offers_its_drive(page, robot, monkeypatch):
    told = []
    monkeypatch.setattr(page.scope, 'use', told.append)
    page.use(parameters.load('rotary'))
    page.use(robot)
    assert told == [ALL_DRIVES[:4], DRIVES]
