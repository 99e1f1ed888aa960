"""Tests of sweep files: their meaning, and errors with their places."""

import pytest

from delta3_pacdrive.errors import SweepError
from delta3_pacdrive.studies.fleet.sweep.specification import load
from delta3_pacdrive.studies.fleet.sweep.study import Kept, Law, Reduction, Sampling, Variation

SMALL = """\
program: experiment1
runs: 4
vary:
  dynamics.payload_mass_kg: {uniform: [0.0, 2.0]}
"""


def written(tmp_path, text, name='own.yaml'):
    path = tmp_path / name
    path.write_text(text, encoding='utf-8')
    return path


def test_file_defines_varied_and_recorded_values(tmp_path):
    sweep = load(
        written(
            tmp_path,
            """\
program: experiment1
parameters: rich
runs: 10
sampling: sobol
seed: 7
vary:
  motor.torque_constant_n_m_a: {normal: [0.78, 0.01]}
  rich.current_gain_error[2]: {list: [0.0, 0.01]}
  rich.sensor_seed: run
  program.moves[0].move_l.speed_m_s: {uniform: [0.5, 1.0]}
keep:
- tcp_error_max_m
- {name: end_a, signal: current, of: final, axis: 2, from_s: 0.1, to_s: 0.4}
- {name: off_m, signal: tcp_true, less: tcp_command, of: rms}
limits: {off_m: 0.001}
""",
        )
    )
    assert (sweep.name, sweep.program_name, sweep.runs, sweep.sampling, sweep.seed) == (
        'own', 'experiment1', 10, Sampling.SOBOL, 7,
    )  # fmt: skip
    assert sweep.parameters['rich.enabled'] is True
    assert sweep.vary == (
        Variation('motor.torque_constant_n_m_a', Law.NORMAL, (0.78, 0.01)),
        Variation('rich.current_gain_error[2]', Law.LIST, (0.0, 0.01)),
        Variation('rich.sensor_seed', Law.RUN),
        Variation('program.moves[0].move_l.speed_m_s', Law.UNIFORM, (0.5, 1.0)),
    )
    assert sweep.keep == (
        Kept('tcp_error_max_m'),
        Kept('end_a', 'current', '', Reduction.FINAL, 2, 0.1, 0.4),
        Kept('off_m', 'tcp_true', 'tcp_command', Reduction.RMS),
    )
    assert sweep.limits == {'off_m': 0.001}


@pytest.mark.parametrize(
    ('change', 'place', 'sentence'),
    [
        (('runs: 4', 'runs: 0'), '2:7', 'runs is 0, but must be a whole number between 1'),
        (('runs: 4', 'rns: 4'), '2:1', 'unknown key'),
        (('dynamics.payload_mass_kg', 'dynamics.payload_kg'), '4:3', 'unknown parameter'),
        (('{uniform: [0.0, 2.0]}', '{uniform: [2.0, 0.0]}'), '4:', 'the first number must be the smaller one'),
        (('{uniform: [0.0, 2.0]}', '{normal: [2.0, -1.0]}'), '4:', 'is a standard deviation'),
        (('{uniform: [0.0, 2.0]}', '{normal: [2.0, 1.0], list: [1]}'), '4:', 'or one of list, uniform, normal'),
        (('{uniform: [0.0, 2.0]}', 'often'), '4:', 'must be a mapping'),
        (('dynamics.payload_mass_kg', 'program.moves[90].move_l.to_m'), '4:3', 'the program has no moves[90]'),
        (('dynamics.payload_mass_kg', 'program.moves[0]move_l'), '4:3', 'the program has no moves[0]move_l'),
        (('dynamics.payload_mass_kg', 'rich.current_gain_error[3]'), '4:3', 'has 3 values, counted from 0'),
        (('dynamics.payload_mass_kg', 'motor.rotor_inertia_kg_m2[0]'), '4:3', 'has 1 values, counted from 0'),
    ],
)  # fmt: skip
def test_error_gives_place_and_reason(change, place, sentence, tmp_path):
    path = written(tmp_path, SMALL.replace(*change))
    with pytest.raises(SweepError) as told:
        load(path)
    assert f'{path}:{place}' in str(told.value)
    assert sentence in str(told.value)
    assert '\n' not in str(told.value)


@pytest.mark.parametrize(
    ('more', 'sentence'),
    [
        ('keep: [tcp_error_mx_m]', 'did you mean tcp_error_max_m?'),
        ('keep: [tcp_error_max_m, tcp_error_max_m]', 'the name tcp_error_max_m is used twice'),
        ('keep: [{name: own, signal: tcp}]', 'must be a signal'),
        ('keep: [{name: a b, signal: tcp_true}]', 'must be a name of letters'),
        ('limits: {tcp_error: 1.0}', 'must be one of'),
        ('function: own.py', 'cannot read'),
        ('sampling: sobl', 'did you mean sobol?'),
    ],
)
def test_kept_results_must_exist(more, sentence, tmp_path):
    with pytest.raises(SweepError, match=f'own.yaml:.*{sentence}'.replace('?', r'\?')):
        load(written(tmp_path, f'{SMALL}{more}\n'))


def test_python_file_has_the_same_keys_and_a_function(tmp_path):
    source = f"""\
import yaml
SPEC = yaml.safe_load('''{SMALL}''')


def figures(trace):
    return {{'cycles': len(trace.time_s)}}
"""
    sweep, same = load(written(tmp_path, source, 'own.py')), load(written(tmp_path, SMALL))
    assert sweep.vary == same.vary
    assert sweep.function == source
    assert sweep.digest != same.digest


@pytest.mark.parametrize(
    ('source', 'sentence'),
    [
        ('x = 1', 'does not define a dictionary SPEC'),
        ('1 / 0', 'cannot be run: ZeroDivisionError'),
        ('(', 'SyntaxError'),
    ],
)
def test_invalid_python_file_is_rejected_with_one_message(source, sentence, tmp_path):
    with pytest.raises(SweepError, match=sentence) as told:
        load(written(tmp_path, source, 'own.py'))
    assert '\n' not in str(told.value)


def test_digest_depends_only_on_inputs_of_the_results(tmp_path):
    first = load(written(tmp_path, SMALL)).digest
    assert load(written(tmp_path, f'{SMALL}name: other\nlimits: {{tcp_error_max_m: 1.0}}\n')).digest == first
    for other in (
        SMALL.replace('4', '5'),
        SMALL.replace('2.0]', '3.0]'),
        f'{SMALL}seed: 2\n',
        f'{SMALL}keep: [tcp_error_max_m]\n',
    ):
        assert load(written(tmp_path, other)).digest != first


def test_programs_and_parameters_are_relative_to_the_file(tmp_path):
    program = 'moves:\n- move_l: {to_m: [0.1, 0.0, -0.8]}\n'
    (tmp_path / 'experiment1.yaml').write_text(program, encoding='utf-8')
    sweep = load(written(tmp_path, SMALL.replace('experiment1', 'experiment1.yaml')))
    assert len(sweep.program['moves']) == 1
