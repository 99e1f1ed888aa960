"""Tests of parts on the belts of a script: detection by camera or light barrier, assignment and placing."""

import numpy as np
import pytest

from delta3_pacdrive import parameters, scripting
from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.errors import Code
from test.support.belts import QUICK, around, pick, speed_of

ENCODER = {'bits': 14, 'circumference_mm': 200}
CAMERA = {'at_mm': 250, 'length_mm': 300, 'every_mm': 120, 'latency_s': 0.02, 'noise_mm': 0.02}
PITCH_M = 0.4


@pytest.fixture(scope='module')
def robot():
    return parameters.load(parameters.MODEL_CONTROLLER)


def mixed(faults=(), **camera):
    """Return a cell with a belt of two types of parts, seen by a camera, and a belt that takes parts away."""
    line = {
        'origin_mm': [-700, 120, -870], 'length_mm': 1500, 'encoder': ENCODER, 'speed': [speed_of(0.4)],
        'stream': {'part': 'bar', 'also': ['disc'], 'count': 12, 'spacing_mm': 150, 'spread_mm': [10, 15]},
        'camera': CAMERA | camera, 'window_mm': [450, 1100],
    }  # fmt: skip
    out = {
        'origin_mm': [600, -200, -870], 'direction_deg': 180, 'length_mm': 1200, 'encoder': ENCODER,
        'speed': [speed_of(0.3)], 'window_mm': [350, 850],
    }  # fmt: skip
    bar = {'mass_kg': 0.2, 'size_mm': [60, 40, 20], 'friction': 0.5}
    cup = {'output': 'gripper', 'diameter_mm': 60, 'vacuum_pa': 60000, 'build_up_s': 0.006, 'decay_s': 0.004}
    return cell_file.parse(
        {
            'seed': 3,
            'cup': cup,
            'parts': {'bar': bar, 'disc': bar | {'mass_kg': 0.1}},
            'belts': {'line': line, 'out': out},
            'faults': list(faults),
        }
    )


def take(called, part):
    with called.track('line', part, **QUICK):
        called.move_l(to_mm=[0, 0, 40], **QUICK)
        called.move_l(to_mm=[0, 0, 20], **QUICK)
        called.output('gripper', True, payload_kg=0.2)
        called.dwell(0.04)
        called.move_l(to_mm=[0, 0, 40], **QUICK)


def put(called):
    with called.track('out', called.slot('out', pitch_m=PITCH_M), **QUICK):
        called.move_l(to_mm=[0, 0, 40], **QUICK)
        called.move_l(to_mm=[0, 0, 20], **QUICK)
        called.output('gripper', False, payload_kg=0.0)
        called.dwell(0.02)
        called.move_l(to_mm=[0, 0, 40], **QUICK)


@pytest.fixture(scope='module')
def carried(robot):
    """Return the trace of three parts carried from belt to belt, and the final record of the robot."""
    with scripting.simulate(robot, cell=mixed(doubled_share=0.5), signals=['cell_belts']) as called:
        for _ in range(3):
            take(called, called.part('line', kind='disc'))
            put(called)
        known = called.belt('line')
    return called.trace, known


def test_parts_of_a_type_are_carried_from_one_moving_belt_to_another(carried):
    trace, _ = carried
    there = [one for one in trace.meta['cell']['parts'] if one['where'] == 'out']
    assert [one['type'] for one in there] == ['disc'] * 3
    assert {str(one['outcome']) for one in there} == {'placed'}
    assert trace.meta['cell']['missed'] == 0


def test_placed_parts_lie_in_the_middle_of_the_other_belt_at_least_a_pitch_apart(carried):
    trace, _ = carried
    there = [one for one in trace.meta['cell']['parts'] if one['where'] == 'out']
    way, tcp = trace.signals['cell_belts'][:, 1], trace.signals['tcp_true']
    cycles = [one['released_cycle'] for one in there]
    along = np.array([0.6 - tcp[k, 0] - way[k] for k in cycles])
    assert np.diff(along).max() < -PITCH_M + 0.3e-3
    assert np.abs(tcp[cycles, 1] + 0.2).max() < 0.3e-3


def test_part_reported_twice_counts_once_and_the_belt_speed_is_known(carried):
    _, known = carried
    assert known.merged > 3
    assert known.speed_m_s == pytest.approx(0.4, abs=0.01)
    assert known.jumps == known.bounced == known.refused == 0


def test_the_nearest_part_is_not_the_first_one(robot):
    with scripting.simulate(robot, cell=mixed()) as called:
        called.part('line')
        called.wait_time(2.0)
        nearest = called.part('line', rule='nearest')
        first = called.part('line')
    assert first.along_m > nearest.along_m


def test_dead_camera_is_reported_instead_of_waiting_for_its_parts(robot):
    dead = [{'fault': 'camera_dead', 'belt': 'line', 'after_s': 1.0}]

    def all_of_them(called):
        for _ in range(12):
            called.part('line', timeout_s=10.0)

    with scripting.simulate(robot, cell=mixed(dead)) as called, pytest.raises(scripting.ScriptError) as told:
        all_of_them(called)
    assert told.value.code is Code.BELT
    assert 'part: the camera of belt line is dead: no picture for 0.30 m of belt travel' in str(told.value)


