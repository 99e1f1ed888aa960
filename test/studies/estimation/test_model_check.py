"""Tests of the check before an estimate: agreement of model and data."""

import numpy as np
import pytest

from delta3_pacdrive.studies.estimation.measurement import with_noise
from delta3_pacdrive.studies.estimation.model_check import check
from delta3_pacdrive.studies.estimation.problem import Block, Problem
from delta3_pacdrive.studies.estimation.quantities import TABLE
from delta3_pacdrive.studies.estimation.solver import fit
from estimated import MODELS, estimate_from, problem_of

SAMPLES, SIGMA, PERIOD_S = 4000, 0.02, 1e-3


class Line:
    """A signal that is linear in R, with noise, and with something that the model does not know."""

    step, accuracy, depends = 1e-4, 1e-8, frozenset({'R'})

    def __init__(self, missing=0.0, noise=1.0, seed=5, samples=SAMPLES):
        times = np.arange(samples)[:, None] * PERIOD_S + np.array([0.0, 0.3, 0.6])
        self.slope = np.sin(5.0 * times)
        unknown = missing * SIGMA * np.sign(np.cos(9.0 * times))
        own = noise * SIGMA * np.random.default_rng(seed).standard_normal(times.shape)
        self.data = 2.0 * self.slope + unknown + own
        self.blocks = (Block('y', 'A', SIGMA, PERIOD_S),)
        self.shapes = (self.data.shape,)

    def residuals(self, values):
        return [self.data - self.slope * values['R']]


def judged(model, robot, aside=()):
    problem = Problem([TABLE['R']], [model], robot)
    return check(problem, fit(problem, np.array([2.5])), aside)


@pytest.mark.parametrize('noise', [0.0, 0.1, 1.0])
def test_a_model_that_leaves_the_noise_of_its_sensors_or_less_holds(noise, robot):
    found = judged(Line(noise=noise), robot)
    assert found.holds
    assert found.sentences[0] == 'the model explains the data'


def test_residuals_above_the_noise_are_not_noise(robot):
    found = judged(Line(noise=1.6), robot)
    assert [block.is_small for block in found.blocks] == [False]
    assert [block.is_white for block in found.blocks] == [True]
    assert not found.holds
    assert found.sentences[0] == 'THE MODEL DOES NOT EXPLAIN THE DATA'
    assert '1.6 times the sensor noise (0.02 A)' in found.sentences[1]


def test_effect_that_repeats_with_the_motion_is_seen_below_the_noise(robot):
    found = judged(Line(missing=0.3), robot)
    (block,) = found.blocks
    assert block.is_small
    assert not block.is_white
    assert not found.holds
    assert 'correlated far beyond the memory of the model' in found.sentences[1]


def test_values_that_change_over_a_recording_do_not_predict_its_parts(robot):
    model = Line()
    model.data[SAMPLES // 2 :] *= 1.5
    (block,) = judged(model, robot).blocks
    assert not block.is_predicted
    assert block.predicted > block.rms


def test_a_recording_that_was_kept_aside_can_refute_a_model(robot):
    assert judged(Line(), robot, [Line(seed=6)]).holds
    other = Line(seed=6)
    other.data *= 1.2
    found = judged(Line(), robot, [other])
    assert [block.holds for block in found.blocks] == [True, False]
    assert found.sentences[1].startswith('y of a validation recording: residuals')


@pytest.mark.parametrize('group', MODELS)
def test_a_nominal_robot_with_noisy_sensors_is_explained_by_its_model(group, scope, bus, robot):
    exact = bus if group == 'geometry' else scope
    for seed in range(4):
        problem = problem_of(group, with_noise(exact, robot, 1.0, seed), robot)
        found = check(problem, estimate_from(problem, robot, 0.3))
        assert found.holds, found.sentences
        for block in found.blocks:
            assert 0.8 < block.rms / block.noise < 1.2
