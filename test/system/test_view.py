"""Tests of ``delta3 view`` with a running robot: user actions on the page reach the robot."""

import ipaddress
import json
import os
import re
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from browser import Visit
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.ros.wire import discovery
from delta3_pacdrive.view.jog import JOG_LIMITS
from thoroughness import some

pytest.importorskip('viser', reason='the page needs the extra "view"')

Runner = Callable[..., subprocess.CompletedProcess[str]]
WAIT_S = 180.0  # a browser without a graphics card, on a machine that has other things to do
SLOW = ('--single-process', '--no-realtime', '--real-time-factor', '0.3')
JERK_OVER_S = 0.02
CELL = """
name: one supply
cup: {output: gripper, diameter_mm: 40, vacuum_pa: 60000, build_up_s: 0.01}
parts: {carton: {mass_kg: 0.2, size_mm: [80, 60, 20], friction: 0.5}}
supplies: {infeed: {part: carton, at_mm: [-150, 0, -870]}}
inputs: {start: {changes: []}}
"""


def wait_for(condition: Callable[[], Any], what: str) -> Any:
    deadline = time.monotonic() + WAIT_S
    while not (found := condition()):
        assert time.monotonic() < deadline, f'not within {WAIT_S:g} s: {what}'
        time.sleep(0.1)
    return found


def ready(process: subprocess.Popen[str]) -> None:
    line = process.stderr.readline()
    while line and not line.startswith('controller: '):  # the last line of a robot that comes up
        line = process.stderr.readline()
    assert line, 'the robot did not come up'


def served(url: str) -> bool:
    host, _, port = url.removeprefix('http://').partition(':')
    with socket.socket() as trial:
        return trial.connect_ex((host, int(port))) == 0


def ended(process: subprocess.Popen[str]) -> tuple[int, str]:
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=WAIT_S)
    return process.returncode, errors


@pytest.fixture
def robot(start_delta3: Any, nothing_left_behind: None) -> Iterator[subprocess.Popen[str]]:
    process = start_delta3('up', *SLOW)
    ready(process)
    yield process
    assert ended(process)[0] == 0


@pytest.fixture
def url(robot: subprocess.Popen[str], start_delta3: Any) -> Iterator[str]:
    """Give the address of the page of a robot."""
    process = start_delta3('view')
    found = re.search(r'http\S+', line := process.stderr.readline())
    assert found, line
    yield found[0]
    status, errors = ended(process)
    assert not errors, errors
    assert status == 0


def state_of(delta3: Runner) -> dict[str, Any]:
    return json.loads(delta3('move', 'state', '--json').stdout)


def press(visit: Visit, name: str) -> None:
    visit.page.get_by_role('button', name=name, exact=True).click()


@pytest.mark.long
def test_clicks_on_the_page_control_the_robot(url: str, browser: Any, delta3: Runner) -> None:
    with Visit(browser, url) as visit:
        visit.page.get_by_text('idle', exact=True).first.wait_for()
        assert delta3('move', 'l', '0.3', '0', '-0.8', '--speed', '0.01', '--detach').returncode == 0
        visit.page.get_by_text('moving', exact=True).first.wait_for()
        press(visit, 'Hold')
        wait_for(lambda: state_of(delta3)['state'] == 'stopped', 'the robot has stopped on its path')
        visit.page.get_by_text('stopped', exact=True).first.wait_for()
        held = state_of(delta3)
        assert held['moves'] == 1
        press(visit, 'Resume')
        wait_for(lambda: state_of(delta3)['state'] == 'moving', 'the robot goes on')
        assert 'delta3 view' in state_of(delta3)['operator']
        press(visit, 'Abort')
        wait_for(lambda: state_of(delta3)['state'] == 'idle', 'the program is aborted')
        wait_for(lambda: not state_of(delta3)['operator'], 'control is given back')
        press(visit, 'Start')  # there is nothing to start
        visit.page.get_by_text('Refused').first.wait_for()


def jerk_m_s3(bag: Path) -> np.ndarray:
    """Return the jerk of the TCP command in a recording, over times that the grid of increments does not spoil."""
    trace = trace_file.load(bag)
    steps = round(JERK_OVER_S / trace.meta['cycle_time_s'])
    p = trace['tcp_command']
    third = p[3 * steps :] - 3.0 * p[2 * steps : -steps] + 3.0 * p[steps : -2 * steps] - p[: -3 * steps]
    return np.linalg.norm(third, axis=1) / JERK_OVER_S**3


