"""Tests of the evaluation of a plan: agreement with the simulation, and the active limits of moves."""

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics, simulation
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.paths.path_dynamics import tcp_motion
from delta3_pacdrive.planning.paths.virtual_master import sample_master
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.places.planning import evaluation, figures, report
from delta3_pacdrive.studies.places.planning.study import Quantity
from delta3_pacdrive.studies.runs.bag_events import of_recorded_move
from thoroughness import some

START = [-0.2, 0.0, -0.8]
FREE = {'speed_m_s': 15.0, 'acceleration_m_s2': 1e6, 'jerk_m_s3': 1e9}
SLOW_ARC = {'via_m': [0.0, 0.06, -0.8], 'to_m': [-0.2, 0.12, -0.8]}
REST = {'dwell': {'time_s': 10.0}}
# what is planned, and what has to limit it
CASES = {
    'a short line': ([{'move_l': {'to_m': [-0.19, 0.0, -0.8]}}], Quantity.TCP_JERK),
    'a long slow line': ([{'move_l': {'to_m': [0.3, 0.0, -0.8], 'speed_m_s': 0.3}}], Quantity.TCP_SPEED),
    'a line with little acceleration': (
        [{'move_l': {'to_m': [0.3, 0.0, -0.8], 'acceleration_m_s2': 2.0}}],
        Quantity.TCP_ACCELERATION,
    ),
    'a quick circle': (
        [{'move_c': SLOW_ARC | {'speed_m_s': 10.0, 'acceleration_m_s2': 20.0, 'jerk_m_s3': 1e5}}],
        Quantity.CURVATURE,
    ),
    'a long line without limits of the TCP': (
        [{'move_l': {'to_m': [0.3, 0.0, -0.8], **FREE}}, {'dwell': {'time_s': 100.0}}],
        Quantity.MOTOR_CURRENT,
    ),
    'the same again and again': ([{'move_l': {'to_m': [0.3, 0.0, -0.8], **FREE}}], Quantity.RMS_CURRENT),
    'a time-optimal line with smooth torques': (
        [{'move_l': {'to_m': [0.2, 0.0, -0.8], 'time_optimal': True, 'torque_rate_n_m_s': 1000.0}}, REST],
        Quantity.TORQUE_RATE,
    ),
    'a dwell': ([{'dwell': {'time_s': 0.2}}], Quantity.TIME),
    'a cubic': ([{'cubic': {'to_m': [0.1, 0.0, -0.8], 'duration_s': 1.0}}], Quantity.TIME),
}


@pytest.fixture(scope='module')
def robot(robot):
    """The packaged robot, limited by motors and TCP only, except where a test examines the gears."""
    return robot.replace(gear__limit_moves=False)


def planned(moves, robot, **more):
    document = moves if isinstance(moves, dict) else {'start_m': START, 'moves': moves, **more}
    program = program_file.parse(document, robot.motion)
    return program_planner.plan(program, program.start_m, robot)


def studied(moves, robot, **more):
    return evaluation.study(planned(moves, robot, **more), robot)


@pytest.mark.parametrize('name', CASES)
def test_limiting_quantity_of_a_move_is_at_its_limit(name, robot):
    moves, quantity = CASES[name]
    use = studied(moves, robot).rows[0].limited_by
    assert use.quantity == quantity
    assert evaluation.AT_LIMIT <= use.used <= 1.0 + 2e-3  # the planner keeps limits within a thousandth
    assert use.used == pytest.approx(use.peak / use.limit)
    assert 0.0 < use.time_share <= 1.0 + 1e-9


def test_a_gear_limits_a_long_line_before_the_motor(robot):
    moves, _ = CASES['a long line without limits of the TCP']
    geared = robot.replace(gear__limit_moves=True)
    row = studied(moves, geared).rows[0]
    assert row.limited_by.quantity == Quantity.GEAR_TORQUE
    assert row.limited_by.limit == geared.gear.acceleration_torque_n_m
    assert row.gear_torque_max_n_m[row.limited_by.axis - 1] == pytest.approx(row.limited_by.peak)
    assert report.limited_text(row).startswith(f'gear torque {row.limited_by.axis} ')