def test_a_light_barrier_that_bounces_does_not_send_the_robot_twice(robot):
    barrier = {'at_mm': 300, 'delay_s': 0.0005, 'bounce_s': 0.004}
    with scripting.simulate(robot, cell=around([speed_of(0.5)], 2, barrier=barrier)) as called:
        pick(called)
        pick(called)
        known = called.belt('line')
    assert called.trace.meta['cell']['outcomes']['placed'] == 2
    assert called.trace.meta['cell']['missed'] == 0
    assert known.bounced == 6


WRONG = {
    'rule': (
        lambda robot: robot.part('line', rule='best'),
        "part: rule is 'best', but must be one of: first in, nearest",
    ),
    'pitch': (lambda robot: robot.slot('line', 0.0), 'slot: pitch_m is 0 m, but must be between'),
    'kind': (
        lambda robot: robot.part('line', kind='bar'),
        'part: belt line has no camera to detect the kind',
    ),
    'belt': (lambda robot: robot.belt('lane'), "unknown belt 'lane', the belts are: line"),
    'nothing comes': (
        lambda robot: robot.part('line', timeout_s=0.1),
        "part: none arrived on belt 'line' within 0.1 s",
    ),
}


@pytest.mark.parametrize('case', WRONG)
def test_invalid_call_is_rejected_with_one_message(robot, case):
    call, sentence = WRONG[case]
    with (
        scripting.simulate(robot, cell=around([speed_of(0.5)], 1)) as called,
        pytest.raises(scripting.ScriptError) as told,
    ):
        call(called)
    assert sentence in str(told.value)


@pytest.mark.parametrize(('kind', 'told'), [('baar', "'baar'"), (1, '1')])
def test_unknown_kind_of_part_is_rejected_immediately(robot, kind, told):
    with scripting.simulate(robot, cell=mixed()) as called:
        begun = called.state().cycle
        with pytest.raises(scripting.ScriptError) as refused:
            called.part('line', kind=kind)
        assert called.state().cycle == begun
    near = ': did you mean bar?' if kind == 'baar' else ''
    assert str(refused.value).endswith(
        f'part: unknown kind {told}, the parts of the cell are: bar, disc{near}'
    )


def test_a_part_of_one_belt_is_not_tracked_on_another(robot):
    def mixed_up(called):
        with called.track('line', called.slot('out', PITCH_M)):
            called.move_l(to_mm=[0, 0, 40])

    with scripting.simulate(robot, cell=mixed()) as called, pytest.raises(scripting.ScriptError) as told:
        mixed_up(called)
    assert 'track: the part is on belt out, not on belt line' in str(told.value)


def two():
    """Return a cell with two belts, the second one with three times as many parts."""
    line = {
        'origin_mm': [-700, 150, -870], 'length_mm': 1500, 'encoder': ENCODER, 'speed': [speed_of(0.4)],
        'stream': {'part': 'bar', 'count': 12, 'spacing_mm': 300}, 'barrier': {'at_mm': 100}, 'window_mm': [450, 1100],
    }  # fmt: skip
    busy = line | {'origin_mm': [-700, -150, -870], 'stream': line['stream'] | {'spacing_mm': 100}}
    bar = {'mass_kg': 0.2, 'size_mm': [60, 40, 20], 'friction': 0.5}
    return cell_file.parse({'parts': {'bar': bar}, 'belts': {'line': line, 'busy': busy}})


def test_of_several_belts_by_load_is_that_with_most_parts_and_first_in_the_part_that_leaves_first(robot):
    with scripting.simulate(robot, cell=two()) as called:
        called.wait_time(2.0)
        waiting = {name: called.belt(name).waiting for name in ('line', 'busy')}
        loaded = called.part(['line', 'busy'], rule='by load')
        first = [called.part(['line', 'busy']) for _ in range(2)]
    assert waiting['busy'] > waiting['line'] + 1
    assert loaded.belt == 'busy'
    assert [one.belt for one in first] == ['line', 'busy']
    assert first[0].along_m > first[1].along_m


@pytest.mark.parametrize(
    ('belts', 'rule', 'sentence'),
    [
        ('line', 'by load', 'part: rule by load requires a list of several belts'),
        (['line', 'line'], 'nearest', 'must be a name or a list of different names'),
        ([], 'nearest', 'must be a name or a list of different names'),
        (['line', 'bussy'], 'nearest', "unknown belt 'bussy', the belts are: line, busy: did you mean busy?"),
        ('line', 'by lod', 'did you mean by load?'),
    ],
)
def test_belts_and_rules_that_make_no_sense_together_are_rejected(robot, belts, rule, sentence):
    with (
        scripting.simulate(robot, cell=two()) as called,
        pytest.raises(scripting.ScriptError, match=sentence),
    ):
        called.part(belts, rule=rule)
