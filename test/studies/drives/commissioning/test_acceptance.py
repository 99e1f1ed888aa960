"""Tests of the acceptance protocol: every value with its limit, verdicts, and names that contain HTML."""

import contextlib
import json
from dataclasses import replace

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.robot.drive.operation_data import OF_PARAMETER
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.studies.drives.commissioning import acceptance
from delta3_pacdrive.studies.drives.commissioning.acceptance import Settings, Study
from delta3_pacdrive.studies.drives.commissioning.run import BEFORE, measure, with_actual_gains
from delta3_pacdrive.studies.framework.study import silent
from simulated_commissioning import AcceptedRobot

ROBOT = parameters.load()
HOSTILE = '<script>alert(1)</script>'


@pytest.fixture(scope='module')
def measured():
    robot = AcceptedRobot(ROBOT)
    return measure(robot, with_actual_gains(robot), silent)


@pytest.fixture
def accept(measured, monkeypatch, tmp_path):
    """Return a function that accepts a robot with given results and settings, without measuring it again."""
    monkeypatch.setattr(acceptance, 'measure', lambda *_: measured)

    def run(robot=None, **settings):
        robot = robot or AcceptedRobot(ROBOT)
        chosen = Settings(ROBOT, None, **settings)
        study = Study(chosen, tmp_path, f'delta3 {HOSTILE}', silent, lambda: contextlib.nullcontext(robot))
        return study.run()

    return run


def failed(document):
    return [one['name'] for one in document['checks'] if not one['passed']]


def test_robot_as_described_is_accepted_with_every_value_and_limit(accept, tmp_path):
    document = accept()
    assert document['passed']
    assert failed(document) == []
    groups = [one['group'] for one in document['checks']]
    assert groups.count('parameters') == len(DRIVES) * len(OF_PARAMETER)
    assert set(groups) == {'parameters', 'loops', 'mechanics', 'program', 'rest', 'drives', 'bus'}
    assert all(one['limit'] and one['value'] is not None for one in document['checks'])
    assert json.loads((tmp_path / 'report.json').read_text())['checks'] == document['checks']
    page = (tmp_path / 'index.html').read_text()
    assert 'ACCEPTED: ' in page
    assert page.count('<img') == 3
    assert 'delta3_pacdrive' in page  # versions


@pytest.mark.parametrize(
    ('results', 'settings', 'names'),
    [
        ({'tcp_error_m': 1.0001e-3}, {}, ['TCP error']),
        ({'tcp_error_m': 1e-3}, {}, []),  # the limit itself
        ({'moved_rad': -0.021}, {}, ['axis1 motion under its brake']),
        ({'lost': 1.0}, {}, ['lost telegrams']),
        ({'temperature_degc': 150.0}, {}, [f'{axis} motor temperature S-0-0383' for axis in DRIVES]),
        ({}, {'gain_margin_db': 15.0}, [f'{axis} gain margin' for axis in DRIVES]),
        ({}, {'phase_margin_deg': 80.0}, [f'{axis} phase margin' for axis in DRIVES]),
    ],
)
def test_value_beyond_its_limit_fails_alone(results, settings, names, accept):
    document = accept(AcceptedRobot(ROBOT, **results), **settings)
    assert failed(document) == names
    assert document['passed'] is not bool(names)


def test_parameter_that_differs_from_the_file_is_named_with_its_drive(accept, tmp_path):
    robot = AcceptedRobot(ROBOT)
    for axis in DRIVES:
        robot.write(axis, 'P-0-0042', 4.0)
    document = accept(robot)
    assert failed(document) == [f'{axis} P-0-0042 Overload time of the I2t monitoring' for axis in DRIVES]
    page = (tmp_path / 'index.html').read_text()
    assert 'NOT ACCEPTED: 3 of ' in page


def test_names_that_contain_html_are_escaped(accept, tmp_path):
    accept(program=HOSTILE)
    page = (tmp_path / 'index.html').read_text()
    assert HOSTILE not in page
    assert '&lt;script&gt;alert(1)' in page


def test_margin_outside_the_measured_band_is_not_accepted(accept, measured, monkeypatch):
    found, mechanics = measured
    unknown = [replace(one, gain_margin_db=None) for one in found.margins]
    monkeypatch.setattr(acceptance, 'measure', lambda *_: (replace(found, margins=unknown), mechanics))
    assert failed(accept()) == [f'{axis} gain margin' for axis in DRIVES]
    assert BEFORE == 'before'
