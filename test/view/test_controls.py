"""Tests of the controls of the page without a browser: the request of each element."""

import asyncio
import json
from types import SimpleNamespace
from typing import NamedTuple
from unittest.mock import MagicMock

import numpy as np
import pytest

from delta3_pacdrive.configuration.packaged import program_names
from delta3_pacdrive.robot.faults.fault import KINDS, parse
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, DRIVES
from delta3_pacdrive.view import playback
from delta3_pacdrive.view.controls import PROGRAM_BYTES_MAX, Controls
from delta3_pacdrive.view.jog import DIRECTIONS
from delta3_pacdrive.view.playback import Player
from delta3_pacdrive.view.scope_panel import ScopePanel, setting_of
from delta3_pacdrive.view.values import Facts, InputFacts, UiCommand
from gui_stand_in import Gui


@pytest.fixture
def panel():
    """Return controls of a robot without a rotary axis, their labels, and the requests."""
    gui, commands = Gui(), []
    return SimpleNamespace(controls=Controls(gui, commands.append, DRIVES), gui=gui, commands=commands)


class File(NamedTuple):
    """A file selected by a user."""

    name: str
    content: bytes


ASKED = {
    ('EMERGENCY STOP', None): ('emergency_stop', ''),
    ('motion', 'Start'): ('start', ''),
    ('motion', 'Hold'): ('hold', ''),
    ('motion', 'Resume'): ('resume', ''),
    ('motion', 'Abort'): ('abort', ''),
    ('drives', 'Enable'): ('enable', ''),
    ('drives', 'Disable'): ('disable', ''),
    ('drives', 'Reset'): ('reset', ''),
    ('Load into the queue', None): ('packaged', program_names()[0]),
    ('Load a file ...', File('a.yaml', b'moves: []')): ('program', 'moves: []'),
    ('Clear the queue', None): ('clear', ''),
    ('override %', 37): ('override', '37.0'),
    ('Teach this point', None): ('teach', 'p1'),
    ('Delete all points', None): ('forget', ''),
    ('Run the procedure', None): ('procedure', 'axis1 S-0-0148'),
    ('Stop the procedure', None): ('end_procedure', ''),
    ('End injected faults', None): ('inject', '{"fault": "clear"}'),
    **{('one step', way): ('step', f'{way} 10 50') for way in DIRECTIONS},
}


@pytest.mark.parametrize('by_force', [False, True])
@pytest.mark.parametrize(('name', 'value', 'command'), [(*key, command) for key, command in ASKED.items()])
def test_each_button_sends_its_request(name, value, command, by_force, panel):
    panel.gui['take control over'].value = by_force
    panel.gui[name].use(value)
    assert panel.commands == [UiCommand(*command, by_force)]


# what a button asks for depends on these
FIELDS = {
    ('program', 'packaging'): ('Load into the queue', ('packaged', 'packaging')),
    ('step mm', '0.1'): ('one step', ('step', '+x 0.1 50')),
    ('speed mm/s', 120): ('one step', ('step', '+x 10 120')),
    ('axis', 'axis3'): ('Run the procedure', ('procedure', 'axis3 S-0-0148')),
    ('procedure', 'P-0-0541 Brake check'): ('Run the procedure', ('procedure', 'axis1 P-0-0541')),
    ('name', 'home'): ('Teach this point', ('teach', 'home')),
}


@pytest.mark.parametrize(('field', 'button', 'command'), [(key, *value) for key, value in FIELDS.items()])
def test_each_field_is_part_of_the_request_of_a_button(field, button, command, panel):
    panel.gui[field[0]].use(field[1])
    panel.gui[button].use('+x' if button == 'one step' else None)
    assert panel.commands == [UiCommand(*command)]


@pytest.mark.parametrize('direction', DIRECTIONS)
def test_held_button_requests_its_direction_at_the_speed_of_the_slider(direction, panel):
    panel.gui['speed mm/s'].value = 80
    (beat,) = panel.gui[f'hold {direction}'].use()
    asyncio.run(beat)
    assert panel.commands == [UiCommand('press', f'{direction} 80')]


