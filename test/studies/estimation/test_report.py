"""Tests of the report of an estimation: text, tables, figures and the parameter file."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from delta3_pacdrive.studies.estimation import before_after, report
from delta3_pacdrive.studies.estimation import missing_effects as missing
from delta3_pacdrive.studies.estimation.before_after import BeforeAfter, Course
from delta3_pacdrive.studies.estimation.fitted_file import Fitted
from delta3_pacdrive.studies.estimation.identifiability import Verdict
from delta3_pacdrive.studies.estimation.problem import Block, Problem
from delta3_pacdrive.studies.estimation.quantities import GROUPS, TABLE
from delta3_pacdrive.studies.estimation.solver import Estimate, fit
from delta3_pacdrive.studies.estimation.thesis_setup import FACTORS, SYMBOLS, Attempt, Quotient, Trial
from reports_read import curves, read_line

ROW = {
    'quantity': 'F_s', 'unit': 'N m', 'estimate': 0.125, 'low_95': 0.12, 'high_95': 0.13, 'scale': 0.1,
    'half_width_relative': 0.05, 'true': 0.1, 'error_relative': 0.25, 'verdict': 'identifiable', 'reason': '',
}  # fmt: skip
DOCUMENT = {
    'identifiability': {'condition': 3.0, 'condition_of_columns': 2.0, 'collinear': []},
    'residuals': [],
    'solver': {'converged': True, 'message': ''},
}


@pytest.fixture
def compared():
    """Return a robot and two models with known differences of their signals."""
    time_s = 1e-3 * np.arange(200)
    motion = np.outer(np.sin(30.0 * time_s), [1.0, 2.0, 3.0])

    def course(current_a, error_m):
        return Course(motion + current_a, np.full(200, error_m))

    return BeforeAfter(time_s, course(0.0, 1e-4), course(0.5, 5e-4), course(0.25, 2e-4), 1e-3)


def test_messages_give_the_rms_of_model_less_robot_in_their_units(compared):
    lines = before_after.sentences(compared)
    assert [line.partition(':')[0] for line in lines] == [
        'current', 'current below 60 Hz', 'norm of the TCP error',
    ]  # fmt: skip
    assert 'model less robot 0.5 A rms before, 0.25 after: 2 times less' in lines[0]
    assert 'model less robot 0.4 mm rms before, 0.1 after: 4 times less' in lines[2]


@pytest.mark.parametrize(
    ('draw', 'unit', 'scale', 'of'),
    [
        (before_after.tcp_error, 'norm [mm]', 1e3, lambda course: course.error_norm),
        (before_after.current, 'motor 1 [A]', 1.0, lambda course: course.current[:, 0]),
    ],
)
def test_the_figures_show_the_old_model_under_before_and_the_new_one_under_after(
    draw, unit, scale, of, compared
):
    drawn = curves(draw(compared))
    for title, label, model in (('before', unit, compared.before), ('after', '', compared.after)):
        assert drawn[title, label, 'robot'] == pytest.approx(scale * of(compared.robot))
        assert drawn[title, label, 'model'] == pytest.approx(scale * of(model))


def test_the_text_gives_interval_and_true_error_in_percent():
    lines = report.text(DOCUMENT | {'estimates': [ROW]})
    read_line([' '.join(line.split()) for line in lines], 'F_s', [0.125, 0.005])
    assert '(95 %, 5 %)  true error +25 %' in lines[0]
    (uneven, *_) = report.text(DOCUMENT | {'estimates': [ROW | {'high_95': 0.15}]})
    assert '0.125, 0.12 to 0.15 N m (95 %, 5 %)  true error +25 %' in uneven


@pytest.mark.parametrize(
    ('other', 'low', 'high'),
    [((0.11, 0.14), 0.11, 0.14), ((0.124, 0.126), 0.12, 0.13), ((0.126, 0.2), 0.12, 0.2)],
)
def test_the_interval_of_a_wrong_model_reaches_over_that_of_the_better_one(other, low, high, monkeypatch):
    found = DOCUMENT | {'estimates': [ROW | {'low_95': other[0], 'high_95': other[1]}]}
    monkeypatch.setattr(report, 'fit_summary', lambda *_: found)
    verdict = SimpleNamespace(holds=False, sentences=[], blocks=())
    better = SimpleNamespace(
        fit=None, problem=None, check=SimpleNamespace(holds=True, sentences=[]), sentence='', lacking=()
    )
    (row,) = report.judged(DOCUMENT | {'estimates': [ROW]}, verdict, better, None, True)['estimates']
    assert (row['low_95'], row['high_95']) == (low, high)
    assert row['half_width_relative'] == pytest.approx(0.5 * (high - low) / 0.1)
    better.check.holds = False
    (row,) = report.judged(DOCUMENT | {'estimates': [ROW]}, verdict, better, None, True)['estimates']
    assert row['low_95'] is row['high_95'] is row['half_width_relative'] is None


@pytest.mark.parametrize('holds', [True, False])
def test_the_parameter_file_has_intervals_only_of_a_model_that_holds(holds):
    verdicts = {'F_v': Verdict.IDENTIFIABLE, 'F_s': Verdict.WEAK, 'K_m': Verdict.CONFOUNDED}
    problem = SimpleNamespace(quantities=[TABLE[symbol] for symbol in verdicts])
    found = SimpleNamespace(
        estimates=[Estimate(symbol, 'N', 1.0, 1.0, 0.25, verdict) for symbol, verdict in verdicts.items()]
    )
    fitted = Fitted(None, problem, found, holds, ())
    notes = [texts[0] for texts in fitted.notes('from log.csv').values()]
    assert ['0.25' in note for note in notes] == [holds, holds, False]
    assert notes[2] == 'K_m only together with others'
    assert notes[0] == ('F_v +- 0.25 N (95 %)' if holds else 'F_v no valid interval')


class Measured:
    """A signal of a robot with gains and ripple, by a model that knows the effects of the parameters."""

    step, accuracy = 1e-4, 1e-8
    depends = frozenset({'m_b', 'gain_1', 'T_c'})

    def __init__(self, robot, gain, ripple):
        self.sides = (
            np.sin(np.outer(np.arange(2000), [0.011, 0.012, 0.013])),
            np.cos(np.arange(6000)).reshape(-1, 3),
        )
        self.effects = robot.rich.effects
        noise = 0.01 * np.random.default_rng(3).standard_normal((2000, 3))
        self.data = self.signal({'m_b': 1.0, 'gain_1': gain, 'T_c': ripple}, True, True) + noise
        self.blocks = (Block('y', 'A', 0.01, 1e-3),)
        self.shapes = (self.data.shape,)

    def signal(self, values, has_gain, has_ripple):
        motion, ripple = self.sides
        found = values['m_b'] * np.roll(motion, 500, axis=0) + values['gain_1'] * has_gain * motion
        return found + values['T_c'] * has_ripple * ripple

    def residuals(self, values):
        return [self.data - self.signal(values, self.effects.sensors, self.effects.ripple)]


@pytest.mark.parametrize(
    ('gain', 'ripple', 'order'), [(0.05, 0.02, 'gR'), (0.03, 0.1, 'Rg'), (0.0, 0.1, 'R')]
)
def test_missing_effects_are_named_by_their_importance_and_those_that_are_there_only(
    gain, ripple, order, robot
):
    def build(one):
        return [Measured(one, gain, ripple)]

    free = (TABLE['m_b'],)
    plain = fit(Problem(free, build(robot), robot), np.array([1.3]))
    first = free, plain.x
    known = ('friction', 'gear', 'gain_2', 'gain_3', 'offset_1', 'offset_2', 'offset_3', 'a_6')
    found = missing.search(GROUPS['masses'], build, robot, first, known, lambda *_: None)
    names = {
        'g': ('sensors', 'gains and offsets of the current sensors'),
        'R': ('ripple', 'cogging and ripple of K_m'),
    }
    assert [one.effect for one in found.lacking] == [names[letter][0] for letter in order]
    left = [one.rms_without for one in found.lacking]
    assert left == sorted(left, reverse=True)
    assert found.rms == pytest.approx(1.0, abs=0.05)
    assert found.rms < min(left)
    listed = '; '.join(f'{names[c][1]} ({rms:.2g} without)' for c, rms in zip(order, left, strict=True))
    assert found.sentence.startswith(
        f'missing: {listed}; residuals of {found.rms_plain:.2g} times the sensor noise'
    )
    assert found.sentence.endswith(f'become {found.rms:.2g} and explain the data')


def test_the_tables_of_the_thesis_have_each_value_under_its_heading():
    attempt = Attempt(0.5, 0.3, (), (), (0.1, -0.2, 0.3, -0.4, 0.05), 7.0, 3.0, 11, 'done')
    quotient = Quotient('R', 0.01, 2.0, 4.0, 0.8, 16.0)
    profiles = {symbol: tuple(10.0 * n + k for k in range(len(FACTORS))) for n, symbol in enumerate(SYMBOLS)}
    study = SimpleNamespace(
        quotients=[quotient], profiles=profiles, trials=[Trial('robot', attempt, 'stays', 1.5)]
    )
    quotients, costs, attempts = (
        [dict(zip(table.header, row, strict=True)) for row in table.rows]
        for table in report.thesis_tables(study)
    )
    assert list(quotients[0].values()) == list(dataclasses.astuple(quotient))
    assert quotients[0]['quotient through encoder [noise per 100 %]'] == 2.0
    assert quotients[0]['cosine to the true slope [1]'] == 0.8
    assert quotients[0]['largest change of a shaft [increments]'] == 16.0
    for k, row in enumerate(costs):
        assert row.pop('factor [1]') == FACTORS[k]
        assert row == {f'cost over {s} less its minimum [noise^2]': profiles[s][k] for s in SYMBOLS}
    assert attempts == [
        {
            'data': 'robot', 'step [1]': 0.5, 'start off [1]': 0.3,
            **{f'{s} moved [1]': moved for s, moved in zip(SYMBOLS, attempt.moved, strict=True)},
            'largest error [1]': attempt.error, 'cost at start [SI]': 7.0, 'cost [SI]': 3.0,
            'cost of the least [1]': 1.5, 'simulations': 11, 'outcome': 'stays', 'message': 'done',
        }
    ]  # fmt: skip