def test_a_long_plan_keeps_fewer_samples_and_the_same_rows(robot, monkeypatch):
    moves = [{'move_l': {'to_m': [0.3, 0.0, -0.8]}}, {'move_l': {'to_m': START}}] * 3
    plan = planned(moves, robot)
    whole, seen = evaluation.study(plan, robot), []
    monkeypatch.setattr(evaluation, 'SAMPLES_KEPT', 300)
    thinned = evaluation.study(plan, robot, lambda *told: seen.append(told))
    assert thinned.rows == whole.rows
    assert report.used_max(thinned) == report.used_max(whole)
    assert report.used_max(whole) == {quantity: used.max() for quantity, used in whole.samples.used.items()}
    assert 250 < len(thinned.samples.time_s) < 350 < 1000 < len(whole.samples.time_s)
    assert set(thinned.samples.time_s) < set(whole.samples.time_s)
    for n in range(1, 7):
        ends = [
            samples.time_s[samples.move == n][[0, -1]].tolist()
            for samples in (whole.samples, thinned.samples)
        ]
        assert ends[0] == ends[1]
    assert seen == [('evaluating', n, 6) for n in range(6)]


def test_grip_during_motion_counts_as_no_torque_rate(robot):
    line, back = (
        {'to_m': to_m, 'time_optimal': True, 'torque_rate_n_m_s': 1000.0}
        for to_m in ([0.2, 0.0, -0.8], START)
    )
    grip = {'name': 'gripper', 'value': True, 'payload_kg': 2.0, 'before_m': 0.1}
    study = studied([{'move_l': line}, {'output': grip}, REST, {'move_l': back}], robot)
    for row in (study.rows[0], study.rows[2]):
        assert max(use.used for use in row.uses if use.quantity == Quantity.TORQUE_RATE) == pytest.approx(
            1.0, abs=0.02
        )


def test_a_motor_at_its_speed_limits_a_move(robot):
    slow = robot.replace(motor__max_speed_rpm=300.0)
    row = studied([{'move_l': {'to_m': [0.3, 0.0, -0.8], 'speed_m_s': 3.0}}], slow).rows[0]
    assert row.limited_by.quantity == Quantity.MOTOR_SPEED
    assert row.limited_by.limit == 300.0
    peak_rpm = max(row.motor_speed_max_rad_s) * 60.0 / (2.0 * np.pi)
    assert row.limited_by.peak == pytest.approx(peak_rpm)
    assert 0.95 * 300.0 < peak_rpm < 1.002 * 300.0


@pytest.mark.parametrize('name', CASES)
def test_no_limit_is_exceeded_and_the_shares_of_the_time_are_parts_of_one(name, robot):
    found = studied(CASES[name][0], robot)
    for row in found.rows:
        assert max(use.used for use in row.uses) < 1.002
        assert sum(use.time_share for use in row.uses) == pytest.approx(1.0)
    assert all(0.0 <= values.min() <= values.max() < 1.002 for values in found.samples.used.values())


@pytest.mark.parametrize('name', ['experiment1', 'experiment2', 'packaging_stops'])
def test_table_agrees_with_the_simulation(name, robot):
    program = program_file.load(name, robot.motion)
    plan = program_planner.plan(program, program.start_m, robot)
    found = evaluation.study(plan, robot)
    trace = simulation.run(program, robot)
    period, start, rounds = trace.meta['cycle_time_s'], trace.meta['start_cycle'], plan.repeat
    assert rounds * sum(row.duration_s for row in found.rows) == pytest.approx(trace.meta['program_s'])
    tcp = trace['tcp_command'][start:]
    way = np.linalg.norm(np.diff(tcp, axis=0), axis=1)
    assert rounds * sum(row.length_m for row in found.rows) == pytest.approx(way.sum(), rel=1e-4)
    assert max(row.speed_max_m_s for row in found.rows) == pytest.approx(way.max() / period, rel=5e-3)
    speed = np.abs(np.diff(trace['motor_command'], axis=0)).max(axis=0) / period
    np.testing.assert_allclose(
        np.max([row.motor_speed_max_rad_s for row in found.rows], axis=0), speed, rtol=0.01
    )
    torque = robot.motor.torque_constant_n_m_a * np.abs(trace['current']).max(axis=0)
    # the loops overshoot where the jerk changes
    np.testing.assert_allclose(
        np.max([row.motor_torque_max_n_m for row in found.rows], axis=0), torque, rtol=0.2
    )


COMMANDED, FOLLOWED = (
    0.005,
    0.16,
)  # shares of a move's largest torque: differences over a cycle, and the loops


