"""Tests of single runs of a sweep: assignment of values, and rows of failed runs."""

import dataclasses
import json

import numpy as np
import pytest
import yaml

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.errors import SweepError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.studies.fleet.sweep import single_run
from delta3_pacdrive.studies.fleet.sweep.program_values import value_at, with_value
from delta3_pacdrive.studies.fleet.sweep.single_run import Runner, figure_names, figures_of, reduced
from delta3_pacdrive.studies.fleet.sweep.specification import load
from delta3_pacdrive.studies.fleet.sweep.study import Kept, Outcome, Reduction

SPEC = """\
program: short.yaml
parameters: delta3
runs: 3
vary:
  dynamics.payload_mass_kg: {uniform: [0.0, 2.0]}
"""
SHORT = """\
start_m: [0.0, 0.0, -0.8]
moves:
- move_l: {to_m: [0.05, 0.0, -0.8], speed_m_s: 0.5, in_position: true}
- move_l: {to_m: [0.0, 0.0, -0.8]}
"""


@pytest.fixture
def sweep(tmp_path):
    (tmp_path / 'short.yaml').write_text(SHORT, encoding='utf-8')

    def made(text=SPEC):
        (tmp_path / 'own.yaml').write_text(text, encoding='utf-8')
        return load(tmp_path / 'own.yaml')

    return made


@pytest.fixture(scope='module')
def trace():
    robot = parameters.load()
    return simulation.run(program_file.load('experiment1', robot.motion), robot)


def test_values_are_those_of_parameters_of_one_of_several_and_of_the_program(sweep):
    values = {
        'dynamics.payload_mass_kg': np.float64(1.5),
        'rich.current_gain_error[1]': 0.02,
        'rich.sensor_seed': np.int64(3),
        'program.moves[0].move_l.speed_m_s': 0.25,
        'program.moves[1].move_l.acceleration_m_s2': 3.0,  # not given in the file
    }
    robot, program = Runner(sweep()).made(values)
    assert robot.dynamics.payload_mass_kg == 1.5
    assert robot.rich.current_gain_error == (
        *robot.rich.current_gain_error[:1],
        0.02,
        robot.rich.current_gain_error[2],
    )
    assert robot.rich.sensor_seed == 3
    first, second = program.statements
    assert first.limits.speed_m_s == 0.25
    assert second.limits.acceleration_m_s2 == 3.0


def test_moves_without_a_speed_have_that_of_their_run(sweep):
    runner = Runner(sweep())
    for speed in (0.4, 0.3, 0.3):
        _, program = runner.made({'motion.speed_max_m_s': speed})
        assert program.statements[1].limits.speed_m_s == speed


def test_row_has_the_figures_of_its_run(sweep):
    row = Runner(sweep()).run(2, {'dynamics.payload_mass_kg': 1.0})
    robot = parameters.load().replace(dynamics__payload_mass_kg=1.0)
    told = simulation.run(program_file.parse(sweep().program, robot.motion), robot)
    assert row == {'run': 2, 'outcome': Outcome.DONE, 'reason': ''} | figures_of(told)
    assert set(row) == {'run', 'outcome', 'reason', *figure_names()}


def test_rejected_or_stopped_run_is_a_row_with_its_reason(sweep):
    runner = Runner(sweep())
    heavy = runner.run(1, {'dynamics.payload_mass_kg': 50.0})
    assert heavy['outcome'] == Outcome.REFUSED
    assert 'payload_mass_kg' in heavy['reason']
    far = runner.run(2, {'program.moves[0].move_l.to_m': [2.0, 0.0, -0.8]})
    assert far['outcome'] == Outcome.REFUSED
    fault = {'fault': 'encoder_jump', 'axis': 'axis1', 'jump_rad': 3.0, 'after_s': 0.05}
    stopped = runner.run(3, {'program.faults': [fault]})
    assert stopped['outcome'] == Outcome.STOPPED
    assert '8171' in stopped['reason']
    assert runner.run(4, {})['outcome'] == Outcome.DONE


@pytest.mark.parametrize(
    ('values', 'plans'),
    [
        ({'drive.velocity_gain_a_s_rad': (0.3, 0.4)}, 1),
        ({'rich.sensor_seed': (1, 2)}, 1),
        ({'drive.dc_link_voltage_v': (560.0, 500.0)}, 2),
        ({'dynamics.payload_mass_kg': (0.5, 0.6)}, 2),
        ({'program.moves[0].move_l.speed_m_s': (0.5, 0.4)}, 2),
        ({'motor.winding_inductance_h': (0.02, 0.021)}, 1),
        ({'motor.torque_constant_n_m_a': (0.78, 0.79)}, 2),
        ({'motion.speed_max_m_s': (0.4, 0.3)}, 2),  # of the second move
        ({'drive.position_period_s': (250e-6, 1e-3)}, 2),  # exact stops wait as long as the drives are late
        ({'control.shaping': ('none', 'zv')}, 2),
    ],
)
def test_only_dependent_moves_are_planned_again_with_the_same_bits(values, plans, sweep, monkeypatch):
    made, plan = [], program_planner.plan
    monkeypatch.setattr(single_run.program_planner, 'plan', lambda *args: made.append(1) or plan(*args))
    runner = Runner(sweep())
    ((key, several),) = values.items()
    for value in several:
        robot, program = runner.made({key: value})
        runner.traced(robot, program)
        before = len(made)
        kept = runner.traced(robot, program)
        assert len(made) == before
        fresh = simulation.run(program, robot)
        assert all(np.array_equal(kept[name], fresh[name]) for name in fresh.signals)
    assert len(made) == plans


