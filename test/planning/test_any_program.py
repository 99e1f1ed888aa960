"""Tests of arbitrary program files: each is planned or rejected with one message."""

import contextlib
import datetime as dt
import math

import numpy as np
from hypothesis import event, example, given, settings
from hypothesis import strategies as st

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.paths.move import OUTPUTS, Move, MoveKind
from delta3_pacdrive.planning.plan import sample_plan
from delta3_pacdrive.planning.program import file_reader as programs
from programs_read import checked, parse
from thoroughness import examples

HOME = (0.0, 0.0, -0.75)
KEYS = st.sampled_from(
    [
        'name', 'start_m', 'repeat', 'limits', 'points', 'payload_kg', 'moves', 'move_l', 'move_c', 'move_sb', 'cubic',
        'dwell', 'output', 'to_m', 'via_m', 'through_m', 'by_m', 'point', 'time_s', 'duration_s', 'speed_m_s',
        'blend_m', 'strict', 'value', 'before_m', 'time_optimal', 'torque_rate_n_m_s', 'arch', 'up_m', 'down_m',
        'keep_out', 'height_m', 'margin_m', 'aim', 'in_position', 'frames', 'frame', 'tools', 'tool', 'patterns',
        'origin_m', 'yaw_rad', 'taught_m', 'offset_m', 'mass_kg', 'rows', 'columns', 'pitch_m', 'layers', 'for_each',
        'place_of', 'at_m', 'base', 'after_m', 'before_s', 'after_s',
    ]
)  # fmt: skip
SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=5),
    st.binary(max_size=3),
    st.just(dt.date(2026, 1, 1)),
)
VALUES = st.recursive(
    SCALARS,
    lambda children: st.one_of(
        st.lists(children, max_size=4),
        st.dictionaries(st.one_of(KEYS, SCALARS.filter(lambda key: key == key)), children, max_size=4),
    ),
    max_leaves=12,
)
NUMBERS = st.one_of(st.floats(-1.0, 1.0), VALUES)
COORDINATES = st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-0.95, -0.7)).map(list)
STEPS = st.fixed_dictionaries({'by_m': st.lists(st.floats(-0.1, 0.1), min_size=3, max_size=3)})


def statements(points, limits, numbers, flags):
    """Return a strategy for statements with fields of other statements."""
    path = {
        'speed_m_s': limits,
        'acceleration_m_s2': limits,
        'jerk_m_s3': limits,
        'blend_m': numbers,
        'strict': flags,
        'time_optimal': flags,
        'in_position': flags,
        'torque_rate_n_m_s': limits,
    }
    return st.one_of(
        *[
            st.fixed_dictionaries({kind: st.fixed_dictionaries(required, optional=optional)})
            for kind, required, optional in (
                ('move_l', {'to_m': points}, path),
                ('move_c', {'via_m': points, 'to_m': points}, path),
                ('move_sb', {'through_m': st.lists(points, max_size=5)}, path),
                (
                    'arch',
                    {'to_m': points, 'up_m': numbers, 'down_m': numbers},
                    {'keep_out': st.fixed_dictionaries({'height_m': numbers, 'margin_m': numbers}), **path},
                ),
                ('cubic', {'to_m': points, 'duration_s': numbers}, {'end_velocity_m_s': points}),
                ('dwell', {'time_s': numbers}, {}),
                (
                    'output',
                    {'name': st.one_of(st.sampled_from(OUTPUTS), points), 'value': flags},
                    {
                        'before_m': numbers,
                        'after_m': numbers,
                        'before_s': numbers,
                        'after_s': numbers,
                        'payload_kg': numbers,
                    },
                ),
            )
        ]
    )


ANY_POINT = st.one_of(st.lists(NUMBERS, min_size=3, max_size=3), VALUES)
ANY_STATEMENT = st.one_of(statements(ANY_POINT, NUMBERS, NUMBERS, st.one_of(st.booleans(), VALUES)), VALUES)
ANY_PROGRAM = st.fixed_dictionaries(
    {'moves': st.one_of(st.lists(ANY_STATEMENT, max_size=3), VALUES)},
    optional={
        'name': VALUES,
        'repeat': st.one_of(st.integers(1, 20_000), VALUES),
        'start_m': ANY_POINT,
        'limits': VALUES,
        'points': st.one_of(st.dictionaries(st.text(max_size=3), ANY_POINT, max_size=2), VALUES),
        'payload_kg': NUMBERS,
    },
)


@settings(max_examples=examples(300))
@given(st.one_of(ANY_PROGRAM, VALUES))
def test_arbitrary_document_is_a_program_or_rejected_with_one_message(robot, document):
    try:
        program = parse(document, robot)
    except ProgramError as error:
        checked(error)
    else:
        assert program.statements
        assert 1 <= program.repeat <= programs.REPEAT_MAX


