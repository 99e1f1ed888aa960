"""Tests of rejected actions of scripts: each rejection has a code, a message, file and line."""

import re

import pytest

from delta3_pacdrive import scripting
from delta3_pacdrive.errors import Code, ProgramError, RunError
from delta3_pacdrive.scripting.robot import CALLS_MAX

MOVE = {'to_mm': [100, 0, -800]}
WRONG = {
    'a key that nobody knows': (
        lambda robot: robot.move_l(to_mmm=[1, 2, 3]),
        Code.CONTENT,
        r"move_l: unknown key 'to_mmm', .*did you mean to_m\?",
    ),
    'a point without a unit': (
        lambda robot: robot.move_l([0, 0, -800]),
        Code.CONTENT,
        r'move_l: \[0, 0, -800\] has no unit: name it, to_m=... in metres or to_mm=... in millimetres',
    ),
    'points of a spline without a unit': (
        lambda robot: robot.move_sb([[0, 0, -800]]),
        Code.CONTENT,
        'through_mm=... in millimetres',
    ),
    'a key that is missing': (
        lambda robot: robot.move_c(to_m=[0, 0, -0.8]),
        Code.CONTENT,
        'move_c: missing key via_m',
    ),
    'metres for millimetres': (
        lambda robot: robot.move_l(to_m=[100, 0, -800]),
        Code.CONTENT,
        'are these millimetres',
    ),
    'an output that is none': (
        lambda robot: robot.output('griper', True),
        Code.CONTENT,
        'did you mean gripper',
    ),
    'a number for a value': (lambda robot: robot.output('gripper', 1), Code.CONTENT, 'must be true or false'),
    'a negative rest': (lambda robot: robot.dwell(-1.0), Code.CONTENT, 'must be positive'),
    'an input that is none': (
        lambda robot: robot.wait_input('parts'),
        Code.CONTENT,
        "unknown input 'parts', the inputs are: part: did you mean part",
    ),
    'an input that is asked for by no name': (lambda robot: robot.input(3), Code.CONTENT, 'unknown input 3'),
    'a value that is none': (
        lambda robot: robot.wait_input('part', 'on'),
        Code.CONTENT,
        'must be True or False',
    ),
    'a wait for ever': (lambda robot: robot.wait_time(1e9), Code.CONTENT, 'must be between 0 and 3600'),
    'a wait for no number': (lambda robot: robot.wait_until('soon'), Code.CONTENT, 'must be a number'),
    'a wait for nan': (
        lambda robot: robot.wait(left_s=float('nan')),
        Code.CONTENT,
        'must be between 0 and 3600',
    ),
    'an override of nothing': (lambda robot: robot.override(0), Code.CONTENT, 'must be between 1 and 150 %'),
    'an override that is no number': (lambda robot: robot.override('fast'), Code.CONTENT, 'must be a number'),
    'a payload that nothing bears': (lambda robot: robot.payload(1e3), Code.CONTENT, 'payload is 1000 kg'),
    'a payload that is no number': (lambda robot: robot.payload(None), Code.CONTENT, 'must be a number'),
    'holding what stands': (lambda robot: robot.hold(), Code.STATE, 'hold: the robot is idle'),
    'resuming what is not held': (
        lambda robot: robot.resume(),
        Code.STATE,
        'resume: the robot is not held',
    ),
}


def told(script, robot, **options):
    """Return the error of a script, and the trace that is left."""
    with pytest.raises(scripting.ScriptError) as caught, scripting.simulate(robot, **options) as called:
        script(called)
    return caught.value, called.trace


@pytest.mark.parametrize('what', WRONG)
def test_invalid_line_is_rejected_with_its_number(robot, what):
    script, code, sentence = WRONG[what]
    error, trace = told(script, robot, inputs={'part': []})
    assert error.code == code
    assert re.search(rf'test_rejections\.py:\d+: .*{sentence}', str(error))
    assert trace.meta['stopped'] == str(error)


def test_rejected_call_may_be_caught_and_the_script_continues(robot):
    with scripting.simulate(robot) as called:
        called.move_l(to_mm=[700, 0, -800])
        with pytest.raises(scripting.ScriptError):
            called.wait()
        called.move_l(**MOVE)
    assert called.trace.meta['stopped'] == ''
    assert called.trace.meta['planned_end_m'] == pytest.approx([0.1, 0.0, -0.8])


def test_unplannable_move_is_reported_with_its_line(robot):
    def script(called):
        called.move_l(**MOVE)
        called.move_l(to_mm=[800, 0, -800])
        called.wait()

    error, _ = told(script, robot)
    line = script.__code__.co_firstlineno + 2
    assert re.search(rf'test_rejections\.py:{line}:9: move_l: .*the limit is', str(error))


def test_missing_input_is_reported_after_its_timeout(robot):
    error, trace = told(lambda called: called.wait_input('part', timeout_s=0.5), robot, inputs={'part': []})
    assert isinstance(error, scripting.WaitTimeoutError)
    assert isinstance(error, TimeoutError)
    assert error.code == Code.TIMEOUT
    assert re.search("wait_input: 'part' was not on within 0.5 s", str(error))
    assert len(trace.time_s) == robot.motion.start_cycle - robot.decision_cycles + 501