@pytest.mark.parametrize('kind', [name for name in KINDS if name != 'clear'])
def test_each_fault_is_injected_with_the_values_of_its_fields(kind, panel):
    gui, about = panel.gui, KINDS[kind]
    gui['fault'].use(kind)
    shown = {name for name in ('at', 'value', 'cycles', 'lasts s') if gui[name].visible}
    expected = {'fault': kind}
    if about.value:
        gui['value'].use(about.high)
        expected[about.value] = about.high
    if about.telegram:
        gui['cycles'].use(3)
        expected['cycles'] = 3
    elif not about.once:
        gui['lasts s'].use(0.75)
        expected['for_s'] = 0.75
    if target := str(about.target):
        gui['at'].use(gui['at'].options[1])
        expected[target] = gui['at'].options[1]
        assert gui['at'].options[1] == {'axis': 'axis2', 'node': 'transformation_task'}[target]
    gui['Inject the fault'].use()
    assert json.loads(panel.commands[-1].text) == expected
    assert parse(expected, 'here').kind == kind
    names = {'axis': 'at', 'node': 'at', about.value: 'value', 'cycles': 'cycles', 'for_s': 'lasts s'}
    assert shown == {names[key] for key in expected if key != 'fault'}


def test_a_fault_that_lasts_for_ever_has_no_end(panel):
    panel.gui['fault'].use('brake_stuck')
    panel.gui['lasts s'].use(0.0)
    panel.gui['Inject the fault'].use()
    assert json.loads(panel.commands[-1].text) == {'fault': 'brake_stuck', 'axis': 'axis1'}


def test_faults_are_offered_for_the_drives_that_the_robot_has(panel):
    kind, target = panel.gui['fault'], panel.gui['at']
    kind.value = 'overload'
    for drives in (DRIVES, ALL_DRIVES, DRIVES):
        panel.controls.use(drives)
        assert target.options == drives
    kind.value = 'kill'
    panel.controls.use(ALL_DRIVES)
    assert target.options == ('unit_robot', 'transformation_task', *DRIVES, 'plant', 'axis4', 'axis5')
    target.value = 'axis4'
    panel.gui['Inject the fault'].use()
    assert json.loads(panel.commands[-1].text) == {'fault': 'kill', 'node': 'axis4'}


@pytest.mark.parametrize(('word', 'value'), [('on', True), ('off', False), ('auto', 'auto')])
def test_each_button_of_an_input_sets_it(word, value, panel):
    panel.controls.show(Facts(state='idle', inputs=(InputFacts('door', True, False),)))
    panel.gui['set to'].use(word)
    assert json.loads(panel.commands[-1].text) == {'name': 'door', 'value': value}


def test_override_slider_follows_the_robot_without_requests(panel):
    panel.controls.show(Facts(state='idle', override=0.3))
    assert panel.gui['override %'].value == 30
    assert panel.commands == []


@pytest.mark.parametrize(('content', 'why'), [(b'x' * (PROGRAM_BYTES_MAX + 1), 'limit'), (b'\xff', 'UTF-8')])
def test_a_file_that_is_too_long_or_no_text_is_not_loaded(content, why, panel):
    told = []
    panel.controls.report = lambda sentence, refused: told.append((sentence, refused))
    panel.gui['Load a file ...'].use(File('a.yaml', content))
    assert panel.commands == []
    ((sentence, refused),) = told
    assert why in sentence
    assert refused


def test_every_control_of_the_panel_is_used(panel):
    used = {name for name, _ in (*ASKED, *FIELDS)} | {f'hold {way}' for way in DIRECTIONS}
    used |= {'take control over', 'fault', 'at', 'value', 'cycles', 'lasts s', 'Inject the fault'}
    assert set(panel.gui.things) == used


# the oscilloscope