class Read:
    """Notes which values of parameters are read."""

    def __init__(self, own, names, beginning=''):
        self.__dict__ |= {'_own': own, '_names': names, '_beginning': beginning}

    def __getattr__(self, name):
        told = getattr(type(self._own), name, None)
        if isinstance(told, property):
            return told.fget(self)
        value, full = getattr(self._own, name), f'{self._beginning}{name}'
        if dataclasses.is_dataclass(value):
            return Read(value, self._names, f'{full}.')
        self._names.add(full)
        return value


EVERYTHING = """\
start_m: [0.0, 0.0, -0.8]
moves:
- move_l: {to_m: [0.05, 0.0, -0.8], blend_m: 0.01}
- move_l: {to_m: [0.05, 0.05, -0.8], in_position: true}
- output: {name: gripper, value: true, payload_kg: 0.3}
- move_l: {to_m: [0.0, 0.05, -0.8], time_optimal: true}
- cubic: {to_m: [0.0, 0.0, -0.8], duration_s: 0.5}
- dwell: {time_s: 0.01}
- arch: {to_m: [0.1, 0.0, -0.8], up_m: 0.02, down_m: 0.02}
- joints: {points: [{time_s: 1.0, angles_deg: [10.0, 10.0, 10.0]}]}
"""


def test_plan_depends_only_on_declared_values():
    robot, names = parameters.load(), set()
    programs = [
        program_file.load('experiment1', robot.motion),
        program_file.parse(yaml.safe_load(EVERYTHING), robot.motion),
    ]
    for program in programs:
        placed = simulation.placed(robot, program)
        program_planner.plan(program, placed.motion.home_m, Read(placed, names))
    assert {'motor.torque_constant_n_m_a', 'kinematics.forearm_length_m', 'drive.position_period_s'} <= names
    assert [name for name in sorted(names) if not single_run.is_planned(name)] == ['control.shaping']


def test_reductions_are_those_of_the_signal(trace):
    assert reduced(trace, Kept('x', 'current')) == np.abs(trace['current']).max()
    begin = trace.meta['start_cycle']
    part = trace['current'][begin + 100 : begin + 201, 1]
    own = Kept('x', 'current', '', Reduction.RMS, 2, 0.1, 0.2)
    assert reduced(trace, own) == pytest.approx(np.sqrt(np.mean(part**2)), rel=1e-12)
    off = np.linalg.norm(trace['tcp_true'] - trace['tcp_command'], axis=1)[begin:]
    assert reduced(trace, Kept('x', 'tcp_true', 'tcp_command', Reduction.MAX)) == off.max()
    assert reduced(trace, Kept('x', 'tcp_true', 'tcp_command', Reduction.MEAN)) == off.mean()
    assert (
        reduced(trace, Kept('x', 'motor_speed', '', Reduction.MIN, 3))
        == trace['motor_speed'][begin:, 2].min()
    )
    assert reduced(trace, Kept('x', 'tcp_actual', '', Reduction.FINAL)) == np.linalg.norm(
        trace['tcp_actual'][-1]
    )


@pytest.mark.parametrize(
    ('kept', 'sentence'),
    [
        (Kept('own'), "there is no figure 'own'"),
        (Kept('x', 'cell_vacuum'), 'a run contains no signal cell_vacuum'),
        (Kept('x', 'current', axis=4), 'axis is 4, but current has 3 columns'),
        (Kept('x', 'current', from_s=90.0), 'there is no sample from 90 to inf s'),
    ],
)
def test_value_without_a_run_ends_the_sweep(kept, sentence, trace):
    with pytest.raises(SweepError, match=sentence):
        reduced(trace, kept)


def test_user_function_adds_its_numbers_and_its_error_ends_the_sweep(sweep, tmp_path):
    source = 'def figures(trace):\n    return {"cycles": len(trace.time_s)}\n'
    (tmp_path / 'own.py').write_text(source, encoding='utf-8')
    row = Runner(sweep(f'{SPEC}function: own.py\nkeep: [tcp_error_max_m]\n')).run(1, {})
    assert row['cycles'] > 100.0
    assert set(row) == {'run', 'outcome', 'reason', 'tcp_error_max_m', 'cycles'}
    (tmp_path / 'own.py').write_text(source.replace('trace.time_s', 'trace.time'), encoding='utf-8')
    with pytest.raises(SweepError, match='figures of the sweep: AttributeError'):
        Runner(sweep(f'{SPEC}function: own.py\n')).run(1, {})


def test_a_value_of_a_document_is_changed_in_a_copy():
    document = json.loads('{"a": [{"b": 1}, {"b": 2}]}')
    assert value_at(document, 'a[1].b') == 2
    assert value_at(document, 'a[1].c') is None
    assert with_value(document, 'a[1].c', 3) == {'a': [{'b': 1}, {'b': 2, 'c': 3}]}
    assert document == {'a': [{'b': 1}, {'b': 2}]}
    for path in ('a[2].b', 'b.c', 'a.b', 'a[1]b', '', 'a..b'):
        with pytest.raises(KeyError):
            value_at(document, path)
