"""Tests of runs by name: available and missing data of recordings and programs."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from bags import CLOCK, META, STORE, TYPES, message, messages, numbers, record
from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.control.messages import EXTEND, ORDER, PROFILE, Origin
from delta3_pacdrive.errors import ProgramError, TraceError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.extension import RunningProgram, extend
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.program.model import MoveL, Program, Target
from delta3_pacdrive.planning.resume import resume
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.faults.fault import Fault
from delta3_pacdrive.robot.faults.schedule import Scheduled
from delta3_pacdrive.studies.runs import runs

PROGRAM = """
name: two moves
start_m: [0.0, 0.0, -0.78]
moves:
  - move_l: {to_m: [0.05, 0.0, -0.78], speed_m_s: 1.0}
  - output: {name: gripper, value: true, payload_kg: 0.5}
  - dwell: {time_s: 0.02}
"""
TRIP = {'fault': 'axis1: two AT are lost', 'fault_source': 'axis1', 'fault_cycle': 142}
STARTS, HELD, LAST = 100, 130, 400  # bus cycles
MULTI_ARRAY, TEXT, HEADER = 'std_msgs/msg/Float64MultiArray', 'std_msgs/msg/String', 'std_msgs/msg/Header'


@pytest.fixture
def program(tmp_path):
    path = tmp_path / 'two.yaml'
    path.write_text(PROGRAM, encoding='utf-8')
    return path


def row(label, values):
    """Return a row of numbers as the robot publishes it."""
    types = STORE.types
    dimension = types['std_msgs/msg/MultiArrayDimension'](label, len(values), len(values))
    layout = types['std_msgs/msg/MultiArrayLayout']([dimension], 0)
    return bytes(STORE.serialize_cdr(types[MULTI_ARRAY](layout, np.asarray(values, float)), MULTI_ARRAY))


def followed(profile, number, planner='a', session='3fa9'):
    """Return a motion profile as reported by the robot."""
    return row(Origin(PROFILE, planner, session, number).label(), profile.to_array())


def text(document):
    return bytes(STORE.serialize_cdr(STORE.types[TEXT](json.dumps(document)), TEXT))


def outputs(cycle, gripper, payload, output1=0.0):
    types = STORE.types
    stamp = types['builtin_interfaces/msg/Time'](*CLOCK.stamp(cycle))
    header = types['std_msgs/msg/Header'](stamp, '')
    values = np.array([gripper, output1, *[0.0] * 6, payload])
    whole = types['sensor_msgs/msg/JointState'](header, ['gripper'], values, np.empty(0), np.empty(0))
    return bytes(STORE.serialize_cdr(whole, 'sensor_msgs/msg/JointState'))


def ordered(plan, number=1, planner='a', session='3fa9'):
    """Return the rows of a plan, and of its order."""
    kinds = [*((move.kind.name, move.to_array(n, len(plan.moves))) for n, move in enumerate(plan.moves))]
    kinds.append((ORDER, [-1.0, 1.0, *range(len(plan.moves))]))
    return [
        ('motion/plan', row(Origin(kind, planner, session, number).label(), values)) for kind, values in kinds
    ]


@pytest.fixture
def plan(program, robot):
    loaded = programs.load(program, robot.motion)
    return program_planner.plan(loaded, loaded.start_m, robot).plan


@pytest.fixture
def recorded(tmp_path, robot):
    """Return a function that records messages in addition to the cyclic ones."""

    def recorded(arrivals):
        cycles = range(90, LAST + 1)
        whole = [
            *arrivals,
            *((t, message(t, CLOCK.stamp(k), numbers(t, k % 8))) for k in cycles for t in TYPES),
        ]
        kinds = TYPES | dict.fromkeys(['motion/plan', 'motion/course'], MULTI_ARRAY)
        kinds |= dict.fromkeys(['faults/schedule', 'motion/progress'], TEXT)
        kinds |= {'outputs': 'sensor_msgs/msg/JointState', 'sercos/phase': HEADER}
        meta = META | {'parameters': parameters.flat_document(robot), 'checksum': robot.checksum}
        return record(tmp_path / 'bag', whole, meta, types=kinds)

    return recorded


@pytest.fixture
def bag(plan, recorded):
    """Record a program with a hold on its first move, an output, a fault and a trip."""
    timeline = Timeline(plan, 1e-3)
    timeline.start(STARTS)
    arrivals = [
        *ordered(plan),
        ('outputs', outputs(0, 0.0, 0.0)),
        ('motion/course', followed(timeline.profile, 1)),
        ('motion/course', followed(timeline.stop(HELD), 2)),
        ('outputs', outputs(135, 1.0, 0.5)),
        ('outputs', outputs(150, 1.0, 0.5, 1.0)),
        ('faults/schedule', text(Scheduled(Fault('drop_at', 'axis1'), 140, 141).to_document())),
        ('motion/progress', text(TRIP)),
        ('motion/progress', text(TRIP)),
        ('motion/progress', b'\x00\x01\x00\x00nonsense'),
    ]
    return recorded(arrivals)


def test_program_yields_moves_outputs_and_start(program):
    run = runs.load(str(program))
    assert (run.kind, run.title, run.knows_start) == ('program', 'two moves', True)
    assert [(move.number, move.kind) for move in run.moves] == [(1, 'line'), (2, 'dwell')]
    line, dwell = run.moves
    assert line.length_m == pytest.approx(0.05)
    assert (line.start_s, line.end_s, dwell.end_s) == (0.0, dwell.start_s, run.whole.meta['program_s'])
    assert [(mark.kind, mark.text) for mark in run.marks] == [
        ('start', 'start of the program'),
        ('output', 'gripper on, payload 0.5 kg'),
    ]
    assert run.marks[1].time_s == pytest.approx(line.end_s, abs=1e-9)
    assert run.changed_parameters() == {
        'motion.home_m': ((0.0, 0.0, -0.78), (0.0, 0.0, -0.75)),
        'control.feed_forward': ('model', 'inertia'),
        'drive.interpolation': ('cubic', 'linear'),
    }
    assert run.parameter_source == 'model'


def test_program_reports_the_limits_of_each_move_in_every_round(program):
    path = program.with_name('twice.yaml')
    path.write_text(PROGRAM + '  - move_l: {to_m: [0.0, 0.0, -0.78]}\nrepeat: 2\n', encoding='utf-8')
    limits = [move.limited_by for move in runs.load(str(path)).moves]
    assert limits[1] == 'time given'
    assert all('TCP' in limits[n] for n in (0, 2))
    assert limits[3:] == limits[:3]


def test_trace_has_the_results_of_its_simulation(program, tmp_path, robot):
    loaded = programs.load(program, robot.motion)
    changed = robot.replace(drive__position_gain_rad_s_rad=150.0)
    trace = simulation.run(loaded, changed)
    runs.note_limits(trace, loaded, simulation.placed(changed, loaded))
    for name in ('a.npz', 'a.csv'):
        trace_file.save(trace, tmp_path / name)
        run, other = runs.load(str(tmp_path / name)), runs.load(str(program))
        assert (run.kind, run.moves, run.marks) == ('trace', other.moves, other.marks)
        assert run.robot == simulation.placed(changed, loaded)
        assert run.robot_note == ''


def test_older_trace_names_the_parameters_in_use(tmp_path, robot):
    trace = simulation.run(programs.load('experiment1', robot.motion), robot)
    for absent in ('parameters', 'moves', 'outputs', 'faults'):
        del trace.meta[absent]
    trace_file.save(trace, tmp_path / 'same.npz')
    trace.meta['checksum'] = 'another'
    trace_file.save(trace, tmp_path / 'other.npz')
    assert runs.load(str(tmp_path / 'same.npz')).robot_note == ''
    other = runs.load(str(tmp_path / 'other.npz'))
    assert other.robot_note == 'the recording does not contain its parameters: those of delta3.yaml are used'
    assert other.moves == ()


def test_bag_yields_moves_holds_outputs_faults_and_trips_by_cycle(bag):
    run = runs.load(str(bag))
    assert (run.kind, run.robot_note) == ('bag', '')
    (move,) = run.moves  # it is held on the first one
    assert (move.number, move.kind) == (1, 'line')
    assert move.start_s == pytest.approx(0.0)
    assert HELD - STARTS < 1e3 * move.end_s < LAST - STARTS
    told = [(round(1e3 * mark.time_s), mark.kind, mark.text) for mark in run.marks]
    assert told == [
        (0, 'start', 'start of the program'),
        (30, 'event', 'stop on the path'),
        (35, 'output', 'gripper on, payload 0.5 kg'),
        (40, 'fault', 'injected: drop_at axis1'),
        (41, 'event', 'over: drop_at axis1'),
        (42, 'fault', 'axis1: two AT are lost'),
        (50, 'output', 'output1 on'),
    ]
    assert [mark.sources for mark in run.marks if mark.kind == 'fault'] == [(), ('axis1',)]


def test_bag_yields_limits_of_moves_and_reports_of_drives(bag, program):
    run = runs.load(str(bag))
    assert run.moves[0].limited_by == runs.load(str(program)).moves[0].limited_by != ''
    # the bag begins before the program
    assert [(change.state, change.released) for change in run.drives[0]] == [('ENABLED', True)]
    assert run.drives[0][0].time_s == pytest.approx((90 - STARTS) * 1e-3)


def test_bag_of_an_unknown_robot_reports_no_limits_of_moves(bag):
    meta = bag / 'metadata.yaml'
    meta.write_text(meta.read_text().replace('checksum', 'cheksum').replace('parameters', 'paramters'))
    run = runs.load(str(bag))
    assert run.robot_note
    assert [move.limited_by for move in run.moves] == ['']


def test_program_reports_states_of_its_drives(program):
    for changes in runs.load(str(program)).drives:
        told = [(change.state, change.released) for change in changes]
        assert told[-1] == ('ENABLED', True)
        assert told[0][0] in ('NOT_READY', 'READY')


def test_bag_yields_moves_appended_during_motion(tmp_path, robot):
    lines = [
        MoveL(Target(point), limits=Limits(0.5, 12.0, 400.0))
        for point in ((0.01, 0, -0.75), (0.01, 0.01, -0.75))
    ]
    program = Program('driven', (lines[0],))
    planned = program_planner.plan(program, (0.0, 0.0, -0.75), robot, open_end=True)
    timeline = Timeline(planned.plan, 1e-3)
    timeline.start(STARTS)
    more = program_planner.plan(Program('more', (lines[1],)), planned.plan.end_m(), robot).plan
    extension = extend(timeline, STARTS + 20, RunningProgram.of(program, planned).splice(True), more)
    arrivals = []
    for number, plan, kind, last in (
        (1, planned.plan, ORDER, [-1.0, 1.0, 0.0]),
        (2, more, EXTEND, extension.row(1)),
    ):
        arrivals.append(
            ('motion/plan', row(Origin('LINE', 'a', '3fa9', number).label(), plan.moves[0].to_array(0, 1)))
        )
        arrivals.append(('motion/plan', row(Origin(kind, 'a', '3fa9', number).label(), last)))
        profile = timeline.profile if number == 1 else extension.profile
        arrivals.append(('motion/course', followed(profile, number)))
    end = extension.timeline.end_cycle
    arrivals += [
        (t, message(t, CLOCK.stamp(k), numbers(t, k % 8))) for k in range(90, end + 10) for t in TYPES
    ]
    kinds = TYPES | dict.fromkeys(['motion/plan', 'motion/course'], MULTI_ARRAY)
    meta = META | {'parameters': parameters.flat_document(robot), 'checksum': robot.checksum}
    run = runs.load(str(record(tmp_path / 'bag', arrivals, meta, types=kinds)))
    assert [(move.number, move.kind) for move in run.moves] == [(1, 'line'), (2, 'line')]
    assert run.moves[1].start_s == pytest.approx(planned.plan.duration_s, abs=2e-3)
    assert (20, 'more moves follow') in [(round(1e3 * mark.time_s), mark.text) for mark in run.marks]


def phase(session):
    types = STORE.types
    whole = types[HEADER](types['builtin_interfaces/msg/Time'](0, 0), f'CP4 {session}')
    return 'sercos/phase', bytes(STORE.serialize_cdr(whole, HEADER))


@pytest.mark.parametrize('with_plan', [False, True])
def test_messages_played_back_meanwhile_are_ignored(with_plan, plan, recorded):
    timeline, other = Timeline(plan, 1e-3), Timeline(plan, 1e-3)
    timeline.start(STARTS)
    other.start(50)
    foreign = [
        ('motion/course', followed(profile, 7, 'b', 'ffff')) for profile in (other.profile, other.stop(90))
    ]
    own = [
        ('motion/course', followed(timeline.profile, 1)),
        ('motion/course', followed(timeline.stop(HELD), 2)),
    ]
    arrivals = [phase('3fa9'), *ordered(plan), *(ordered(plan, 9, 'b', 'ffff') if with_plan else [])]
    run = runs.load(str(recorded([*arrivals, own[0], *foreign, own[1]])))
    assert [(move.number, move.kind) for move in run.moves] == [(1, 'line')]
    assert [mark.text for mark in run.marks] == ['start of the program', 'stop on the path']
    assert run.notes == ()
    assert run.whole.meta['starts'] == [STARTS]


def test_lost_row_removes_only_the_moves_of_its_program_and_is_reported(plan, recorded):
    first, second = Timeline(plan, 1e-3), Timeline(plan, 1e-3)
    first.start(STARTS)
    first.change(first.stop(HELD))
    resumed = resume(first, 200, 1.0)
    first.change(resumed)
    held_again = first.stop(240)  # the row of the resume before it is lost
    second.start(300)
    begun = Timeline(plan, 1e-3)
    begun.start(STARTS)
    rows = [begun.profile, begun.stop(HELD), held_again]
    arrivals = [*ordered(plan), *(('motion/course', followed(one, n)) for n, one in enumerate(rows, start=1))]
    arrivals += [*ordered(plan, 2), ('motion/course', followed(second.profile, 5))]
    run = runs.load(str(recorded(arrivals)))
    assert run.moves[0].start_s == pytest.approx(0.2)  # those of the second program
    assert any(
        note.startswith('The moves of the program that began at 0.000 s are unknown: a motion profile')
        for note in run.notes
    )
    assert [mark.text for mark in run.marks].count('stop on the path') == 2


def test_plan_without_a_row_loses_its_moves_and_is_reported(plan, recorded):
    timeline = Timeline(plan, 1e-3)
    timeline.start(STARTS)
    run = runs.load(str(recorded([*ordered(plan)[1:], ('motion/course', followed(timeline.profile, 1))])))
    assert run.moves == ()
    assert run.notes == (
        'The moves of the program that began at 0.000 s are unknown: its plan is not recorded completely',
    )


SPOILT = {
    'a cycle without end': ('motion/progress', '{"fault": "x", "fault_cycle": Infinity}'),
    'a cycle of many digits': ('motion/progress', '{"fault": "x", "fault_cycle": 1' + '0' * 400 + '}'),
    'nested without end': ('motion/progress', '[' * 100_000),
    'a number': ('faults/schedule', '5'),
    'a fault that nobody can count': (
        'faults/schedule',
        '{"fault": "emergency_stop", "first": 1' + '0' * 400 + ', "end": 2' + '0' * 400 + '}',
    ),
}


@pytest.mark.parametrize('case', SPOILT)
def test_malformed_message_is_ignored(case, plan, recorded):
    topic, words = SPOILT[case]
    data = bytes(STORE.serialize_cdr(STORE.types[TEXT](words), TEXT))
    timeline = Timeline(plan, 1e-3)
    timeline.start(STARTS)
    run = runs.load(
        str(recorded([*ordered(plan), ('motion/course', followed(timeline.profile, 1)), (topic, data)]))
    )
    assert [mark.text for mark in run.marks] == ['start of the program']
    assert len(run.moves) == 2


def test_missing_and_damaged_messages_are_reported_in_one_note(tmp_path):
    meta = META | {'lost': {'sercos/mdt': 3, 'tcp/error': 5}}
    run = runs.load(str(record(tmp_path / 'lossy', messages(), meta)))
    assert run.notes == ('8 messages of 2 topics are missing, most of tcp/error: 5',)


def test_a_bag_of_signals_alone_is_shown_without_moves(tmp_path):
    run = runs.load(str(record(tmp_path / 'bare', messages())))
    assert (run.moves, run.marks, run.knows_start) == ((), (), False)
    assert run.robot_note.startswith('the recording does not contain its parameters')


def test_a_run_that_a_fault_stops_is_shown_beyond_the_stop(program, robot):
    path = program.with_name('stopped.yaml')
    path.write_text(PROGRAM + 'faults: [{fault: emergency_stop, after_s: 0.02}]\n', encoding='utf-8')
    run = runs.load(str(path))
    told = [(mark.time_s, mark.text) for mark in run.marks if mark.kind == 'fault']
    assert told == [
        (pytest.approx(0.02), 'injected: emergency_stop'),
        (pytest.approx(0.02), f'stop: {run.whole.meta["stopped"]}'),
    ]
    assert [move.number for move in run.moves] == [1]  # what comes behind the stop is not driven
    assert all(mark.kind != 'output' for mark in run.marks)
    assert any('The program was aborted' in note for note in run.notes)
    moving = np.flatnonzero(np.diff(run.whole['motor_command'], axis=0).any(axis=1))
    stood = moving[-1] * 1e-3 - run.whole.meta['start_cycle'] * 1e-3
    assert run.window.time_s[-1] == pytest.approx(stood + 0.6, abs=5e-3)


def test_invalid_run_is_rejected_with_one_message(tmp_path, program, robot):
    with pytest.raises(ProgramError, match='nothing'):
        runs.load('nothing')
    (tmp_path / 'empty').mkdir()
    with pytest.raises(TraceError, match=r'empty: it is not a bag: metadata.yaml is missing$'):
        runs.load(str(tmp_path / 'empty'))
    trace = simulation.run(programs.load(program, robot.motion), robot)
    spoilt = replace(trace, meta=trace.meta | {'moves': [{'kind': 'line'}]})
    trace_file.save(spoilt, tmp_path / 'spoilt.npz')
    with pytest.raises(
        TraceError, match=r'spoilt.npz: the data of its moves, outputs, faults or notes cannot be'
    ):
        runs.load(str(tmp_path / 'spoilt.npz'))


@pytest.mark.parametrize(
    ('told', 'sentence'),
    [
        (
            {'start_cycle': 'soon'},
            r"^start_cycle of the recording is 'soon', expected a whole number$",
        ),
        ({'end_cycle': [1]}, r'^end_cycle of the recording is \[1\], expected a whole number$'),
        (
            {'stopped': 'a fault', 'stop_cycle': 0.5},
            r'stop_cycle.npz: the data of its moves, .* cannot be read$',
        ),
        ({'start_cycle': math.nan}, r'^start_cycle of the recording is nan, expected'),
        ({'notices': 7}, r'notices.npz: the data of its moves, outputs, faults or notes cannot be read$'),
    ],
)
def test_trace_with_invalid_metadata_is_rejected_with_one_message(told, sentence, tmp_path, program, robot):
    path = tmp_path / f'{list(told)[-1]}.npz'
    trace = simulation.run(programs.load(program, robot.motion), robot)
    Trace(trace.time_s, trace.signals, trace.meta | told).save(path)
    with pytest.raises(TraceError, match=sentence):
        runs.load(str(path))


def test_runs_get_distinguishable_names(program):
    nominal, built = runs.load('experiment1'), runs.load('experiment1', 'rich')
    one = runs.load(str(program))
    assert runs.named([one]) == ['two.yaml']
    assert runs.named([nominal, built]) == ['experiment1', 'experiment1 (rich)']
    assert runs.named([built]) == ['experiment1 (rich)']
    assert runs.named([nominal, nominal]) == ['1: experiment1', '2: experiment1']
    elsewhere = replace(one, name='/elsewhere/two.yaml')
    assert runs.named([one, elsewhere]) == [str(program), '/elsewhere/two.yaml']