@settings(max_examples=examples(200))
@given(st.text(alphabet='moves:{}[]-, \n\tl_&*!#|>\'"0123.e\x00\x85\ud800', max_size=60))
@example('moves: &a [*a]')
@example('moves: [{move_l: {to_m: [0, 0, .nan]}}]')
def test_arbitrary_file_is_a_program_or_rejected(robot, tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / 'program.yaml'
    path.write_bytes(text.encode('utf-8', 'surrogatepass'))
    with contextlib.suppress(ProgramError):
        programs.load(path, robot.motion)


PLACES = st.one_of(COORDINATES, COORDINATES, STEPS)
SOME_OPTIONS = {
    'speed_m_s': st.one_of(st.floats(1e-6, 1e9), st.floats(0.1, 10.0)),
    'acceleration_m_s2': st.one_of(st.floats(1e-6, 1e9), st.floats(1.0, 500.0)),
    'jerk_m_s3': st.one_of(st.floats(1e-6, 1e9), st.floats(10.0, 1e5), st.just(math.inf)),
    'strict': st.sampled_from([False, False, True]),
    'time_optimal': st.sampled_from([False, False, True]),
}
CLEARANCES = st.floats(0.0, 0.05)
SOME_STATEMENT = st.one_of(
    *[
        st.fixed_dictionaries({kind: st.fixed_dictionaries(required, optional=optional)})
        for kind, required, optional in (
            ('move_l', {'to_m': PLACES}, {**SOME_OPTIONS, 'in_position': st.booleans()}),
            ('move_l', {'to_m': PLACES, 'blend_m': st.floats(0.0, 0.03)}, SOME_OPTIONS),
            ('move_c', {'via_m': PLACES, 'to_m': PLACES}, SOME_OPTIONS),
            ('move_sb', {'through_m': st.lists(PLACES, min_size=1, max_size=5)}, SOME_OPTIONS),
            ('arch', {'to_m': PLACES, 'up_m': CLEARANCES, 'down_m': CLEARANCES}, SOME_OPTIONS),
            ('cubic', {'to_m': PLACES, 'duration_s': st.floats(0.05, 5.0)}, {}),
            ('dwell', {'time_s': st.floats(0.001, 5.0)}, {}),
            (
                'output',
                {'name': st.sampled_from(OUTPUTS), 'value': st.booleans()},
                {'payload_kg': st.floats(0.0, 10.0)},
            ),
            *(
                (
                    'output',
                    {'name': st.just('output1'), 'value': st.booleans(), shift: st.floats(0.0, 0.3)},
                    {},
                )
                for shift in ('after_m', 'before_s', 'after_s')
            ),
        )
    ]
)
SOME_PROGRAM = st.fixed_dictionaries(
    {'moves': st.lists(SOME_STATEMENT, min_size=1, max_size=5)},
    optional={'repeat': st.integers(1, 3), 'payload_kg': st.floats(0.0, 10.0)},
)


@settings(max_examples=examples(150))
@given(SOME_PROGRAM)
def test_any_valid_document_is_planned_within_the_workspace_or_rejected_with_one_message(robot, document):
    try:
        planned = program_planner.plan(parse(document, robot), HOME, robot)
    except ProgramError as error:
        event(checked(error)[:40])
        return
    event('planned')
    for notice in planned.notices:
        checked(notice)
    plan = planned.plan
    p, master, numbers = sample_plan(plan, np.linspace(0.0, plan.duration_s, 500))
    assert np.isfinite(p).all()
    assert np.hypot(p[:, 0], p[:, 1]).max() <= 0.6 + 1e-4
    assert -0.95 - 1e-4 <= p[:, 2].min() <= p[:, 2].max() <= -0.7 + 1e-4
    assert (master[:, 1] >= -1e-6).all()
    assert max(planned.rms_current_a) <= robot.motor.nominal_current_a * (1.0 + 1e-6)
    lengths = np.array([plan.move(n).length_m for n in numbers])
    assert (master[:, 0] <= lengths * (1.0 + 1e-9)).all()
    for number, move in enumerate(plan.moves):
        assert Move.from_array(move.to_array(number, len(plan.moves)), robot.kinematics)[1] == number
    ends = [plan.move(n).end_m() for n in range(len(plan))]
    for n in range(1, len(plan)):
        assert np.abs(plan.move(n).segments[0, 1::6] - ends[n - 1]).max() < 1e-6
    assert all(plan.move(n).kind in MoveKind for n in range(len(plan)))
