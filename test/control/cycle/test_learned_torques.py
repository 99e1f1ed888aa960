"""Tests of learned torques in the transformation task: matching programs and reasons to discard them."""

import numpy as np
import pytest

from delta3_pacdrive.control.cycle.stages import FADE_CYCLES
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.learned_torques import Learned, Origin
from delta3_pacdrive.planning.program import file_reader as programs

START = 40
MOVES = [{'move_l': {'to_m': [0.2, 0.05, -0.8]}}]
LEARNED_N_M = np.array([0.3, -0.2, 0.1])


@pytest.fixture(scope='module')
def model(robot):
    return robot.replace(control__feed_forward='model', drive__interpolation='cubic')


def planned(robot, moves=MOVES):
    task = Transformation(robot)
    tcp = task.locate(Standing(robot).motors)
    return program_planner.plan(programs.parse({'moves': moves}, robot.motion), tcp, robot).plan


class Standing:
    """The motors of a robot at rest at home, on the grid of increments."""

    def __init__(self, robot):
        from delta3_pacdrive import kinematics

        increments = robot.bus.increments_per_rev / (2.0 * np.pi)
        theta = kinematics.inverse(robot.motion.home_m, robot.kinematics) * robot.dynamics.gear_ratio
        self.motors = np.round(theta * increments) / increments


def task_with(robot, torques, moves=MOVES, override=1.0):
    """Return a task that has learned constant torques for ``MOVES`` and starts moves."""
    learned = None
    if torques is not None:
        plan = planned(robot)
        cycles = round(plan.duration_s / robot.bus.cycle_time_s) + 50
        learned = Learned(
            np.tile(np.asarray(torques, dtype=np.float64), (cycles, 1)), Origin.of('', plan, robot)
        )
    task = Transformation(robot, learned)
    task.locate(Standing(robot).motors)
    task.load(planned(robot, moves))
    task.start(START, override)
    return task


def torques_of(task, end):
    return np.array([(task.command(k), task.torques.copy())[1] for k in range(task.next_cycle, end)])


def both(robot, end, act=lambda task: None, at=START + 60, **other):
    """Return the commands of tasks with and without learned torques, with an event before a cycle."""
    rows = []
    for torques in (LEARNED_N_M, None):
        task = task_with(robot, torques, **other)
        before = torques_of(task, at)
        act(task)
        rows.append(np.vstack([before, torques_of(task, end)]))
    return rows[0] - rows[1]


def test_learned_torques_are_added_from_the_first_cycle_of_the_program_to_their_end(model):
    beside = both(model, START + 800)
    cycles = round(planned(model).duration_s * 1e3) + 50
    assert not beside[:START].any()
    np.testing.assert_allclose(beside[START : START + cycles], np.tile(LEARNED_N_M, (cycles, 1)), atol=1e-12)
    assert not beside[START + cycles :].any()


def test_learned_torques_are_limited_to_the_motor_torque(model):
    small = model.replace(drive__torque_limit_n_m=1.0)
    task = task_with(small, [50.0, -50.0, 0.0])
    torques = torques_of(task, START + 100)[START:]
    np.testing.assert_array_equal(torques[:, :2], np.tile([1.0, -1.0], (100, 1)))
    assert model.torque_max_n_m == pytest.approx(
        min(model.motor.peak_current_a * model.motor.torque_constant_n_m_a, model.drive.torque_limit_n_m)
    )


def test_another_program_runs_without_them_and_the_reason_is_reported(model):
    other = [{'move_l': {'to_m': [0.2, -0.05, -0.8]}}]
    assert not both(model, START + 300, moves=other).any()
    assert 'another plan' in task_with(model, LEARNED_N_M, moves=other).learned.reason
    assert task_with(model, LEARNED_N_M).learned.reason == ''


