"""Tests of the table of a robot on two hosts; ``test/system/test_two_hosts.py`` tests the hosts."""

import io
import json
from types import SimpleNamespace

import pytest

from delta3_pacdrive.benchmarks import network, two_hosts
from delta3_pacdrive.cli import bench
from delta3_pacdrive.errors import RunError

RUN = {
    'fault': '', 'cycles': 2000, 'overruns': 30, 'slip_s': 0.25, 'lost_telegrams': 1, 'repeated_telegrams': 0,
    'bus_time_s': 2.0, 'wall_time_s': 2.5,
}  # fmt: skip


def operator(*lines):
    return SimpleNamespace(stdin=io.StringIO(), stdout=io.StringIO('\n'.join(lines)))


class Link:
    """Records the requested properties of the link."""

    def __init__(self):
        self.told = []

    def set(self, conditions):
        self.told.append(conditions)


def test_link_follows_the_case_during_motion_and_is_good_on_return(monkeypatch):
    monkeypatch.setattr(network, 'time', SimpleNamespace(sleep=lambda _: None))
    lines = [json.dumps(one) for one in ({'moving': True}, RUN, {'back_s': 1.5})]
    link, case = Link(), network.Case(two_hosts.Conditions(1e-3), 0.1)
    found = network.drive_over(operator(*lines), link, case, 'a/program.yaml')
    assert found == RUN | {'back_s': 1.5}
    assert link.told == [
        case.conditions, two_hosts.Conditions(down=True), case.conditions, two_hosts.Conditions(),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ('lines', 'sentence'),
    [([], 'without a message'), (['{"error": "no robot within 120 s"}'], 'no robot within 120 s')],
)
def test_ended_operator_is_reported(lines, sentence):
    with pytest.raises(RunError, match=f'the operator of the robot has ended: {sentence}'):
        network.next_line(operator(*lines), 'ready')


def test_the_command_prints_a_line_for_each_link(monkeypatch, capsys):
    fault = 'no AT of axis3 for 2.2 s in bus cycle 3353 (8506)'
    cases = {'no delay': RUN | {'back_s': 0.0}, 'gone for 10 s': RUN | {'fault': fault, 'back_s': 14.5}}
    asked = []

    def measure(names, seconds, show):
        asked.append((names, seconds))
        return {'seconds': seconds, 'cases': cases}

    monkeypatch.setattr(network, 'measure', measure)
    assert bench.main(['network', '--link', 'no delay', '--link', 'gone for 10 s']) == 0
    assert asked == [(['no delay', 'gone for 10 s'], bench.NETWORK_SECONDS)]
    _, head, first, second = capsys.readouterr().out.splitlines()
    assert head.split() == ['link', 'overruns', 'slip', 'lost', 'bus', '/', 'wall', 'back', 'in', 'fault']
    assert first.split()[2:] == ['30', '1.50%', '0.250', 's', '1', '0.800', '0.0', 's', 'none']
    assert second.endswith(f'14.5 s  {fault}')


def test_a_link_that_there_is_not_is_rejected_by_name(capsys):
    with pytest.raises(SystemExit):
        bench.main(['network', '--link', 'string'])
    assert "invalid choice: 'string'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ('patched', 'value', 'sentence'),
    [
        ('IP', '', 'the program ip is not installed'),
        ('TUN', two_hosts.Path('/nowhere'), '/nowhere is not available'),
    ],
)
def test_impossible_two_host_set_up_is_reported(patched, value, sentence, monkeypatch, capsys):
    monkeypatch.setattr(two_hosts.os, 'geteuid', lambda: 0)
    monkeypatch.setattr(two_hosts, 'IP', '/bin/true')
    monkeypatch.setattr(two_hosts, patched, value)
    assert bench.main(['network']) == 1
    assert capsys.readouterr().err == f'error: two hosts are not possible on this machine: {sentence}\n'