def test_torques_of_a_plan_are_those_of_the_commanded_motion_and_the_rest_is_following(robot):
    program = program_file.load('packaging', robot.motion)
    planned = program_planner.plan(program, program.start_m, robot)
    trace = simulation.run(program, robot)
    period, motor, gear = trace.meta['cycle_time_s'], robot.motor, robot.dynamics.gear_ratio
    time_s = trace.time_s - trace.meta['start_cycle'] * period
    theta = kinematics.inverse(trace['tcp_command'], robot)
    speed, acceleration = np.gradient(theta, period, axis=0), np.zeros_like(theta)
    acceleration[1:-1] = (theta[2:] - 2.0 * theta[1:-1] + theta[:-2]) / period**2
    friction = motor.static_friction_n_m * np.tanh(gear * speed / motor.friction_smoothing_rad_s)
    friction += motor.viscous_friction_n_m_s_rad * gear * speed
    moving = [row for row in evaluation.study(planned, robot).rows if row.kind != 'dwell']
    assert len(moving) == 2
    for row in moving:
        within = (time_s >= row.start_s) & (time_s <= row.start_s + row.duration_s)
        carrying = robot.replace(dynamics__payload_mass_kg=row.payload_kg)
        torque = dynamics.inverse(theta, speed, acceleration, carrying) / gear + friction
        largest = np.array(row.motor_torque_max_n_m)
        np.testing.assert_allclose(np.abs(torque[within]).max(axis=0), largest, rtol=COMMANDED)
        driven = motor.torque_constant_n_m_a * np.abs(trace['current'][within]).max(axis=0)
        np.testing.assert_allclose(driven, largest, rtol=FOLLOWED)


@pytest.mark.parametrize('name', ['experiment1', 'experiment2', 'packaging'])
def test_samples_are_one_motion(name, robot):
    program = program_file.load(name, robot.motion)
    s = evaluation.study(program_planner.plan(program, program.start_m, robot), robot).samples
    assert (np.diff(s.time_s) >= 0.0).all()
    step = np.diff(s.time_s)
    long = step > 1e-6
    middle = 0.5 * (s.speed_m_s[1:] + s.speed_m_s[:-1])
    curve = np.abs(s.acceleration_m_s2).max() * step.max()
    assert np.abs(np.diff(s.distance_m) / np.maximum(step, 1e-9) - middle)[long].max() < curve
    np.testing.assert_allclose(s.speed_m_s, s.tcp_speed_m_s, rtol=1e-3, atol=1e-9)
    theta = kinematics.inverse(s.position_m, robot)
    np.testing.assert_allclose(s.arm_angle_rad, theta, atol=1e-12)
    # acceleration is that along the path and that of the bend
    bend = s.curvature_1_m * s.tcp_speed_m_s**2
    both = np.hypot(s.acceleration_m_s2, np.nan_to_num(bend))
    np.testing.assert_allclose(both, s.tcp_acceleration_m_s2, rtol=1e-2, atol=0.05)


def test_the_samples_of_a_cubic_are_derivatives_by_the_time(robot):
    moves = [
        {'cubic': {'to_m': [0.0, 0.1, -0.8], 'duration_s': 0.6, 'end_velocity_m_s': [0.3, 0.1, 0.0]}},
        {'cubic': {'to_m': [0.2, 0.0, -0.85], 'duration_s': 0.8}},
    ]
    found = studied(moves, robot)
    s = found.samples
    inner = slice(5, -5)
    position = np.gradient(s.position_m, s.time_s, axis=0)
    np.testing.assert_allclose(np.linalg.norm(position, axis=1)[inner], s.speed_m_s[inner], atol=2e-3)
    assert found.rows[0].length_m == pytest.approx(s.distance_m[-1])
    assert s.distance_m[-1] == pytest.approx(
        np.linalg.norm(np.diff(s.position_m, axis=0), axis=1).sum(), rel=1e-4
    )
    acceleration = np.gradient(s.speed_m_s, s.time_s)
    smooth = np.abs(s.time_s - 0.6) > 0.01
    near = smooth & (s.speed_m_s > 0.05)
    assert np.abs(acceleration - s.acceleration_m_s2)[near].max() < 0.05