def test_another_robot_runs_without_learned_torques(model):
    plan = planned(model)
    other = model.replace(drive__position_gain_rad_s_rad=70.0)
    task = Transformation(other, Learned(np.full((500, 3), 0.1), Origin.of('', plan, model)))
    task.locate(Standing(other).motors)
    task.load(planned(other))
    task.start(START)
    assert task.learned.reason.startswith('they belong to other parameters: drive.position_gain_rad_s_rad')


def test_another_speed_runs_without_learned_torques(model):
    assert not both(model, START + 300, override=0.9).any()
    assert 'override' in task_with(model, LEARNED_N_M, override=0.9).learned.reason


@pytest.mark.parametrize(
    ('act', 'for_good'),
    [
        (lambda task: task.hold(), False),
        (lambda task: task.stop_at(START + 60), True),
        (lambda task: task.clear_program(), False),
    ],
    ids=['hold', 'fault', 'forgotten'],
)
def test_learned_torques_fade_when_the_program_is_left_and_a_fault_drops_them(act, for_good, model):
    beside = both(model, START + 300, act)
    sizes = np.abs(beside[START:, 0])
    np.testing.assert_allclose(sizes[:60], 0.3, atol=1e-12)
    fading = sizes[60 : 60 + FADE_CYCLES]
    np.testing.assert_allclose(np.diff(fading), -0.3 / FADE_CYCLES, atol=1e-12)
    assert not sizes[60 + FADE_CYCLES :].any()
    task = task_with(model, LEARNED_N_M)
    torques_of(task, START + 60)
    act(task)
    torques_of(task, START + 1000)
    assert task.learned.reason
    task.clear_program()
    task.locate(Standing(model).motors)
    task.load(planned(model))
    task.start(task.next_cycle)
    assert bool(task.learned.reason) == for_good


def test_log_reports_the_use_of_learned_torques_and_their_loss_after_a_fault(rig, model):
    """A running robot moves as requested; learned torques accompany only their own program."""
    here = type(rig)(model).task.state['tcp'][0]
    plan = program_planner.plan(programs.parse({'moves': MOVES}, model.motion), here, model).plan
    robot = type(rig)(model, learned=Learned(np.full((500, 3), 0.1), Origin.of('', plan, model)))
    robot.enable()

    def sentences():
        said, robot.said = robot.said, []
        texts = [getattr(action, 'sentence', '') for action in said]
        return [text for text in texts if text.startswith('learned torques')]

    assert robot.task.learned.exist
    assert robot.task.learned.reason == 'no program has been started'
    robot.start('moves: [{move_l: {to_m: [0.2, 0.05, -0.8]}}]')
    robot.finish()
    assert sentences() == ['learned torques are followed']
    assert robot.task.learned.reason == ''
    robot.start('moves: [{move_l: {to_m: [0.0, 0.0, -0.75]}}]')
    robot.finish()
    (other,) = sentences()
    assert other.startswith('learned torques are not followed: they belong to ')
    robot.do('emergency_stop')
    robot.run(200)
    assert robot.do('reset')[0]
    robot.enable()
    robot.start('moves: [{move_l: {to_m: [0.2, 0.05, -0.8]}}]')
    assert sentences() == ['learned torques are not followed: a fault has dropped them']


def test_task_without_torque_commands_has_no_learned_torques(robot):
    task = task_with(robot, LEARNED_N_M)
    assert not torques_of(task, START + 200).any()


def test_exact_stop_discards_blends_and_is_reported_as_reason(model):
    moves = [
        {'move_l': {'to_m': [0.1, 0.0, -0.75], 'in_position': True}},
        {'move_l': {'to_m': [0.0, 0.0, -0.75]}},
    ]
    plan = planned(model, moves)
    cycles = round(plan.duration_s / model.bus.cycle_time_s)
    learned = Learned(np.tile(LEARNED_N_M, (cycles, 1)), Origin.of('', plan, model))
    task = Transformation(model, learned)
    task.locate(Standing(model).motors)
    task.load(plan)
    task.start(START)
    torques_of(task, START + cycles)
    assert task.learned.reason == 'the program waits at an exact stop, for a time unknown in advance'