@pytest.mark.long
def test_jog_stops_softly_on_release_of_the_button_and_on_loss_of_the_page(
    start_delta3: Any, nothing_left_behind: None, browser: Any, delta3: Runner, tmp_path: Path
) -> None:
    robot = start_delta3('up', *SLOW, '--bag', str(tmp_path / 'bag'))
    ready(robot)
    view = start_delta3('view')
    found = re.search(r'http\S+', view.stderr.readline())
    assert found
    with Visit(browser, found[0]) as visit:
        visit.page.get_by_text('idle', exact=True).first.wait_for()
        visit.page.get_by_role('tab', name='Jog').click()
        visit.page.get_by_role('button', name='hold +x').hover()
        visit.page.mouse.down()
        wait_for(lambda: state_of(delta3)['state'] == 'steered', 'the robot moves')
        visit.page.mouse.up()
        wait_for(lambda: state_of(delta3)['state'] == 'idle', 'the robot stands')
        first = state_of(delta3)
        assert 0.0 < first['tcp_m'][0] < 0.4
        assert first['tcp_m'][1:] == pytest.approx([0.0, -0.75], abs=1e-3)
        assert first['fault'] == ''
        visit.page.mouse.down()
        wait_for(lambda: state_of(delta3)['state'] == 'steered', 'the robot moves again')
    # the page is closed with the button held
    wait_for(lambda: state_of(delta3)['state'] == 'idle', 'the robot stands')
    assert first['tcp_m'][0] < state_of(delta3)['tcp_m'][0] < 0.5
    assert ended(view) == (0, '')
    assert ended(robot)[0] == 0
    jerks = jerk_m_s3(tmp_path / 'bag')
    assert 1.0 < jerks.max() < 1.01 * JOG_LIMITS['jerk_m_s3']


@pytest.mark.long
def test_page_continues_with_a_restarted_robot(
    start_delta3: Any, nothing_left_behind: None, browser: Any
) -> None:
    first = start_delta3('up', *SLOW)
    ready(first)
    view = start_delta3('view')
    found = re.search(r'http\S+', view.stderr.readline())
    assert found
    with Visit(browser, found[0]) as visit:
        visit.page.get_by_text('idle', exact=True).first.wait_for()
        assert ended(first)[0] == 0
        visit.page.get_by_text('no robot', exact=True).first.wait_for()
        second = start_delta3('up', *SLOW)
        ready(second)
        visit.page.get_by_text('idle', exact=True).first.wait_for()
    assert ended(view) == (0, '')
    assert ended(second)[0] == 0


@pytest.mark.long
def test_robot_and_page_start_together_and_the_robot_outlives_the_page(
    start_delta3: Any,
    nothing_left_behind: None,
    processes: Callable[[], list[str]],
    browser: Any,
    delta3: Runner,
) -> None:
    process = start_delta3('up', *SLOW, '--view')
    found = re.search(r'http\S+', process.stderr.readline())
    assert found
    ready(process)
    wait_for(lambda: served(found[0]), 'a page that is served')
    with Visit(browser, found[0], 390, 844) as visit:
        visit.page.get_by_text('idle', exact=True).first.wait_for(state='attached')
    (page,) = [line for line in processes() if ' view ' in line]
    subprocess.run(['kill', '-KILL', page.partition(':')[0]], check=True)
    assert 'the page has ended, the robot continues' in process.stderr.readline()
    assert state_of(delta3)['state'] == 'idle'
    assert ended(process)[0] == 0


def _children(process: subprocess.Popen[str]) -> dict[str, psutil.Process]:
    """Return the processes of a bring-up by name, with itself as ``up``."""
    own = psutil.Process(process.pid)
    return {child.name(): child for child in own.children(recursive=True)} | {'up': own}


EMPTY = dict.fromkeys((discovery.RANGE, discovery.PROFILE, discovery.LATER_PROFILE, discovery.PEERS), '')
LOCALHOST_ONLY = {discovery.LOCALHOST_ONLY: '1'}


