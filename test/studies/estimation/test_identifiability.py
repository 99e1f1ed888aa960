"""Tests of the information that signals contain about a parameter."""

import numpy as np
import pytest

from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.studies.estimation.identifiability import Verdict, analyse, analyse_jacobian
from delta3_pacdrive.studies.estimation.models import TorqueModel
from delta3_pacdrive.studies.estimation.problem import Block, Problem
from delta3_pacdrive.studies.estimation.quantities import TABLE, start_values
from delta3_pacdrive.studies.estimation.replay_model import ReplayModel
from delta3_pacdrive.studies.estimation.solver import whiteness_of
from estimated import EXACT, errors, estimate_from, problem_of, shown


def verdicts(problem, robot):
    x = start_values(problem.quantities, robot, 0.0)
    return {f.symbol: f.verdict for f in analyse(problem, x).findings}


def test_classification_is_invisible_confounded_weak_or_identifiable():
    generator = np.random.default_rng(1)
    a, b, c = generator.standard_normal((3, 1000))
    columns = np.stack([a, 2.0 * a, 1e-2 * b, np.zeros(1000), c], axis=-1)
    report = analyse_jacobian([columns], ['a', 'twice', 'weak', 'nothing', 'c'], 1e-8)
    assert [f.verdict for f in report.findings] == [
        Verdict.CONFOUNDED,
        Verdict.CONFOUNDED,
        Verdict.WEAK,
        Verdict.INVISIBLE,
        Verdict.IDENTIFIABLE,
    ]
    assert report.findings[0].partners == ('twice',)
    assert report.findings[1].partners == ('a',)
    assert report.rank == len(report.estimated) == 3
    assert report.shows(np.array([1.0, 2.0, 0.0, 0.0, 0.0]))
    assert not report.shows(np.array([1.0, -2.0, 0.0, 0.0, 0.0]))
    assert report.findings[4].relative_error == pytest.approx(1.0 / np.linalg.norm(c), rel=0.01)


@pytest.mark.parametrize(
    ('percent', 'verdict'),
    [(9.9, Verdict.IDENTIFIABLE), (10.1, Verdict.WEAK), (19.0, Verdict.WEAK)],
)
def test_a_quantity_is_weak_from_a_half_width_of_10_percent_of_its_value_on(percent, verdict):
    """A single column of length l has the standard deviation 1/l, and 1.96 of these as the half width."""
    column = np.zeros((100, 1))
    column[0] = 1.959964 / (1e-2 * percent)
    (finding,) = analyse_jacobian([column], ['a'], 1e-8).findings
    assert finding.verdict is verdict
    assert f'+-{percent:.0f} %' in finding.reason.replace('9.9', '10')


def test_nearly_collinear_quantities_are_named():
    generator = np.random.default_rng(2)
    a, b, c = generator.standard_normal((3, 1000))
    report = analyse_jacobian([np.stack([a, a + 0.01 * b, c], axis=-1)], ['a', 'b', 'c'], 1e-8)
    (group,) = report.collinear
    assert group.symbols == ('a', 'b')
    assert group.condition_index > 100.0


@pytest.mark.parametrize('model', [TorqueModel, ReplayModel])
def test_masses_show_in_three_sums_only(model, scope, bus, robot):
    trace = scope if model is TorqueModel else bus
    found = verdicts(problem_of('masses', trace, robot, models=[model(trace, robot)]), robot)
    assert {s for s, v in found.items() if v is Verdict.CONFOUNDED} == {'m_c', 'm_fb', 'm_n', 'm_payload'}


def test_without_the_torque_constant_masses_show_in_ratios_only(scope, robot):
    found = estimate_from(problem_of('masses', scope, robot, free=['K_m']), robot, 0.1)
    assert shown(found).keys() == {'m_nt / K_m', 'm_br r_Gb / K_m', 'F_s / K_m', 'F_v / K_m'}
    assert max(map(abs, errors(found, robot).values())) < EXACT


def test_rotor_and_brake_inertia_show_in_their_sum_only(scope, robot):
    found = estimate_from(problem_of('motor', scope, robot, free=['I_brake']), robot, 0.3)
    assert {'I_m', 'I_brake'}.isdisjoint(shown(found))
    assert abs(errors(found, robot)['I_m + I_brake']) < EXACT


