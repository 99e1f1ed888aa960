"""Tests of script files: required content, errors, and ``delta3 simulate`` of them."""

import json
import re
import sys

import numpy as np
import pytest

from delta3_pacdrive import scripting
from delta3_pacdrive.errors import Code, ProgramError, ScriptError
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.scripting import script

PICK = """
from places import PICK

def main(robot):
    robot.wait_input('part', timeout_s=1.0)
    robot.move_l(to_mm=PICK)
    robot.output('gripper', True)
"""
PLACES = 'PICK = [100, 0, -800]\n'
CELL = 'name: own\ninputs:\n  part: {changes: [{after_s: 0.4, value: true}]}\n'


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder with a script, its imports and inputs, which is the working directory of the test."""
    for name, text in (('pick.py', PICK), ('places.py', PLACES), ('cell.yaml', CELL)):
        (tmp_path / name).write_text(text, encoding='utf-8')
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, 'places', raising=False)
    return tmp_path


def run(folder, robot, text, **options):
    """Run a script; return its error."""
    (folder / 'own.py').write_text(text, encoding='utf-8')
    with pytest.raises(ScriptError) as caught, scripting.simulate(robot, **options) as called:
        script.load('own.py').run(called)
    return caught.value


def test_script_runs_with_modules_of_its_folder(folder, robot):
    path = list(sys.path)
    with scripting.simulate(robot, cell='cell.yaml', name='pick') as called:
        script.load('pick.py').run(called)
    assert called.trace.meta['program'] == 'pick'
    assert called.trace.meta['planned_end_m'] == pytest.approx([0.1, 0.0, -0.8])
    assert sys.path == path
    assert not list(folder.glob('__pycache__/pick*'))


WRONG_FILES = {
    'no_main.py': (
        'raise SystemExit("it has run")',
        ProgramError,
        r'script no_main.py has no function main\(robot\)',
    ),
    'two.py': ('def main(robot, other): pass', ProgramError, 'main must take the robot and nothing else'),
    'none.py': ('def main(): pass', ProgramError, 'main must take the robot and nothing else'),
    'later.py': ('async def main(robot): pass', ProgramError, 'without async and yield'),
    'yields.py': ('def main(robot):\n    yield', ProgramError, 'without async and yield'),
    'broken.py': ('def main(robot)\n    pass', ScriptError, r"broken.py:1: expected ':'"),
    'dies.py': ('main = print\n\n1 / 0', ScriptError, r'dies.py:3: ZeroDivisionError: division by zero'),
    'imports.py': ('from nobody_has_this import main', ScriptError, 'imports.py:1: ModuleNotFoundError'),
    'leaves.py': ('from sys import exit as main\nmain(2)', ScriptError, 'leaves.py:2: ended with 2'),
}


@pytest.mark.parametrize('name', WRONG_FILES)
def test_file_without_a_script_is_rejected(folder, name):
    text, kind, sentence = WRONG_FILES[name]
    (folder / name).write_text(text, encoding='utf-8')
    with pytest.raises(kind, match=sentence):
        script.load(name)


def test_a_script_that_is_not_there_is_rejected(folder):
    with pytest.raises(ProgramError, match=r'script nobody\.py does not exist'):
        script.load('nobody.py')


def test_error_in_a_script_gives_one_message_with_its_line(folder, robot):
    error = run(folder, robot, 'def main(robot):\n    helper()\n\ndef helper():\n    {}["part"]\n')
    assert (str(error), error.code) == ("own.py:5: KeyError: 'part'", Code.CONTENT)
    error = run(folder, robot, 'def main(robot):\n    robot.move_l(to_mm=1)\n')
    assert re.match(r'own\.py:2: move_l: to_mm|own\.py:2: move_l\.to_mm', str(error))


def test_a_script_may_end_early(folder, robot):
    (folder / 'own.py').write_text('import sys\ndef main(robot):\n    robot.wait_time(0.1)\n    sys.exit()\n')
    with scripting.simulate(robot) as called:
        script.load('own.py').run(called)
    assert called.trace.meta['stopped'] == ''


def test_simulate_runs_a_script(folder, shell):
    done = shell('delta3 simulate pick.py --cell ./cell.yaml --json --trace run.npz')
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert (result['ok'], result['program']) == (True, 'pick')
    assert result['end_error_m'] < 1e-5
    trace = trace_file.load('run.npz')
    assert trace.meta['outputs'][0]['name'] == 'gripper'
    begin = np.flatnonzero(np.abs(np.diff(trace['tcp_command'], axis=0)).max(axis=1))[0]
    assert begin == trace.meta['start_cycle'] == 102 + 400 + 18


def test_simulate_reports_an_error_in_one_message_and_keeps_the_trace(folder, shell):
    (folder / 'cell.yaml').write_text('name: own\ninputs: {part: {changes: [{after_s: 9, value: true}]}}\n')
    done = shell('delta3 simulate pick.py --cell ./cell.yaml --trace run.npz')
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == (
        "error: pick.py:5: wait_input: 'part' was not on within 1 s; at rest after 1.102 s of bus time"
    )
    assert 'wait_input' in trace_file.load('run.npz').meta['stopped']


REFUSED = {
    'pick.py --learned torques.npz': '--learned requires a program: the path of a script is not known in advance',
    'pick.py --one-motor': '--one-motor requires a program, not a script',
}


@pytest.mark.parametrize('arguments', REFUSED)
def test_options_that_a_script_does_not_obey_are_rejected_by_name(folder, shell, arguments):
    done = shell(f'delta3 simulate {arguments}')
    assert done.returncode == 2
    assert REFUSED[arguments] in done.stderr


def test_simulating_script_is_named_like_its_file():
    with scripting.simulate() as robot:
        robot.wait_time(0.01)
    assert robot.trace.meta['program'] == 'test_script'


def test_stepping_asks_before_each_move_of_a_robot_at_rest():
    asked = []
    with scripting.simulate() as robot:
        robot.step_by_step(
            lambda place, kind: asked.append((place.line, kind, robot.state().motion, robot.position()))
        )
        robot.move_l(to_mm=[100, 0, -800], blend_mm=20)
        robot.output('gripper', True)
        robot.move_l(to_mm=[0, 0, -800])
    assert [(kind, str(motion)) for _, kind, motion, _ in asked] == [('move_l', 'idle'), ('move_l', 'moving')]
    assert asked[1][0] == asked[0][0] + 2
    assert asked[1][3] == pytest.approx((0.1, 0.0, -0.8), abs=1e-4)


def test_step_mode_asks_before_a_turn_of_the_tool_too():
    asked = []
    with scripting.simulate(parameters='rotary') as robot:
        robot.step_by_step(lambda place, kind: asked.append(kind))
        robot.move_l(to_mm=[50, 0, -800])
        robot.turn(to_deg=30)
    assert asked == ['move_l', 'turn']


@pytest.mark.parametrize(
    'text',
    [
        'def other(robot): pass\nmain = other',
        'if True:\n    def main(robot): pass',
        'from own_parts import x as main\nmain = print',
        'from own_main import *',
    ],
)
def test_function_main_may_be_imported_from_anywhere(folder, text):
    (folder / 'own_parts.py').write_text('x = 1')
    (folder / 'own_main.py').write_text('def main(robot): pass')
    (folder / 'other.py').write_text(text)
    assert callable(script.load('other.py').main)
