"""Facts about the buttons of the page, without a browser: what they offer, and what they ask for."""

import json
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from delta3_pacdrive.sercos.configuration_check import ALL_DRIVES, DRIVES
from delta3_pacdrive.view.controls import Controls


@pytest.fixture
def panel():
    """Return controls of a robot without a rotary axis, what stands on them, and what was asked for."""
    gui, things, wishes = MagicMock(), {}, []

    def add_dropdown(name, options, **_):
        things[name] = MagicMock(options=options, value=options[0])
        return things[name]

    def add_button(name, **_):
        things[name] = MagicMock()
        return things[name]

    gui.add_dropdown.side_effect = add_dropdown
    gui.add_button.side_effect = add_button
    return SimpleNamespace(controls=Controls(gui, wishes.append, DRIVES), things=things, wishes=wishes)


def test_faults_are_offered_for_the_drives_that_the_robot_has(panel):
    kind, target = panel.things['fault'], panel.things['at']
    kind.value = 'overload'
    for drives in (DRIVES, ALL_DRIVES, DRIVES):
        panel.controls.use(drives)
        assert target.options == drives
    kind.value = 'kill'
    panel.controls.use(ALL_DRIVES)
    assert target.options == ('unit_robot', 'transformation_task', *DRIVES, 'plant', 'axis4')
    target.value = 'axis4'
    panel.things['Inject the fault'].on_click.call_args.args[0](None)
    assert json.loads(panel.wishes[-1].text) == {'fault': 'kill', 'node': 'axis4'}
