"""Golden figures of whole runs: the simulator is exact to the bit, and so are its figures (golden/make.py)."""

import copy
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import warnings
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
    """Return the files that the generating command writes in a copy of this folder."""
    root = tmp_path_factory.mktemp('sources')
    copy = root / 'test' / 'golden'
    copy.mkdir(parents=True)
    for name in ('make.py', 'maker.py'):
        shutil.copy2(GOLDEN / name, copy)
    program, *arguments = make.COMMAND.split()
    assert program == 'python'
    subprocess.run([sys.executable, *arguments], cwd=root, check=True)
    return json.loads((copy / 'figures.json').read_text(encoding='utf-8'))


def test_file_has_every_case_and_its_origin(made):
    assert DOCUMENT['command'] == made['command'] == make.COMMAND
    assert DOCUMENT['cases'].keys() == made['cases'].keys() == make.CASES.keys()


def test_developers_page_names_the_command():
    (block,) = (
        block
        for block in pages.blocks(pages.SOURCE / 'CONTRIBUTING.md')
        if __file__.endswith(block.words or '-')
    )
    assert block.text.strip() == make.COMMAND


def compare(wanted, found, *, same_maker):
    """Compare a run with its golden figures; return the signals with other bits but equal rounded figures.

    Where the bits have to be the same, a signal with other bits raises AssertionError, too.
    """
    assert found.keys() == wanted.keys()
    for key in ('cycles', 'end_cycle', 'stopped', 'lost_telegrams'):
        assert found[key] == wanted[key], key
    assert (
        found['digests'].keys() == wanted['digests'].keys() == wanted['rms'].keys() == wanted['last'].keys()
    )
    other = [key for key, digest in wanted['digests'].items() if found['digests'][key] != digest]
    assert not (same_maker and other), f'other bits on the machine of the golden figures: {", ".join(other)}'
    for key in ('sha256', 'sha256_of_samples'):
        assert other or found[key] == wanted[key], key
    for group in ('figures', 'rms', 'last'):
        assert found[group].keys() == wanted[group].keys()
        for key, values in wanted[group].items():
            exact = not other or (key in wanted['digests'] and key not in other)
            relative, nothing = (SAME, NOTHING) if exact else (ELSEWHERE, NOTHING_ELSEWHERE)
            least = nothing if exact or group != 'last' else HUNTING.get(key, nothing)
            assert found[group][key] == pytest.approx(values, rel=relative, abs=least), f'{group} {key}'
    return other


def report(name, other, *, ci):
    """Warn of signals that only their rounded figures were compared of; raise AssertionError in CI."""
    if other:
        text = (
            f'{name}: other bits than in the golden runs; only rms and last value of these signals were '
            f'compared, to {ELSEWHERE:.1%}: {", ".join(other)}'
        )
        assert not ci, f'{text}. In CI every digest has to be equal: see CONTRIBUTING.md, "Golden digests"'
        warnings.warn(text, stacklevel=2)


@pytest.mark.parametrize('name', make.CASES)
def test_a_run_has_its_golden_figures(name, made):
    same_maker = DOCUMENT['maker'] == made['maker']
    other = compare(DOCUMENT['cases'][name], made['cases'][name], same_maker=same_maker)
    report(name, other, ci=os.environ.get('CI', '') not in ('', '0', 'false'))


@pytest.mark.parametrize('key', ['current', 'tcp_command'])
def test_a_signal_with_other_bits_is_named_and_fails_on_the_same_machine_and_in_ci(key):
    name = 'experiment 1'
    wanted = DOCUMENT['cases'][name]
    found = copy.deepcopy(wanted)
    assert compare(wanted, found, same_maker=False) == []
    found['digests'][key] = found['sha256'] = '0'
    found['rms'][key] = [value * (1.0 + ELSEWHERE / 2.0) for value in found['rms'][key]]
    with pytest.raises(AssertionError, match=key):
        compare(wanted, found, same_maker=True)
    assert compare(wanted, found, same_maker=False) == [key]
    with pytest.warns(UserWarning, match=f'{name}.*: {key}$'):
        report(name, [key], ci=False)
    with pytest.raises(AssertionError, match=key):
        report(name, [key], ci=True)


@pytest.mark.parametrize('group', ['rms', 'last', 'figures'])
def test_figures_that_differ_fail_on_every_machine(group):
    wanted = DOCUMENT['cases']['experiment 1']
    key = next(key for key, values in wanted[group].items() if values[0])
    for digests, change in (
        (wanted['digests'], 1e-6),
        (dict.fromkeys(wanted['digests'], '0'), 2 * ELSEWHERE),
    ):
        found = copy.deepcopy(wanted) | {'digests': digests}
        found[group][key][0] = found[group][key][0] * (1.0 + change) + change
        with pytest.raises(AssertionError, match=f'{group} {key}'):
            compare(wanted, found, same_maker=False)


def test_stopped_runs_report_reason_and_time():
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
