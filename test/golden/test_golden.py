"""Golden figures of whole runs: the simulator is exact to the bit, and so are its figures (golden/make.py)."""

import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import pages

GOLDEN = Path(__file__).resolve().parent
SAME = 2e-9  # relative: the figures have nine digits
# Elsewhere a sine may be rounded otherwise and an encoder read one increment more: that moves currents by a thousandth
ELSEWHERE = 5e-3
# of what is zero but for rounding, by axis and signal: positions [m, rad], currents [A], torques [N m]
NOTHING = 1e-9
NOTHING_ELSEWHERE = 1e-3
# the loops of a motor that stands hunt for an increment of its encoder: four of them in a bus cycle are 0.05 rad/s
HUNTING = {'motor_speed': 0.05, 'shaft_speed': 0.05, 'coupling_torque': 0.1}
HUNTING |= dict.fromkeys(('current', 'current_mean', 'current_rms', 'current_min', 'current_max'), 0.02)

SPEC = importlib.util.spec_from_file_location('golden_make', GOLDEN / 'make.py')
make = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(make)
DOCUMENT = json.loads((GOLDEN / 'figures.json').read_text(encoding='utf-8'))


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    """Return what the command writes that makes the figures anew, in a copy of this folder."""
    root = tmp_path_factory.mktemp('sources')
    copy = root / 'test' / 'golden'
    copy.mkdir(parents=True)
    shutil.copy2(GOLDEN / 'make.py', copy)
    program, *arguments = make.COMMAND.split()
    assert program == 'python'
    subprocess.run([sys.executable, *arguments], cwd=root, check=True)
    return json.loads((copy / 'figures.json').read_text(encoding='utf-8'))


def test_the_file_holds_every_case_and_says_how_it_came_about(made):
    assert DOCUMENT['command'] == made['command'] == make.COMMAND
    assert DOCUMENT['cases'].keys() == made['cases'].keys() == make.CASES.keys()


def test_the_page_for_those_who_carry_on_names_the_command():
    (block,) = (
        block
        for block in pages.blocks(pages.SOURCE / 'CONTRIBUTING.md')
        if __file__.endswith(block.words or '-')
    )
    assert block.text.strip() == make.COMMAND


@pytest.mark.parametrize('name', make.CASES)
def test_a_run_has_its_golden_figures(name, made):
    here = DOCUMENT['maker'] == make.maker()
    relative, nothing = (SAME, NOTHING) if here else (ELSEWHERE, NOTHING_ELSEWHERE)
    wanted, found = DOCUMENT['cases'][name], made['cases'][name]
    assert found.keys() == wanted.keys()
    for key in ('cycles', 'end_cycle', 'stopped', 'lost_telegrams'):
        assert found[key] == wanted[key], key
    if here:
        assert found['sha256'] == wanted['sha256']
        assert found['sha256_of_samples'] == wanted['sha256_of_samples']
    for group in ('figures', 'rms', 'last'):
        assert found[group].keys() == wanted[group].keys()
        for key, values in wanted[group].items():
            least = nothing if here or group != 'last' else HUNTING.get(key, nothing)
            assert found[group][key] == pytest.approx(values, rel=relative, abs=least), f'{group} {key}'


def test_the_runs_that_are_stopped_tell_why_and_when():
    stopped = {name: case['stopped'] for name, case in DOCUMENT['cases'].items() if case['stopped']}
    start = 120
    assert stopped['emergency stop'] == f'emergency stop in bus cycle {start + 200}'
    assert stopped['encoder lost'].startswith(f'axis2 reports a fault in bus cycle {start + 200}')
    assert stopped['MDT lost until the drive stops'].startswith(
        f'axis1 reports a fault in bus cycle {start + 201}'
    )
    assert stopped.keys() == {
        'emergency stop',
        'encoder lost',
        'MDT lost until the drive stops',
        'AT late until the master stops',
        'winding shorted',
        'DC link sags, built robot',
    }
    assert DOCUMENT['cases']['telegrams lost']['lost_telegrams'] == 2