def test_distances_of_a_move_are_the_least_over_its_path(robot):
    row = studied([{'move_l': {'to_m': [0.3, 0.2, -0.9]}}], robot).rows[0]
    points = np.linspace(START, [0.3, 0.2, -0.9], 5001)
    theta = kinematics.inverse(points, robot)
    serial, parallel = kinematics.singularity(theta, points, robot)
    swing = np.degrees(kinematics.forearm_swing(points, robot.kinematics))
    k = robot.kinematics
    wanted = {
        'radius_m': 0.6 - np.hypot(points[:, 0], points[:, 1]).max(),
        'top_m': -0.7 - points[:, 2].max(),
        'bottom_m': points[:, 2].min() + 0.95,
        'arm_angle_max_deg': k.arm_angle_max_deg - np.degrees(theta).max(),
        'arm_angle_min_deg': np.degrees(theta).min() - k.arm_angle_min_deg,
        'forearm_swing_deg': k.forearm_swing_max_deg - swing.max(),
        'serial_singularity': serial.min() - k.serial_singularity_min,
        'parallel_singularity': parallel.min() - k.parallel_singularity_min,
    }
    assert row.distances == pytest.approx(wanted, rel=1e-3, abs=1e-4)


def test_payload_gripped_during_motion_appears_in_the_torque_from_there_on(robot):
    moves = [
        {'move_l': {'to_m': [0.0, 0.0, -0.8], 'speed_m_s': 0.1}},
        {'output': {'name': 'gripper', 'value': True, 'payload_kg': 8.0, 'before_m': 0.1}},
    ]
    s = studied(moves, robot, payload_kg=0.0).samples
    cruise = np.isclose(s.speed_m_s, 0.1)
    before, after = (s.motor_torque_n_m[cruise & side] for side in (s.distance_m < 0.1, s.distance_m > 0.1))
    held = robot.dynamics.gravity_m_s2 * 8.0
    weight = -np.diff([before[-1].sum(), after[0].sum()])[0]
    angle, point = s.arm_angle_rad[cruise][0], s.position_m[cruise][0]
    lift = kinematics.jacobian(angle, point, robot)[2].sum() / robot.dynamics.gear_ratio
    assert weight == pytest.approx(-held * lift, rel=0.1)


def test_rounds_are_reported_once(robot):
    once, thrice = (
        studied([{'move_l': {'to_m': {'by_m': [0.1, 0, 0]}}}, {'move_l': {'to_m': START}}], robot, repeat=n)
        for n in (1, 3)
    )
    assert len(once.rows) == len(thrice.rows) == 2
    assert thrice.planned.plan.duration_s == pytest.approx(3.0 * once.planned.plan.duration_s)
    assert report.document(thrice, robot)['repeat'] == 3


def test_users_read_a_line_per_move_with_its_limit(robot):
    found = studied(CASES['a short line'][0] + CASES['a dwell'][0], robot)
    lines = report.text(found, robot)
    assert lines[3].split()[:3] == ['1', 'moves[0].move_l', 'line']
    assert lines[3].endswith('TCP jerk 100 %')
    assert lines[4].endswith('time given')
    assert lines[5].strip().startswith('whole')


@pytest.mark.parametrize(
    'name', some(['a quick circle', 'the same again and again', 'a dwell', 'a cubic'], ['a quick circle'])
)
def test_every_figure_of_every_kind_of_plan_is_drawn(name, robot, tmp_path):
    found = studied(CASES[name][0], robot)
    paths = ReportFolder(tmp_path, Provenance.of('test')).figures(figures.by_name(found, robot))
    assert {path.name for path in paths} == {
        'virtual_master.png',
        'position_and_velocity.png',
        'path_points.png',
        'over_path.png',
        'continuous_torque.png',
        'motors.png',
        'limits.png',
    }


@pytest.mark.parametrize('case', CASES)
def test_recorded_move_has_the_limits_of_its_program(case, robot):
    moves, quantity = CASES[case]
    found = studied(moves, robot)
    recorded = of_recorded_move(found.planned.plan.move(0), robot)
    if quantity in (Quantity.RMS_CURRENT, Quantity.TORQUE_RATE):  # one move alone does not tell it
        assert recorded is None
    else:
        assert report.limited_text(recorded) == report.limited_text(found.rows[0])


def test_recording_does_not_reveal_limits_that_vary_along_a_move(robot):
    corner = {'to_m': [0.0, 0.0, -0.8], 'acceleration_m_s2': 4.0, 'blend_m': 0.02}
    moves = [{'move_l': corner}, {'move_l': {'to_m': [0.0, 0.2, -0.8], 'acceleration_m_s2': 12.0}}]
    assert of_recorded_move(planned(moves, robot).plan.move(0), robot) is None


