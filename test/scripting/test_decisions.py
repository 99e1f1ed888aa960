"""Tests of scripts in a simulation: times of decisions and of their effects."""

import numpy as np
import pytest

import delta3_pacdrive as d3
from delta3_pacdrive import scripting
from delta3_pacdrive.errors import Code
from delta3_pacdrive.scripting import moves
from delta3_pacdrive.scripting.script_orders import AHEAD_S

FIXED = [
    {'move_l': {'to_mm': [100, 0, -800], 'blend_mm': 20}},
    {'move_c': {'via_m': [0.05, 0.05, -0.8], 'to_m': [0.0, 0.0, -0.8]}},
    {'output': {'name': 'gripper', 'value': True, 'payload_kg': 0.3}},
    {'dwell': {'time_s': 0.05}},
    {'move_sb': {'through_m': [[0.1, 0.0, -0.8], [0.1, 0.1, -0.82]], 'speed_m_s': 0.5}},
    {'arch': {'to_m': [-0.1, 0.0, -0.8], 'up_m': 0.02, 'down_m': 0.02}},
]
TWO_POINTS = ([100, 0, -800], [0, 100, -800])


def driven(robot, script, **options):
    """Return the trace of a script."""
    with scripting.simulate(robot, **options) as called:
        script(called)
    return called.trace


def begins(trace, after=0):
    """Return the first later bus cycle with another commanded TCP."""
    moved = np.abs(np.diff(trace['tcp_command'], axis=0)).max(axis=1) > 0.0
    return int(np.flatnonzero(moved[after:])[0]) + after


def corner_speed(trace, corner_mm):
    """Return the speed of the TCP [m/s] where it is nearest to a corner."""
    speed = np.linalg.norm(np.diff(trace['tcp_command'], axis=0), axis=1) / trace.meta['cycle_time_s']
    away = np.linalg.norm(trace['tcp_command'] - np.array(corner_mm) / 1000.0, axis=1)
    return speed[int(np.argmin(away[:-1]))]


@pytest.mark.parametrize('changes', [{}, {'control__feed_forward': 'model', 'drive__interpolation': 'cubic'}])
def test_script_without_decisions_has_the_bits_of_its_program(robot, changes):
    robot = robot.replace(**changes)

    def script(called):
        for ((name, keys),) in (move.items() for move in FIXED):
            getattr(called, name)(**keys)

    program = d3.simulate(d3.load_program({'moves': FIXED}, robot), robot)
    trace = driven(robot, script)
    assert sorted(trace.signals) == sorted(program.signals)
    assert all(np.array_equal(trace[name], program[name], equal_nan=True) for name in program.signals)
    assert trace.meta['figures'] == program.meta['figures']
    assert [move['kind'] for move in trace.meta['moves']] == [move['kind'] for move in program.meta['moves']]
    for ours, theirs in zip(trace.meta['moves'], program.meta['moves'], strict=True):
        assert ours['start_s'] == pytest.approx(theirs['start_s'], abs=1.01 * trace.meta['cycle_time_s'])
        assert ours['end_s'] == pytest.approx(theirs['end_s'], abs=1.01 * trace.meta['cycle_time_s'])
    assert [(one['name'], one['payload_kg']) for one in trace.meta['outputs']] == [('gripper', 0.3)]
    assert trace.meta['end_cycle'] == program.meta['end_cycle']


def test_arguments_may_be_tuples_and_arrays(robot):
    def script(called):
        called.move_l(to_mm=(100, 0, -800))
        called.move_l(to_m=np.array([0.0, 0.1, -0.8]), speed_m_s=np.float64(0.5))

    trace = driven(robot, script)
    assert trace.meta['planned_end_m'] == pytest.approx([0.0, 0.1, -0.8], abs=1e-12)


def test_a_decision_takes_effect_a_fixed_number_of_cycles_after_its_answers(robot):
    seen = []

    def script(called):
        called.wait_input('part')
        seen.append(called.state().cycle)
        called.move_l(to_mm=TWO_POINTS[0])

    trace = driven(robot, script, inputs={'part': [(0.4, True)]})
    begin = robot.motion.start_cycle - robot.decision_cycles
    assert seen == [begin + 400]
    assert trace.meta['start_cycle'] == begin + 400 + robot.decision_cycles
    assert begins(trace) == trace.meta['start_cycle']
    assert robot.decision_cycles == 18