@pytest.mark.parametrize(
    'variables', some([{}, EMPTY, LOCALHOST_ONLY, EMPTY | LOCALHOST_ONLY], [EMPTY | LOCALHOST_ONLY])
)
def test_no_socket_of_a_whole_robot_is_bound_beyond_this_machine_and_a_page_that_does_not_end_is_killed(
    variables: dict[str, str], start_delta3: Any, nothing_left_behind: None, tmp_path: Path
) -> None:
    clean = {name: value for name, value in os.environ.items() if name not in (*EMPTY, *LOCALHOST_ONLY)}
    command = ('up', *SLOW[1:], '--view', '--markers', '--bag', str(tmp_path / 'bag'))
    process = start_delta3(*command, env=clean | variables)
    found = re.search(r'http\S+', process.stderr.readline())
    assert found
    ready(process)
    wait_for(lambda: served(found[0]), 'a page that is served')
    children = _children(process)
    assert len(children) == 10
    wait_for(lambda: any(s.type == socket.SOCK_DGRAM for s in children['view'].net_connections()), 'its node')
    sockets = {
        name: [one for one in child.net_connections() if not one.raddr] for name, child in children.items()
    }
    assert min(map(len, sockets.values())) > 0  # all of them are in the domain
    assert [one for one in sockets['view'] if one.status == psutil.CONN_LISTEN]
    beyond = {
        (name, one.laddr.ip)
        for name, bound in sockets.items()
        for one in bound
        if not ipaddress.ip_address(one.laddr.ip).is_loopback
    }
    assert beyond == set()
    children['view'].suspend()  # neither SIGINT nor SIGTERM ends it
    status, errors = ended(process)
    assert (status, errors) == (0, 'note: view did not end, or left processes behind, and had to be killed\n')


def test_a_page_that_ignores_every_signal_does_not_outlive_the_run_that_has_started_it(
    start_delta3: Any, nothing_left_behind: None
) -> None:
    process = start_delta3('run', 'experiment1', '--view', '--no-realtime', '--real-time-factor', '0')
    found = re.search(r'http\S+', process.stderr.readline())
    assert found
    wait_for(lambda: 'view' in _children(process), 'the process of the page')
    _children(process)['view'].suspend()
    _, errors = process.communicate(timeout=WAIT_S)
    assert process.returncode == 0, errors
    assert errors.endswith('note: view did not end, or left processes behind, and had to be killed\n')


@pytest.mark.long
def test_page_without_a_robot_ends_with_one_message(delta3: Runner, nothing_left_behind: None) -> None:
    done = delta3('view', '--namespace', 'nobody')
    assert done.returncode == 1
    sentence = 'error: no robot is up in namespace /nobody (delta3 up)'
    assert done.stderr.splitlines()[-1] == sentence
    assert 'Traceback' not in done.stderr


@pytest.mark.long
def test_oscilloscope_of_the_page_shows_samples_and_other_users_of_a_drive(
    url: str, browser: Any, start_delta3: Any
) -> None:
    with Visit(browser, url, height=1000) as visit:
        visit.page.get_by_text('idle', exact=True).first.wait_for()
        visit.page.get_by_text('Oscilloscope', exact=True).click()
        press(visit, 'Record')
        visit.page.get_by_text('8000 samples of 2 channels at 16000 Hz').first.wait_for()
        other = start_delta3('scope', 'axis1.current', '--trigger', 'fault')
        assert other.stderr.readline() == 'waiting for a fault of a drive\n'
        press(visit, 'Record')
        visit.page.get_by_text('the oscilloscope of axis1 is in use by process').first.wait_for()
        status, errors = ended(other)
        assert 'while a fault of a drive was awaited' in errors
        assert status == 130
        press(visit, 'Record')
        # above the charts, and beside the fields instead of the refusal
        visit.page.get_by_text('8000 samples of 2 channels at 16000 Hz').nth(1).wait_for()


@pytest.mark.long
def test_an_input_that_is_set_on_the_page_is_set_without_control_of_the_robot(
    start_delta3: Any, nothing_left_behind: None, browser: Any, delta3: Runner, tmp_path: Path
) -> None:
    (tmp_path / 'cell.yaml').write_text(CELL)
    robot = start_delta3('up', *SLOW, '--cell', str(tmp_path / 'cell.yaml'))
    ready(robot)
    view = start_delta3('view')
    found = re.search(r'http\S+', view.stderr.readline())
    assert found

    def start() -> Any:
        return json.loads(delta3('io', 'start', '--json').stdout)['inputs']['start']

    with Visit(browser, found[0], height=1000) as visit:
        visit.page.get_by_role('tab', name='Inputs').click()
        press(visit, 'on')
        visit.page.get_by_text('start is on from bus cycle').first.wait_for()
        visit.page.get_by_text('on, set').first.wait_for()
        assert start() == {'value': True, 'forced': True}
        assert not state_of(delta3)['operator']  # it needs no control
        assert delta3('io', 'start', 'auto').returncode == 0
        visit.page.get_by_text('on, set').first.wait_for(state='detached')
        assert start() == {'value': False, 'forced': False}
        assert visit.page.get_by_text('payload').count() == 0
    assert ended(view) == (0, '')
    assert ended(robot)[0] == 0