def test_where_a_time_optimal_program_is_at_no_other_limit_its_rms_current_keeps_it_from_being_faster(robot):
    found = evaluation.of_program(program_file.load('packaging_fast', robot.motion), robot)
    assert max(found.planned.rms_current_a) == pytest.approx(robot.motor.nominal_current_a, rel=5e-3)
    heat = found.samples.leading == evaluation.QUANTITIES.index(Quantity.RMS_CURRENT)
    assert 0.1 < heat.mean() < 0.9
    used = np.maximum.reduce(list(found.samples.used.values()))
    assert used[heat].max() < evaluation.AT_LIMIT
    arch = found.rows[1]
    shares = {use.quantity: use.time_share for use in arch.uses}
    assert shares[Quantity.RMS_CURRENT] > 0.1
    assert sum(use.time_share for use in arch.uses) == pytest.approx(1.0)
    assert 'rms current 1 ' in report.limited_text(arch)
    assert found.rows[0].limited_by.quantity == Quantity.TIME  # a dwell
    assert all(
        use.quantity != Quantity.RMS_CURRENT
        for row in evaluation.of_program(program_file.load('packaging', robot.motion), robot).rows
        for use in row.uses
    )


def test_the_speeds_of_statements_are_those_of_the_plan_on_their_own_parts(robot):
    """Random sequences of lines, evaluated densely; a part ends where the blend at the end of its statement does."""
    rng = np.random.default_rng(39)
    for count in (2, 3, 6, 9):
        corners = rng.uniform([-0.2, -0.2, -0.85], [0.2, 0.2, -0.78], (count + 1, 3))
        lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        blends = [float(rng.uniform(0.05, 0.45)) * min(lengths[n : n + 2]) for n in range(count - 1)]
        speeds = rng.uniform(0.1, 1.0, count).tolist()
        moves = [
            {'move_l': {'to_m': corners[n + 1].tolist(), 'speed_m_s': speeds[n], 'blend_m': blend}}
            for n, blend in enumerate([*blends, 0.0])
        ]
        found = studied({'start_m': corners[0].tolist(), 'moves': moves}, robot)
        (row,), (move,) = found.rows, found.planned.plan.moves
        begin_s = begin_m = 0.0
        for n, one in enumerate(row.statements):
            assert one.name == f'moves[{n}].move_l'
            assert one.start_s == pytest.approx(begin_s, abs=1e-12)
            end_s, end_m = begin_s + one.duration_s, begin_m + one.length_m
            times = np.linspace(begin_s, end_s, 100_001).clip(0.0, (1.0 - 1e-12) * move.duration_s)
            master = sample_master(times, move.master)
            speed = tcp_motion(move.sample(master[:, 0]), *master.T[1:])[0]
            assert one.speed_min_m_s == pytest.approx(speed.min(), rel=1e-5, abs=1e-6)
            assert one.speed_max_m_s == pytest.approx(speed.max(), rel=1e-5)
            assert master[-1, 0] == pytest.approx(end_m, abs=1e-9)
            direction = np.diff(corners, axis=0)[n + 1] / lengths[n + 1] if n + 1 < count else 0.0
            end = corners[n + 1] + (blends[n] * direction if n + 1 < count else 0.0)
            assert np.abs(move.sample([end_m])[0, 0] - end).max() < 1e-7
            if one.limited_by.quantity == Quantity.TCP_SPEED:
                assert one.limited_by.limit in (speeds[n], *speeds[n - 1 : n], *speeds[n + 1 : n + 2])
            begin_s, begin_m = end_s, end_m
        assert begin_s == pytest.approx(row.duration_s)
        assert begin_m == pytest.approx(row.length_m)
        assert row.speed_max_m_s == pytest.approx(max(one.speed_max_m_s for one in row.statements), rel=1e-6)


def test_statements_of_a_slowed_program_keep_its_time(robot):
    moves = [
        {'move_l': {'to_m': [0.1, 0.2, -0.8], 'blend_m': 0.02, **FREE}},
        {'move_l': {'to_m': [0.1, -0.2, -0.8], 'blend_m': 0.02, **FREE}},
        {'move_l': {'to_m': START, **FREE}},
    ]
    found = studied(moves, robot, repeat=3)
    for row in found.rows:
        assert row.limited_by.quantity == Quantity.RMS_CURRENT
        assert len(row.statements) == 3
        assert {one.limited_by.quantity for one in row.statements} == {Quantity.RMS_CURRENT}
        assert sum(one.duration_s for one in row.statements) == pytest.approx(row.duration_s)