def test_it_does_so_while_the_robot_moves(robot):
    def script(called, part_mm):
        called.move_l(to_mm=[100, 0, -800], speed_m_s=0.2)
        called.wait_input('part')
        called.hold()
        called.wait_time(0.5)
        called.resume()

    at = driven(robot, lambda called: script(called, 0), inputs={'part': [(0.25, True)]})
    free = driven(robot, lambda called: called.move_l(to_mm=[100, 0, -800], speed_m_s=0.2))
    apart = np.abs(at['tcp_command'] - free['tcp_command'][: len(at.time_s)][:1])  # same start
    assert apart[0].max() == 0.0
    cycles = min(len(at.time_s), len(free.time_s))
    differ = np.flatnonzero(np.abs(at['tcp_command'][:cycles] - free['tcp_command'][:cycles]).max(axis=1))
    begin = robot.motion.start_cycle - robot.decision_cycles
    # in the cycle of the decision the speed begins to change, its place a cycle later
    effect = begin + 250 + robot.decision_cycles
    assert effect < differ[0] <= effect + 2


def test_the_same_script_has_the_same_bits_again(robot):
    def script(called):
        called.move_l(to_mm=TWO_POINTS[0], blend_mm=20)
        called.wait_time(0.02)
        called.move_l(to_mm=TWO_POINTS[1])
        called.wait_input('part')
        called.output('gripper', True)
        called.wait_time(0.1)
        called.move_l(to_mm=TWO_POINTS[0], in_position=True)

    first, second = (driven(robot, script, inputs={'part': [(0.9, True)]}) for _ in range(2))
    assert all(np.array_equal(first[name], second[name], equal_nan=True) for name in first.signals)


def test_moves_that_follow_early_enough_round_the_corner(robot):
    def script(called, wait_s):
        called.move_l(to_mm=TWO_POINTS[0], blend_mm=20)
        called.wait_time(wait_s)
        called.move_l(to_mm=TWO_POINTS[1])

    early = driven(robot, lambda called: script(called, 0.02))
    assert corner_speed(early, TWO_POINTS[0]) > 0.2
    assert early.meta['notices'] == []
    late = driven(robot, lambda called: script(called, 0.2))
    assert corner_speed(late, TWO_POINTS[0]) < 0.01
    assert late.meta['planned_end_m'] == pytest.approx(early.meta['planned_end_m'])


def test_late_corner_is_reported_with_its_line(robot):
    def script(called):
        called.move_l(to_mm=TWO_POINTS[0], blend_mm=20)
        called.wait(left_s=0.03)
        called.move_l(to_mm=TWO_POINTS[1])

    (notice,) = driven(robot, script).meta['notices']
    assert 'test_decisions.py:' in notice
    assert notice.endswith('the corner before this move is not rounded: the order is too late')


def test_a_sequence_of_rounded_corners_ends_at_its_limit_of_statements(robot, monkeypatch):
    assert moves.REPLANNED_MAX == 200
    monkeypatch.setattr(moves, 'REPLANNED_MAX', 3)

    def script(called, points):
        for point in points:
            called.move_l(to_mm=point, blend_mm=5)
            called.wait_time(0.02)  # sends the move

    points = [*TWO_POINTS, (0, 150, -750), (0, -150, -750)]
    assert driven(robot, lambda called: script(called, points[:3])).meta['notices'] == []
    (notice,) = driven(robot, lambda called: script(called, points)).meta['notices']
    assert notice.endswith('is not rounded: a sequence of rounded corners has at most 3 statements')


def test_wait_ends_with_the_robot_in_position(robot):
    states = []

    def script(called):
        called.move_l(to_mm=TWO_POINTS[0])
        called.wait()
        states.append(called.state())
        called.move_l(to_mm=TWO_POINTS[1], in_position=True)
        states.append(called.state())

    trace = driven(robot, script)
    for state, (x, y, z) in zip(states, TWO_POINTS, strict=True):
        assert state.position_m == pytest.approx((x / 1e3, y / 1e3, z / 1e3), abs=1e-4)
        assert state.left_s == 0.0
    first, second = trace.meta['moves']
    waited = second['start_s'] - first['end_s']
    cycles = robot.in_position_cycles + robot.decision_cycles
    assert cycles * 1e-3 - 2e-3 < waited < cycles * 1e-3 + 0.02


def test_less_than_a_move_may_be_waited_for(robot):
    left = []

    def script(called):
        called.move_l(to_mm=TWO_POINTS[0])
        called.wait(left_s=0.05)
        left.append(called.state().left_s)

    driven(robot, script)
    assert left == [pytest.approx(0.05, abs=1e-9)]


def test_times_count_from_the_start_of_the_script(robot):
    times = []

    def script(called):
        times.append(called.state().time_s)
        called.wait_time(0.25)
        times.append(called.state().time_s)
        called.wait_until(0.7)
        called.wait_until(0.1)
        times.append(called.state().time_s)

    driven(robot, script)
    assert times == pytest.approx([0.0, 0.25, 0.7])


