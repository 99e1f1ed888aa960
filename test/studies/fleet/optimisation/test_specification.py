"""Tests of optimisation files: their meaning, and errors with their places."""

import pytest

from delta3_pacdrive.errors import SweepError
from delta3_pacdrive.studies.fleet.optimisation.specification import load

pytest.importorskip('optuna', reason='optimisations need the extra "optimise"')

SPEC = """\
program: experiment1
trials: 20
seed: 7
vary:
  drive.velocity_gain_a_s_rad: {uniform: [0.1, 0.5]}
  drive.interpolation: {list: [linear, cubic]}
goal: {minimise: tcp_error_max_m}
limits: {current_rms_a_1: 2.5}
"""


@pytest.fixture
def read(tmp_path):
    def made(*changes):
        text = SPEC
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / 'own.yaml').write_text(text, encoding='utf-8')
        return load(tmp_path / 'own.yaml')

    return made


def test_file_defines_goal_trials_and_limits(read):
    own = read()
    assert (own.goal, own.maximise, own.together) == ('tcp_error_max_m', False, 8)
    assert (own.sweep.runs, own.sweep.seed, own.sweep.limits) == (20, 7, {'current_rms_a_1': 2.5})
    assert [one.key for one in own.sweep.vary] == ['drive.velocity_gain_a_s_rad', 'drive.interpolation']
    own = read(('minimise: tcp_error_max_m', 'maximise: program_s'), ('seed', 'together: 3\nseed'))
    assert (own.goal, own.maximise, own.together) == ('program_s', True, 3)


def test_a_folder_is_that_of_the_same_search_however_many_trials_there_are(read):
    same, digest = read(('trials: 20', 'trials: 40')).sweep.digest, read().sweep.digest
    assert same == digest
    for change in (
        ('seed: 7', 'seed: 8'),
        ('minimise', 'maximise'),
        ('seed: 7', 'together: 4'),
        ('2.5}', '2.6}'),
        ('[0.1, 0.5]', '[0.1, 0.6]'),
        ('tcp_error_max_m', 'tcp_error_rms_m'),
    ):
        assert read(change).sweep.digest != digest


@pytest.mark.parametrize(
    ('change', 'place', 'sentence'),
    [
        (('trials: 20', 'trials: 0'), '2:9', 'trials is 0, but must be'),
        (('trials: 20\n', ''), '1:1', 'missing key trials'),
        (('goal: {minimise: tcp_error_max_m}\n', ''), '1:1', 'missing key goal'),
        (('minimise: tcp_error_max_m', 'minimise: tcp_error'), '7:18', "goal.minimise is 'tcp_error', but must be"),
        (('{minimise: tcp_error_max_m}', '{}'), '7:7', 'goal must be minimise or maximise of one number'),
        (('{uniform: [0.1, 0.5]}', '{normal: [0.1, 0.5]}'), '5:3', 'is normal, but must be list or uniform'),
        (('{list: [linear, cubic]}', 'run'), '6:3', 'is run, but must be list or uniform'),
        (('seed: 7', 'sampling: grid'), '3:1', "unknown key 'sampling'"),
        (('seed: 7', 'together: 100'), '3:11', 'together is 100, but must be'),
    ],
)  # fmt: skip
def test_error_is_reported_with_its_place(change, place, sentence, read):
    with pytest.raises(SweepError) as told:
        read(change)
    assert sentence in str(told.value)
    assert f'own.yaml:{place}: ' in str(told.value)
