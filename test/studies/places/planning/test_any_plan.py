"""Tests of the evaluation of arbitrary plans: limits and finite numbers."""

import contextlib
import json

import numpy as np
from hypothesis import event, given, settings
from hypothesis import strategies as st

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.studies.places.planning import evaluation, report
from delta3_pacdrive.studies.places.planning.study import Quantity
from thoroughness import examples

START = [0.0, 0.0, -0.8]
KEPT = 1.002  # of the TCP: the planner keeps limits within a thousandth
NEARLY = (
    1.05  # of the motors, which the planner checks at places only: the evaluation also looks between them
)
OF_MOTORS = (Quantity.MOTOR_SPEED, Quantity.MOTOR_VOLTAGE, Quantity.MOTOR_CURRENT)
POINTS = st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-0.93, -0.72)).map(list)
LIMITS = st.fixed_dictionaries(
    {},
    optional={
        'speed_m_s': st.floats(0.05, 20.0),
        'acceleration_m_s2': st.floats(0.5, 150.0),
        'jerk_m_s3': st.one_of(st.floats(20.0, 2e4), st.just(float('inf'))),
        'blend_m': st.floats(0.001, 0.05),
    },
)
MOVES = st.one_of(
    st.builds(lambda to, more: {'move_l': {'to_m': to, **more}}, POINTS, LIMITS),
    st.builds(lambda via, to, more: {'move_c': {'via_m': via, 'to_m': to, **more}}, POINTS, POINTS, LIMITS),
    st.builds(
        lambda through, more: {'move_sb': {'through_m': through, **more}},
        st.lists(POINTS, min_size=2, max_size=5),
        LIMITS,
    ),
    st.builds(lambda to, t: {'cubic': {'to_m': to, 'duration_s': t}}, POINTS, st.floats(0.05, 2.0)),
    st.builds(lambda t: {'dwell': {'time_s': t}}, st.floats(1e-3, 5.0)),
    st.builds(
        lambda kg: {'output': {'name': 'gripper', 'value': kg > 0.0, 'payload_kg': kg}}, st.floats(0.0, 5.0)
    ),
)


@settings(max_examples=examples(80))
@given(moves=st.lists(MOVES, min_size=1, max_size=5), repeat=st.integers(1, 3))
def test_every_plan_is_evaluated_within_its_limits_in_finite_numbers(moves, repeat, robot):
    planned = None
    with contextlib.suppress(ProgramError):
        program = program_file.parse({'start_m': START, 'moves': moves, 'repeat': repeat}, robot.motion)
        planned = program_planner.plan(program, START, robot)
    event('planned' if planned else 'refused')
    if planned is None:
        return
    found = evaluation.study(planned, robot)
    json.dumps(report.document(found, robot), allow_nan=False)
    assert report.text(found, robot)
    s = found.samples
    for quantity, values in s.used.items():
        assert np.isfinite(values).all(), quantity
        assert values.max() <= (NEARLY if quantity in OF_MOTORS else KEPT), quantity
    assert np.isfinite(s.position_m).all()
    assert np.isfinite(s.motor_torque_n_m).all()
    assert (np.diff(s.distance_m) >= -1e-9).all()
    for row in found.rows:
        assert row.limited_by.used <= NEARLY
        assert min(row.distances.values()) > -1e-6
