"""Tests of the numbers shown with the picture."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.view import readout
from delta3_pacdrive.view.controls import InputRows
from delta3_pacdrive.view.plots import PLOTS, rows_of
from delta3_pacdrive.view.values import DriveFacts, Facts, InputFacts, Instant, TurnInstant

HOSTILE = '<script>alert(1)</script> & "more"'
SAFE = '&lt;script&gt;alert(1)&lt;/script&gt; &amp; &quot;more&quot;'


def test_texts_of_others_are_shown_and_not_carried_out():
    facts = Facts(
        state='moving', fault=HOSTILE, operator=HOSTILE, working=HOSTILE, phase=HOSTILE, waiting=HOSTILE
    )
    facts = replace(facts, inputs=(InputFacts(HOSTILE, True),), controller=HOSTILE)
    shown = readout.status(facts, None)
    assert '<script' not in shown
    assert shown.count(SAFE) == 7
    assert '<script' not in readout.input_row(InputFacts(HOSTILE, True))
    drives = (DriveFacts(HOSTILE, HOSTILE, (HOSTILE,)),) * 3
    bars = readout.bars(Instant(0.0, np.zeros(3)), drives, readout.Scales(1.0, 1.0, 1.0))
    assert '<script' not in bars
    assert '<script' not in readout.answers([(HOSTILE, True)])
    assert '<script' not in readout.copied(HOSTILE, HOSTILE)
    assert '<script' not in readout.status(Facts(waiting=HOSTILE), None)


def test_tool_angle_is_shown_with_the_tcp_if_there_is_one():
    tcp, turn = np.array([0.1, 0.0, -0.8]), TurnInstant(np.radians(123.4), np.radians(-0.05))
    shown = readout.status(Facts(state='moving'), tcp, [turn])
    assert '123.40 deg' in shown
    assert '-0.050 deg' in shown
    both = readout.status(Facts(state='moving'), tcp, [turn, TurnInstant(np.radians(-30.0))])
    assert 'tool 2' in both
    assert '-30.00 deg' in both
    assert 'deg' not in readout.status(Facts(state='moving'), tcp)


def test_bars_show_the_numbers_of_each_axis(robot):
    instant = Instant(
        1.0,
        np.zeros(3),
        np.radians([0.001, -0.002, 0.003]),
        np.array([1.0, -2.0, 0.5]),
        np.array([2.0, -4.0, 1.0]),
        np.array([0.0, 0.5, 0.95]),
    )
    drives = (
        DriveFacts('ENABLED', 'free'),
        DriveFacts('FAULT', 'held'),
        DriveFacts('READY', 'held', ('hot',)),
    )
    shown = readout.bars(instant, drives, readout.Scales.of(robot))
    for text in (
        '-2.00 N m',
        '-4.00 A',
        '-0.0020 deg',
        '50 %',
        '95 %',
        'enabled',
        'fault',
        'brake held',
        'hot',
    ):
        assert text in shown
    assert readout.RED in shown  # a load of 95 % and a fault


def test_a_bar_of_a_negative_share_grows_from_the_middle_to_the_left_of_a_positive_one_to_the_right():
    scales, drives = readout.Scales(2.0, 4.0, 1.0), (DriveFacts('ENABLED', 'free'),)
    for torque, current, bars in (
        (-1.0, 1.0, ((25.0, 25.0), (50.0, 12.5))),
        (3.0, -8.0, ((50.0, 50.0), (0.0, 50.0))),
    ):
        instant = Instant(
            0.0, np.zeros(3), np.zeros(3), np.full(3, torque), np.full(3, current), np.full(3, 0.5)
        )
        shown = readout.bars(instant, drives, scales)
        found = re.findall(r'left:([\d.]+)%;width:([\d.]+)%', shown)
        rows = [tuple(map(float, pair)) for pair in found]
        # torque, current, following error, and I2t, which has no sign and grows from the left end
        assert rows == [*bars, (50.0, 0.0), (0.0, 50.0)]


def test_released_brake_is_green_and_applied_brake_is_grey():
    instant = Instant(0.0, np.zeros(3))
    for brake, colour in (('free', '#2f9e5b'), ('held', '#868e96')):
        shown = readout.bars(instant, (DriveFacts('FAULT', brake),), readout.Scales(1.0, 1.0, 1.0))
        (style,) = re.findall(f'background:([^;]+);[^>]*>brake {brake}<', shown)
        assert style == colour


class Labels:
    """A page without a browser that stores the content of its elements."""

    def __init__(self):
        self.contents = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def add_tab(self, _):
        return self

    def add_html(self, content):
        self.contents.append(SimpleNamespace(content=content))
        return self.contents[-1]

    def add_button_group(self, *_):
        return SimpleNamespace(on_click=lambda _: None)


def test_input_that_switches_on_and_off_is_shown_off():
    page = Labels()
    rows = InputRows(page, page, lambda _: None)
    for forced in (False, True):
        for on in (False, True, False):
            rows.show([InputFacts('door', on, forced)])
            (row,) = page.contents
            assert words(row.content) == f'door {"on" if on else "off"}{", set" if forced else ""}'


def test_each_plot_has_the_signal_of_its_title_in_its_unit(robot):
    theta = np.radians([[10.0, 20.0, 30.0]])
    lag, torque, current = np.radians([[0.001, 0.002, 0.003]]), [[4.0, 5.0, 6.0]], [[7.0, 8.0, 9.0]]
    tcp = kinematics.forward(theta, robot)
    rows = rows_of(
        np.array([1.0]), theta, lag, np.array(torque), np.array(current), np.array([2.5]), 1e-3 * tcp, robot
    )
    wanted = {
        'TCP error': ('mm', tcp[0]),
        'following error': ('mdeg', [1.0, 2.0, 3.0]),
        'torque': ('N m', torque[0]),
        'current': ('A', current[0]),
        'TCP': ('mm', 1e3 * tcp[0]),
        'arms': ('deg', [10.0, 20.0, 30.0]),
        'speed': ('m/s', [2.5]),
    }
    assert rows[0, 0] == 1.0
    assert PLOTS.keys() == wanted.keys()
    for name, (first, series, unit) in PLOTS.items():
        assert unit == wanted[name][0]
        assert rows[0, 1 + first :][: len(series)] == pytest.approx(wanted[name][1]), name


def test_page_without_a_robot_reports_it_and_shows_a_fault_as_alert():
    assert 'no robot' in readout.status(Facts(waiting='no word of a robot in namespace /'), None)
    shown = readout.status(
        Facts(state='error', phase='CP4', fault='axis2: too hot'), np.array([0.1, 0.2, -0.8])
    )
    assert 'role="alert"' in shown
    assert 'axis2: too hot' in shown
    assert '100.00, 200.00, -800.00 mm' in shown


def words(shown):
    """Return the displayed text."""
    return ' '.join(re.sub('<[^>]*>|&[a-z]+;', ' ', shown).split())


def test_inputs_are_reported_with_forced_ones_and_without_a_cell_the_payload():
    facts = Facts(state='idle', payload_kg=0.5, outputs=0b101)
    assert 'outputs 0 2 payload 0.5 kg' in words(readout.status(facts, None))
    assert 'inputs' not in readout.status(facts, None)
    inputs = (InputFacts('start', True), InputFacts('part', False), InputFacts('door', True, True))
    shown = words(readout.status(replace(facts, payload_kg=None, inputs=inputs), None))
    assert shown.endswith('outputs 0 2 inputs start on part off door on, set')
    assert 'payload' not in shown
    assert [words(readout.input_row(one)) for one in inputs] == ['start on', 'part off', 'door on, set']


def test_a_long_name_of_an_operator_wraps_inside_the_panel():
    row = readout.status(Facts(state='idle', operator='x' * 200), None)
    assert f'<b style="overflow-wrap:anywhere">{"x" * 200}</b>' in row


def test_a_value_keeps_a_distance_from_its_name(robot):
    bars = readout.bars(
        Instant(0.0, np.zeros(3)), (DriveFacts('ENABLED', 'free', ()),) * 3, readout.Scales.of(robot)
    )
    assert bars.count('display:flex;justify-content:space-between;gap:8px') == 12
