"""The claims of 11.1.1 to 11.1.4: verdict of a run, its numbers, and their range over seeds.

The thesis shows plots without numbers, so the limits for a significant difference are chosen here.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from delta3_pacdrive.studies.thesis.experiments.attribution import Attribution
from delta3_pacdrive.studies.thesis.experiments.compared_signals import Run
from delta3_pacdrive.studies.thesis.experiments.comparison import Comparison, Statistics

HOLDS, FAILS, UNKNOWN = 'holds', 'does not hold', 'cannot be known'
DEPENDS = 'depends on the seed'
LAST, OF_ALL = 3, 0  # last experiment; 11.1.4 is about all of them
ALIKE_PERCENT = 1.0  # rms of the deviation relative to the peak: invisible in a printed figure
APART_PERCENT = 10.0  # rms of the deviation relative to the model's rms: clearly visible
FOLLOWS_PERCENT = 20.0  # largest rms deviation of an acceleration that follows its reference
RIPPLE_RATIO = 1.5  # visible ratio of the robot's ripple to the model's
DYNAMICS_PERCENT = 50.0  # share of the mean square at which dynamics explain a deviation
RIPPLE_CYCLES = 5  # half width of the moving average that is subtracted

PLANE = 'the model is symmetric to the plane of the motion, so it has no error in y'
NOISE = 'only the robot has sensor noise and cogging'


@dataclass(frozen=True)
class ArmSpeeds:
    """Figures of the arm speeds of an experiment, for comparison with other experiments."""

    ripple_deg_s: float  # of the robot
    apart_percent: float | None  # rms deviation relative to the peak; None if the model does not move

    @classmethod
    def of(cls, comparison: Comparison) -> 'ArmSpeeds':
        """Return the figures of a model and a robot with recorded arm speeds."""
        (row,) = [row for row in comparison.statistics() if (row.signal, row.column) == ('arm_speed', 'all')]
        return cls(ripple_deg_s(comparison, comparison.robot), row.deviation_rms_percent)


@dataclass(frozen=True)
class Value:
    """Number that decides a claim by comparison with a limit."""

    number: float
    unit: str  # unit and reference, such as '% of the peak'
    limit: float
    holds_above: bool  # whether the claim holds above the limit, or below it
    figure: str  # description of the numbers

    @property
    def verdict(self) -> str:
        """``HOLDS`` or ``FAILS``."""
        holds = self.number > self.limit if self.holds_above else self.number < self.limit
        return HOLDS if holds else FAILS


@dataclass(frozen=True)
class Claim:
    """Claim of the thesis."""

    section: str
    text: str  # paraphrase of the claim
    verdict: str  # HOLDS, FAILS, DEPENDS or UNKNOWN
    figure: str  # description of the numbers; the reason for UNKNOWN
    value: Value | None = None  # None for UNKNOWN
    low: float | None = None  # smallest value over this run and other seeds; None without seeds
    high: float | None = None  # largest value
    seeds: int = 0  # number of other seeds
    by_construction: str = ''  # why the claim holds for any parameter values; empty if it does not

    @classmethod
    def of(cls, section: str, text: str, found: 'Value | str', by_construction: str = '') -> 'Claim':
        """Return a claim that a number decides, or that is unknown for a reason."""
        if isinstance(found, str):
            return cls(section, text, UNKNOWN, found)
        reason = by_construction if found.verdict == HOLDS else ''
        return cls(section, text, found.verdict, found.figure, found, by_construction=reason)

    @property
    def sentence(self) -> str:
        """The claim with its verdict in one line."""
        line = f'{self.section}: {self.text}: {self.verdict.upper()}: {self.figure}'
        if self.value is not None and self.low != self.high:
            line += f'; {self.low:.3g} to {self.high:.3g} {self.value.unit} over {self.seeds + 1} seeds'
        return line + (f'; true by construction: {self.by_construction}' if self.by_construction else '')

    def over(self, others: Sequence['Claim']) -> 'Claim':
        """Return the claim with its range over runs with other seeds."""
        values = [one.value for one in (self, *others) if one.value is not None]
        if self.value is None or len(values) < 2:
            return self
        verdicts = {value.verdict for value in values}
        numbers = [value.number for value in values]
        return replace(
            self,
            verdict=self.verdict if len(verdicts) == 1 else DEPENDS,
            low=min(numbers),
            high=max(numbers),
            seeds=len(values) - 1,
            by_construction=self.by_construction if len(verdicts) == 1 else '',
        )


def claims_over_seeds(own: Sequence[Claim], seeded: Iterable[Sequence[Claim]]) -> list[Claim]:
    """Return the claims of a run with their ranges over runs of the same robot with other seeds."""
    return [claim.over(others) for claim, *others in zip(own, *seeded, strict=True)]


def claims(
    number: int | None,
    comparison: Comparison,
    attribution: Attribution | None,
    elsewhere: Mapping[int, ArmSpeeds] | None = None,
) -> list[Claim]:
    """Check a run of an experiment against all claims of its section and of 11.1.4; empty for other programs.

    ``elsewhere`` contains the arm speeds of the same model and robot in other experiments by number, if available.
    """
    if number is None:
        return []
    rows = {(row.signal, row.column): row for row in comparison.statistics()}
    section = f'11.1.{number}'

    def judged(*experiments: int | None) -> list[Claim]:
        return [
            Claim.of(
                section if one.experiment != OF_ALL else '11.1.4',
                one.text,
                one.judge(rows[one.signal]) if one.signal in rows else f'a run lacks {one.signal[0]}',
                one.by_construction,
            )
            for one in ROWS
            if one.experiment in experiments
        ]

    velocities, acceleration = judged(None)
    better = [_better(section, rows, elsewhere or {})] if number == LAST else []
    ripple = _ripple(section, number, comparison, elsewhere or {})
    own = [velocities, *better, ripple, acceleration, *judged(number)]
    return [*own, *judged(OF_ALL), _dynamics(attribution)]


Judge = Callable[[Statistics], Value | str]


def _alike(row: Statistics) -> Value | str:
    percent = row.deviation_rms_percent
    if percent is None:
        return 'the model does not move'
    figure = f'{row.deviation_rms:.2g} {row.unit} rms apart, {percent:.2g} % of the peak'
    return Value(percent, '% of the peak', ALIKE_PERCENT, False, figure)


def _apart(row: Statistics) -> Value | str:
    share = 100.0 * row.deviation_rms / row.model_rms if row.model_rms > 0.0 else math.inf
    figure = f'{row.deviation_rms:.3g} {row.unit} rms apart, {share:.2g} % of the rms of the model'
    return Value(share, '% of the rms of the model', APART_PERCENT, True, figure)


def _follows(row: Statistics) -> Value | str:
    if row.model_from_reference_rms is None or not row.model_rms:
        return 'the run has no reference'
    share = 100.0 * row.model_from_reference_rms / row.model_rms
    figure = f'model {row.model_from_reference_rms:.3g} {row.unit} rms from its reference, {share:.2g} % of its rms'
    return Value(share, '% of its rms', FOLLOWS_PERCENT, False, figure)


def _reached(row: Statistics) -> Value | str:
    if row.model_from_reference_rms is None or not row.peak:
        return 'the run has no reference'
    share = 100.0 * row.model_from_reference_rms / row.peak
    figure = f'model {row.model_from_reference_rms:.2g} {row.unit} rms from its reference, {share:.2g} % of the peak'
    return Value(share, '% of the peak', ALIKE_PERCENT, False, figure)


def _robot_more(row: Statistics) -> Value | str:
    return _from_reference(row, -1.0, 'robot minus model')


def _model_more(row: Statistics) -> Value | str:
    return _from_reference(row, 1.0, 'model minus robot')


def _from_reference(row: Statistics, sign: float, what: str) -> Value | str:
    model, robot = row.model_from_reference_rms, row.robot_from_reference_rms
    if model is None or robot is None:
        return 'a run has no reference'
    figure = f'model {model:.3g}, robot {robot:.3g} {row.unit} rms from the reference'
    return Value(sign * (model - robot), f'{row.unit} ({what})', 0.0, True, figure)


def _larger_norm(row: Statistics) -> Value | str:
    figure = (
        f'rms {row.model_rms:.3g} of the model, {row.robot_rms:.3g} {row.unit} of the robot; '
        f'at most {row.model_max:.3g} and {row.robot_max:.3g}'
    )
    return Value(row.model_rms - row.robot_rms, f'{row.unit} (model minus robot)', 0.0, True, figure)


def _better(
    section: str, rows: dict[tuple[str, str], Statistics], elsewhere: Mapping[int, ArmSpeeds]
) -> Claim:
    text = 'the model follows the velocities of the robot better than in experiments 1 and 2'
    row = rows.get(('arm_speed', 'all'))
    if row is None or row.deviation_rms_percent is None:
        return Claim.of(section, text, 'a run lacks the arm velocities')
    own = row.deviation_rms_percent
    figure = f'{own:.2g} % of the peak apart, rms'
    others = {n: elsewhere[n].apart_percent for n in (1, 2) if n in elsewhere}
    known = {n: percent for n, percent in others.items() if percent is not None}
    if len(known) < 2:
        return Claim.of(section, text, f'{figure}; experiments 1 and 2 were not run')
    listed = ', '.join(f'{percent:.2g} % in experiment {n}' for n, percent in known.items())
    unit = '% of the peak (this one minus the better of the others)'
    return Claim.of(section, text, Value(own - min(known.values()), unit, 0.0, False, f'{figure}; {listed}'))


def _ripple(section: str, number: int, comparison: Comparison, elsewhere: Mapping[int, ArmSpeeds]) -> Claim:
    text = (
        'the robot has a smaller ripple of its velocities than in experiments 1 and 2'
        if number == LAST
        else 'the robot has a ripple of its velocities that the model lacks'
    )
    if 'arm_speed' not in comparison.names:
        return Claim.of(section, text, 'a run lacks arm_speed')
    model, robot = (ripple_deg_s(comparison, run) for run in (comparison.model, comparison.robot))
    figure = f'robot {robot:.3g}, model {model:.3g} deg/s rms'
    if number == LAST:
        others = {n: elsewhere[n].ripple_deg_s for n in (1, 2) if n in elsewhere}
        if len(others) < 2:
            return Claim.of(section, text, f'{figure}; experiments 1 and 2 were not run')
        listed = ', '.join(f'{other:.3g} in experiment {n}' for n, other in others.items())
        unit = 'deg/s (this one minus the smaller of the others)'
        value = Value(robot - min(others.values()), unit, 0.0, False, f'{figure}; robot {listed}')
        return Claim.of(section, text, value)
    ratio = robot / model if model > 0.0 else math.inf
    return Claim.of(section, text, Value(ratio, 'times that of the model', RIPPLE_RATIO, True, figure), NOISE)


def ripple_deg_s(comparison: Comparison, run: Run) -> float:
    """Return the ripple of the arm speeds [deg/s rms] about their moving average over 11 cycles."""
    speed = comparison.measured(run.actual['arm_speed'])
    width = 2 * RIPPLE_CYCLES + 1
    if len(speed) <= width:
        return 0.0
    window = np.ones(width) / width
    mean = np.column_stack([np.convolve(column, window, 'valid') for column in speed.T])
    left = speed[RIPPLE_CYCLES:-RIPPLE_CYCLES] - mean
    return math.degrees(float(np.sqrt(np.mean(left**2))))


def _dynamics(attribution: Attribution | None) -> Claim:
    text = 'dynamics that the model lacks make the error norm deviate'
    if attribution is None:
        return Claim.of('11.1.4', text, 'no attribution was made')
    outcome = attribution.outcomes.get(('tcp_error_norm', 'deviation'))
    if outcome is None or outcome.total <= 0.0:
        return Claim.of('11.1.4', text, 'there is no deviation to explain')
    dynamic = ('forearm_rods', 'gear', 'friction', 'cogging', 'torque_ripple')
    share = 100.0 * sum(outcome.share.get(name, 0.0) for name in dynamic) / outcome.total
    figure = f'{share:.0f} % of the mean square; sensors, geometry and parameters cause {100.0 - share:.0f} %'
    return Claim.of('11.1.4', text, Value(share, '% of the mean square', DYNAMICS_PERCENT, True, figure))


@dataclass(frozen=True)
class Row:
    """Claim that the statistics of one signal decide."""

    experiment: int | None  # 1 to 3; OF_ALL for 11.1.4; None for the section of each experiment
    text: str
    signal: tuple[str, str]  # and column
    judge: Judge
    by_construction: str = ''


ROWS = (
    Row(None, 'arm velocities match', ('arm_speed', 'all'), _alike),
    Row(None, 'the acceleration follows its reference in the mean', ('arm_acceleration', 'all'), _follows),
    Row(1, 'the robot leaves its reference in y more than the model', ('tcp', 'y'), _robot_more, PLANE),
    Row(1, 'the model leaves its reference in x more than the robot', ('tcp', 'x'), _model_more),
    Row(1, 'the model leaves its reference in z more than the robot', ('tcp', 'z'), _model_more),
    Row(
        1,
        'the error norm of the model is larger than that of the robot',
        ('tcp_error_norm', ''),
        _larger_norm,
    ),
    Row(2, 'the error norms do not agree', ('tcp_error_norm', ''), _apart),
    Row(OF_ALL, 'the arm angles of the model follow the command', ('arm_angle', 'all'), _reached),
    Row(OF_ALL, 'the TCP of the model follows the command', ('tcp', 'all'), _reached),
    Row(OF_ALL, 'arm angles of model and robot are alike', ('arm_angle', 'all'), _alike),
    Row(OF_ALL, 'TCP positions of model and robot are alike', ('tcp', 'all'), _alike),
    Row(OF_ALL, 'the error norms deviate clearly', ('tcp_error_norm', ''), _apart),
    Row(OF_ALL, 'the currents deviate clearly', ('current', 'all'), _apart),
)
