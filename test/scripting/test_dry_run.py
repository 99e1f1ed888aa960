"""Tests of ``delta3 plan`` of scripts: planned moves, without storage of the driven ones."""

import json

import pytest

from delta3_pacdrive import scripting
from delta3_pacdrive.cli import plan
from delta3_pacdrive.planning import arch, round_planner
from delta3_pacdrive.scripting import dry_run, script

PICK = """
def main(robot):
    robot.wait_input('part', timeout_s=1.0)
    robot.move_l(to_mm=[100, 0, -800], blend_mm=20)
    robot.wait_time(0.02)
    robot.move_l(to_mm=[0, 100, -800], speed_m_s=0.2)
    robot.dwell(0.25)
    robot.wait()
    robot.move_l(to_mm=[0, 100, -850], acceleration_m_s2=2.0)
"""
CELL = 'name: own\ninputs:\n  part: {changes: [{after_s: 0.4, value: true}]}\n'


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder with a script and its cell, which is the working directory of the test."""
    (tmp_path / 'pick.py').write_text(PICK, encoding='utf-8')
    (tmp_path / 'own.yaml').write_text(CELL, encoding='utf-8')
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_each_move_has_its_line_and_its_active_limit(folder, capsys):
    assert plan.main(['pick.py', '--cell', 'own.yaml', '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert [move['kind'] for move in found['moves']] == ['blended', 'dwell', 'line']
    names = [move['statements'] for move in found['moves']]
    assert names[0].startswith('4: move_l')
    assert names[0].endswith('6: move_l')
    assert names[1:] == ['7: dwell', '9: move_l']
    assert found['moves'][1]['time_s'] == pytest.approx(0.25, abs=2e-3)
    assert found['moves'][2]['acceleration_max_m_s2'] == pytest.approx(2.0, rel=0.01)
    assert found['moves'][2]['limited_by']['quantity'] in ('tcp_acceleration', 'tcp_jerk')
    last = found['moves'][2]
    assert found['time_s'] == pytest.approx(last['start_s'] + last['time_s'], abs=2e-3)
    assert 'own.yaml' in found['provenance']['inputs']
    assert 'pick.py' in found['provenance']['inputs']


def test_users_read_a_table(folder, capsys):
    assert plan.main(['pick.py', '--cell', 'own.yaml']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == 'pick: 3 moves'
    assert [lines[n].split()[0] for n in (4, 5)] == ['4:', '6:']  # statements of the first move
    assert lines[6].split()[:3] == ['2', '7:', 'dwell']
    assert 's of it between moves' in lines[8]


def test_aborted_script_reports_its_moves_and_the_reason(folder, capsys):
    (folder / 'own.py').write_text(
        'def main(robot):\n    robot.move_l(to_mm=[50, 0, -800])\n    robot.wait()\n    robot.wait_input("x")\n'
    )
    assert plan.main(['own.py']) == 1
    told = capsys.readouterr()
    assert told.out.splitlines()[0] == 'own: 1 move'
    assert told.err.strip() == "error: own.py:4: unknown input 'x', the inputs are: none"


def test_notes_name_the_line(folder, robot):
    (folder / 'own.py').write_text(
        'def main(robot):\n    robot.move_c(via_mm=[20, 20, -800], to_mm=[0, 40, -800], speed_m_s=3.0)\n'
    )
    found = dry_run.dry_run(script.load('own.py'), robot)
    assert any(notice.startswith('own.py:2: move_c is slowed down') for notice in found.notices)


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['pick.py', '--from', '2'], '--from is for a program'),
        (['pick.py', '--output', 'figures'], '--output requires a program'),
        (['pick.py', '--limits'], '--limits requires --json'),
    ],
)
def test_options_that_do_not_fit_are_rejected_by_name(folder, capsys, arguments, sentence):
    with pytest.raises(SystemExit) as left:
        plan.main(arguments)
    assert left.value.code == 2
    assert sentence in capsys.readouterr().err


def test_an_arch_that_is_driven_again_keeps_its_shape(monkeypatch):
    shaped = []

    def best_arch(room, cost, corners=False):
        shaped.append(room)
        return arch.best_arch(room, cost, corners)

    monkeypatch.setattr(round_planner, 'best_arch', best_arch)
    with scripting.simulate() as robot:
        for x_mm in (100, 0, 100, 0, 100):
            robot.arch(to_mm=[x_mm, 0, -750], up_mm=20, down_mm=20)
            robot.wait()
    assert len(shaped) == 3  # the first one begins where the encoders locate the robot