SCOPE = {
    ('channels', 'axis2.speed'): {'channels': 'axis2.speed'},
    ('mode', 'normal'): {'mode': 'normal'},
    ('trigger', 'program'): {'trigger': 'program'},
    ('of channel', 'axis2.speed'): {'source': 'axis2.speed'},
    ('level', 2.5): {'level': 2.5},
    ('edge', 'falling'): {'edge': 'falling'},
    ('pre-trigger s', 0.01): {'pre_trigger_s': 0.01},
    ('duration s', 0.25): {'duration_s': 0.25},
    ('rate Hz', 8000.0): {'rate_hz': 8000.0},
}


@pytest.fixture
def scope():
    gui, commands = Gui(), []
    ScopePanel(gui, commands.append, DRIVES)
    return SimpleNamespace(gui=gui, commands=commands)


def recorded(scope):
    scope.gui['Record'].use()
    assert scope.commands[-1].action == 'scope'
    return json.loads(scope.commands[-1].text)


@pytest.mark.parametrize('field', SCOPE, ids=lambda field: field[0])
def test_each_field_of_the_oscilloscope_affects_only_its_own_setting(field, scope):
    before = recorded(scope)
    name, value = field
    assert not scope.gui[name].options or value in scope.gui[name].options
    scope.gui[name].use(value)
    after = recorded(scope)
    assert list({key: own for key, own in after.items() if own != before[key]}.values()) == list(
        SCOPE[field].values()
    )


def test_the_channel_that_is_added_is_that_of_the_drive_and_the_list(scope, robot):
    scope.gui['drive'].use('axis3')
    scope.gui['channel'].use('current_reference')
    before = scope.gui['channels'].value
    scope.gui['Add this channel'].use()
    assert scope.gui['channels'].value == f'{before}, axis3.current_reference'
    assert len(setting_of(json.dumps(recorded(scope)), robot).channels) == len(before.split(',')) + 1


def test_button_ends_a_recording_and_every_control_of_the_oscilloscope_is_used(scope):
    scope.gui['End recording'].use()
    assert scope.commands == [UiCommand('end_scope')]
    buttons = {'drive', 'channel', 'Add this channel', 'Record', 'End recording'}
    assert set(scope.gui.things) == {name for name, _ in SCOPE} | buttons


# playing a recording


@pytest.fixture
def player():
    """Return a player of a hundred cycles, half a cycle after the tenth, and its gui."""
    page = MagicMock()
    page.server.gui = Gui()
    times = 0.002 * np.arange(100.0)
    film = MagicMock(time_s=times, things=())
    film.row.side_effect = lambda time_s: int(np.clip(np.searchsorted(times, time_s + 1e-9) - 1, 0, 99))
    made = Player(page, film)
    page.show.side_effect = lambda _: made.stop()
    made.clock.seek(float(times[10]))
    return made, page.server.gui


def pressed(player, name, value):
    made, gui = player
    made.clock.playing = value != 'Play'
    gui[name].use(value)
    made.run()  # one picture
    return made.clock


@pytest.mark.parametrize(
    ('word', 'time_s', 'playing'),
    [('Pause', 0.020, False), ('+1', 0.022, False), ('-1', 0.018, False), ('Begin', 0.0, False)],
)
def test_each_button_of_a_player_selects_its_position(word, time_s, playing, player, monkeypatch):
    monkeypatch.setattr(playback.Clock, 'advance', lambda *_: None)
    clock = pressed(player, 'play', word)
    assert clock.time_s == pytest.approx(time_s, abs=1e-9)
    assert clock.playing is playing


@pytest.mark.parametrize('word', playback.WORDS)
def test_a_player_plays_at_the_speed_that_is_chosen(word, player):
    clock = pressed(player, 'speed', word)
    assert clock.speed == float(word)
    assert clock.playing


def test_player_repeats_unless_disabled(player):
    assert player[0].clock.again
    assert not pressed(player, 'repeat', False).again


def test_play_starts_and_every_control_of_a_player_is_used(player):
    assert pressed(player, 'play', 'Play').playing
    assert set(player[1].things) == {'time s', 'play', 'speed', 'repeat'}


def test_slider_of_a_player_selects_its_time(player):
    clock = pressed(player, 'time s', 0.05)
    assert clock.time_s == pytest.approx(0.05, abs=1e-9)
    assert not clock.playing