def test_outputs_alone_take_effect_as_well(robot):
    states = []

    def script(called):
        called.output('gripper', True)
        called.wait_time(0.05)
        states.append(called.state().outputs['gripper'])
        called.output('gripper', False)
        called.wait()
        states.append(called.state().outputs['gripper'])

    trace = driven(robot, script, signals=['outputs'])
    assert states == [True, False]
    assert [one['value'] for one in trace.meta['outputs']] == [1.0, 0.0]
    on = np.flatnonzero(trace['outputs'][:, 0])
    assert trace.meta['outputs'][0]['time_s'] == pytest.approx((on[0] - trace.meta['start_cycle']) * 1e-3)


def test_hold_keeps_the_path_and_the_orders(robot):
    states = []

    def script(called):
        called.move_l(to_mm=TWO_POINTS[0])
        called.wait_time(0.1)
        called.hold()
        called.wait_time(0.3)
        states.append(called.state())
        called.move_l(to_mm=TWO_POINTS[1])
        called.resume()

    trace = driven(robot, script)
    assert states[0].motion == 'stopped'
    assert np.abs(np.cross(states[0].command_m - np.array([0, 0, -0.75]), [0.1, 0.0, -0.05])).max() < 1e-9
    assert trace.meta['planned_end_m'] == pytest.approx([0.0, 0.1, -0.8], abs=1e-9)
    assert [move['kind'] for move in trace.meta['moves']] == ['line', 'line']


def test_override_applies_to_the_active_and_following_moves(robot):
    def script(called, percent):
        if percent != 100:
            called.override(percent)
        called.move_l(to_mm=TWO_POINTS[0])
        called.wait()
        called.move_l(to_mm=TWO_POINTS[1])

    full, half = (driven(robot, lambda called, p=p: script(called, p)).meta['moves'] for p in (100, 50))
    for before, after in zip(full, half, strict=True):
        took = (after['end_s'] - after['start_s']) / (before['end_s'] - before['start_s'])
        assert took == pytest.approx(2.0, rel=0.02)


def test_a_payload_counts_from_the_next_move_on(robot):
    payloads = []

    def script(called):
        called.move_l(to_mm=TWO_POINTS[0])
        called.payload(1.0)
        called.move_l(to_mm=TWO_POINTS[1])
        called.wait()
        payloads.append(called.state().payload_kg)
        called.output('gripper', False, payload_kg=0.25)
        called.wait_time(0.5)
        payloads.append(called.state().payload_kg)
        called.move_l(to_mm=TWO_POINTS[0])
        called.wait()
        payloads.append(called.state().payload_kg)

    driven(robot, script)
    assert payloads == [1.0, 0.25, 0.25]


def test_a_script_of_many_moves_is_planned_in_pieces(robot):
    """More statements than fit one planned piece: the bus runs while the script waits."""
    times = []

    def script(called):
        for n in range(230):
            called.move_l(to_mm=[0, 0, -800 - 4 * (n % 2)])
            times.append(called.state().time_s)

    trace = driven(robot, script)
    assert len(trace.meta['moves']) == 230
    assert times[98] == 0.0
    assert times[199] > trace.meta['moves'][99]['end_s'] - AHEAD_S
    assert times[229] < trace.meta['moves'][-1]['start_s']


def test_position_and_state_take_no_bus_time(robot):
    def script(called):
        called.move_l(to_mm=TWO_POINTS[0])
        cycle = called.state().cycle
        assert called.position() == pytest.approx((0.0, 0.0, -0.75), abs=1e-6)
        assert called.state().cycle == cycle
        called.wait()
        assert called.position() == pytest.approx((0.1, 0.0, -0.8), abs=1e-4)

    driven(robot, script)


def test_inputs_may_be_a_function_of_the_bus_cycle(robot):
    cycles = []

    def script(called):
        called.wait_input('odd', False)
        called.wait_input('odd')
        cycles.append(called.state().cycle)

    driven(robot, script, inputs=lambda cycle: {'odd': bool(cycle % 200 == 199)})
    assert cycles == [199]


def test_a_fault_of_the_robot_ends_the_script_with_its_line(robot):
    weak = robot.replace(motion__in_position_timeout_s=0.01, drive__position_window_rad=1e-6)

    def script(called):
        called.move_l(to_mm=TWO_POINTS[0])
        called.wait()

    with pytest.raises(scripting.ScriptError, match=r'test_decisions\.py:\d+: .*not in position') as caught:
        driven(weak, script)
    assert caught.value.code == Code.FAULT
