"""Facts about the claims of 11.1: each gets a verdict by a figure of the run, and none that the run does not tell."""

import numpy as np
import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.analysis.experiments.attribution import Attribution, outcome_of
from delta3_pacdrive.analysis.experiments.claims import FAILS, HOLDS, UNKNOWN, claims
from delta3_pacdrive.analysis.experiments.comparison import Comparison, Run
from delta3_pacdrive.motion import program_file as programs


def compared(number, robot):
    nominal = parameters.load()
    runs = []
    for own in (nominal, robot):
        program = programs.load(f'experiment{number}', own.motion)
        runs.append(Run.of(simulation.run(program, own), own))
    return Comparison.of(*runs)


@pytest.fixture(scope='module')
def first():
    return compared(1, parameters.load('rich'))


def by_text(found, part):
    (claim,) = [claim for claim in found if part in claim.text]
    return claim


def test_every_claim_of_an_experiment_gets_a_verdict_and_a_figure(first):
    found = claims(1, first, None)
    assert {claim.section for claim in found} == {'11.1.1', '11.1.4'}
    assert all(any(character.isdigit() for character in claim.figure) for claim in found[:-1])
    assert by_text(found, 'arm velocities').verdict == HOLDS
    assert by_text(found, 'in y more').verdict == HOLDS
    assert by_text(found, 'ripple').verdict == HOLDS
    assert by_text(found, 'currents').verdict == HOLDS
    # the thesis saw another robot
    norm = by_text(found, 'error norm of the model is larger')
    assert norm.verdict == FAILS
    assert norm.figure.startswith('rms 0.0466 of the model, 0.0469 mm of the robot')
    assert norm.sentence.startswith('11.1.1: the error norm of the model is larger')
    assert by_text(found, 'lacks of the dynamics').verdict == UNKNOWN
    assert claims(None, first, None) == []


def test_a_robot_like_its_model_bears_out_no_claim_of_a_difference():
    found = claims(2, compared(2, parameters.load()), None)
    assert by_text(found, 'error norms do not agree').verdict == FAILS
    assert by_text(found, 'currents deviate').verdict == FAILS
    assert by_text(found, 'ripple').verdict == FAILS
    assert by_text(found, 'arm velocities').verdict == HOLDS


@pytest.mark.parametrize(('friction', 'verdict'), [(0.8, HOLDS), (0.2, FAILS)])
def test_dynamics_explain_a_deviation_if_more_than_half_of_it_is_theirs(first, friction, verdict):
    values = np.array([0.0, friction, 1.0 - friction, 1.0])
    outcome = outcome_of(('tcp_error_norm', 'deviation'), ('friction', 'geometry'), 0.0, values)
    attribution = Attribution(('friction', 'geometry'), (), 4, {('tcp_error_norm', 'deviation'): outcome})
    claim = by_text(claims(1, first, attribution), 'lacks of the dynamics')
    assert claim.verdict == verdict
    assert claim.figure.startswith(f'{100 * friction:.0f} % of the mean square')