def test_wait_has_a_default_timeout(robot):
    error, _ = told(lambda called: called.wait_input('part', False), robot, inputs={'part': [(0.0, True)]})
    assert re.search("'part' was not off within 10 s", str(error))


def test_a_loop_that_neither_moves_nor_waits_is_ended(robot):
    calls = []

    def script(called):
        while not called.input('part'):
            calls.append(called.position())

    error, _ = told(script, robot, inputs={'part': [(9.0, True)]})
    assert re.search(f'{CALLS_MAX} calls took no bus time', str(error))
    assert len(calls) == CALLS_MAX // 2


def test_a_script_without_an_end_is_ended(robot):
    def script(called):
        while True:
            called.move_l(to_m={'by_mm': [0, 0, 5]})
            called.move_l(to_m={'by_mm': [0, 0, -5]})
            called.wait()

    error, trace = told(script, robot, longest_s=2.0)
    assert error.code == Code.TIMEOUT
    assert re.search('the script exceeds the maximum bus time of a simulation, 2 s', str(error))
    assert trace.time_s[-1] == pytest.approx(2.102, abs=2e-3)


def test_waiting_for_held_moves_is_rejected(robot):
    def script(called):
        called.move_l(**MOVE)
        called.wait_time(0.1)
        called.hold()
        called.hold()
        called.wait()

    error, _ = told(script, robot)
    assert error.code == Code.STATE
    assert re.search('wait: the robot is held, so its moves cannot finish: resume it first', str(error))


def test_a_script_that_dies_leaves_the_robot_in_a_stop_on_its_path(robot):
    def script(called):
        called.move_l(**MOVE, speed_m_s=0.3)
        called.wait_time(0.1)
        called.move_l(to_mm=[-100, 0, -800])
        return 1 / 0

    with pytest.raises(ZeroDivisionError), scripting.simulate(robot) as called:
        script(called)
    trace = called.trace
    assert trace.meta['stopped'] == 'division by zero'
    end, start = trace['tcp_command'][-1], trace['tcp_command'][0]
    assert (trace['tcp_command'][-3:] == end).all()
    assert 0.01 < end[0] < 0.06  # not at the end of what was ordered
    assert (end - start)[2] / end[0] == pytest.approx(-0.5, abs=1e-6)


def test_trace_does_not_exist_before_the_end(robot):
    with scripting.simulate(robot) as called, pytest.raises(RunError, match='after the script has ended'):
        _ = called.trace


INPUTS = {
    'times that go back': ({'part': [(0.5, True), (0.2, False)]}, 'do not ascend'),
    'a time that is none': ({'part': [('soon', True)]}, 'must be a number of at least 0 s'),
    'a value that is none': ({'part': [(0.5, 1)]}, 'must be True or False'),
    'no change': ({'part': [0.5]}, 'a change is a time'),
    'too many': ({f'input{n}': [] for n in range(33)}, 'there are 33 inputs, the limit is 32'),
    'no name': ({3: []}, 'must have a name each'),
    'no inputs': (3, 'changes by name, or a function'),
    'a function of other things': (lambda cycle: [cycle], 'must have a name each'),
    'a function that forgets one': (
        lambda cycle: {'part': True} if cycle < 200 else {},
        'of bus cycle 200 are',
    ),
}


@pytest.mark.parametrize('what', INPUTS)
def test_invalid_inputs_are_rejected(robot, what):
    inputs, sentence = INPUTS[what]
    with pytest.raises(ProgramError, match=sentence), scripting.simulate(robot, inputs=inputs) as called:
        called.wait_input('part', False, timeout_s=1.0)


def test_a_robot_whose_bus_begins_with_motion_is_rejected(robot):
    early = robot.replace(motion__start_cycle=30)
    with pytest.raises(RunError, match='a script needs 18 bus cycles before it'), scripting.simulate(early):
        pass


def test_a_simulation_of_no_time_is_rejected(robot):
    for longest_s in (0.0, -1.0, float('nan')):
        with (
            pytest.raises(RunError, match='must be positive'),
            scripting.simulate(robot, longest_s=longest_s),
        ):
            pass


def test_robot_of_an_ended_script_accepts_no_calls(robot):
    with scripting.simulate(robot) as called:
        called.move_l(**MOVE)
    for call in (lambda: called.move_l(**MOVE), called.wait, called.state):
        with pytest.raises(scripting.ScriptError, match='the script has ended') as caught:
            call()
        assert caught.value.code == Code.STATE


def test_resuming_twice_is_rejected_the_second_time(robot):
    def script(called):
        called.move_l(**MOVE)
        called.wait_time(0.1)
        called.hold()
        called.resume()
        called.resume()

    error, _ = told(script, robot)
    assert error.code == Code.STATE
    assert 'resume: the robot is not held' in str(error)