def test_a_measuring_frame_that_may_turn_hides_the_common_azimuth(bus, robot):
    problem = problem_of('geometry', bus, robot, free=['r_z', 'theta0_1', 'theta0_2', 'theta0_3'])
    found = estimate_from(problem, robot, 0.1)
    assert {'alpha_1', 'alpha_2', 'alpha_3', 'r_z'}.isdisjoint(shown(found))
    assert {'alpha_2 - alpha_1', 'alpha_3 - alpha_1', 'theta0_1', 'l_A'} <= shown(found).keys()
    assert max(map(abs, errors(found, robot).values())) < EXACT


def test_resistance_and_inductance_need_the_voltage(scope, bus, robot):
    blind = problem_of('motor', scope, robot, models=[TorqueModel(scope, robot)])
    found = verdicts(blind, robot)
    assert found['R'] is found['L'] is Verdict.INVISIBLE
    assert found['F_s'] is found['I_m'] is Verdict.IDENTIFIABLE
    closed_loop = problem_of('motor', bus, robot, models=[ReplayModel(bus, robot)])
    x = start_values(closed_loop.quantities, robot, 0.0)
    hidden = {f.symbol: f for f in analyse(closed_loop, x).findings}
    plain = {f.symbol: f for f in analyse(problem_of('motor', scope, robot), x).findings}
    assert hidden['R'].verdict is Verdict.WEAK
    assert hidden['R'].sensitivity < 1e-2 * plain['R'].sensitivity
    assert hidden['K_m'].sensitivity > 1e2 * hidden['R'].sensitivity


def test_whiteness_of_residuals_is_tested():
    noise = np.random.default_rng(3).standard_normal((4000, 3))
    coloured = noise.copy()
    for n in range(1, len(coloured)):
        coloured[n] += 0.9 * coloured[n - 1]
    assert whiteness_of(noise).lag == 1
    assert 10 < whiteness_of(coloured).lag < 40  # 0.9^lag falls below 0.1 at 22


def test_a_prior_separates_collinear_quantities_and_contributes_its_variance():
    a = np.random.default_rng(3).standard_normal(1000)
    columns = np.stack([a, 2.0 * a], axis=-1)
    alone = analyse_jacobian([columns], ['own', 'setting'], 1e-8)
    assert alone.verdict('own') is Verdict.CONFOUNDED
    sigma = 0.05
    found = analyse_jacobian([columns], ['own', 'setting'], 1e-8, (), np.array([0.0, 1.0 / sigma]))
    assert found.estimated == (0, 1)
    own, setting = found.findings
    # own + 2 setting is measured with 1/|a|, and the setting is only known by its prior
    assert own.relative_error == pytest.approx(np.hypot(1.0 / np.linalg.norm(a), 2.0 * sigma), rel=1e-9)
    assert setting.relative_error == pytest.approx(sigma, rel=1e-9)
    assert setting.sensitivity == pytest.approx(2.0 * np.linalg.norm(a), rel=1e-12)  # of the signals alone


class Border:
    """A model that is unstable beyond a value of K_m: residuals equal to its square."""

    blocks = (Block('current', 'A', 1.0, 1e-3),)
    shapes = ((4, 3),)
    depends = frozenset({'K_m'})
    step, accuracy = 1e-3, 1e-6

    def __init__(self, lowest, highest):
        self._lowest, self._highest = lowest, highest

    def residuals(self, values):
        inside = self._lowest <= values['K_m'] <= self._highest
        return [np.full((4, 3), values['K_m'] ** 2 if inside else np.nan)]


@pytest.mark.parametrize(
    ('lowest', 'highest', 'rel'), [(0.0, 9.0, 1e-9), (0.78, 9.0, 1e-3), (0.0, 0.78, 1e-3)]
)
def test_slopes_at_the_border_of_stability_are_one_sided(lowest, highest, rel, robot):
    problem = Problem([TABLE['K_m']], [Border(lowest, highest)], robot)
    (slopes,) = problem.jacobian(np.array([0.78]))
    assert slopes == pytest.approx(2.0 * 0.78 * 0.78, rel=rel)  # per K_m


def test_a_model_that_is_unstable_on_both_sides_is_rejected_with_the_quantity(robot):
    problem = Problem([TABLE['K_m']], [Border(0.78, 0.78)], robot)
    with pytest.raises(EstimationError, match=r'unstable with K_m near 0\.78 N m/A: check signs'):
        problem.jacobian(np.array([0.78]))
