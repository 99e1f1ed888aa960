"""The claims of 11.1.1 to 11.1.4, one by one: whether this run bears each out, with the figure that says so.

The thesis names no figures, only what one sees in its plots; what counts as seen is chosen here.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.analysis.experiments.attribution import Attribution
from delta3_pacdrive.analysis.experiments.compared_signals import Run
from delta3_pacdrive.analysis.experiments.comparison import Comparison, Statistics

HOLDS, FAILS, UNKNOWN = 'holds', 'does not hold', 'cannot be known'
ALIKE_PERCENT = 1.0  # rms of the deviation, of the peak: nobody sees it in a figure of a page
APART_PERCENT = 10.0  # rms of the deviation, of the model's rms: nobody overlooks it
FOLLOWS_PERCENT = 20.0  # rms of an acceleration from its reference, of the reference, that still follows it
RIPPLE_RATIO = 1.5  # of the robot's ripple over the model's, from which on one sees it
RIPPLE_CYCLES = 5  # on either side, whose mean is taken off


@dataclass(frozen=True)
class ArmSpeeds:
    """The arm speeds of an experiment, as those of others are held against them.

    Attributes
    ----------
    ripple_deg_s
        Of the robot: ``ripple_deg_s``.
    apart_percent
        What model and robot are apart, rms, of the peak; None if the model does not move.

    """

    ripple_deg_s: float
    apart_percent: float | None

    @classmethod
    def of(cls, comparison: Comparison) -> 'ArmSpeeds':
        """Of model and robot that both tell their arm speeds."""
        (row,) = [row for row in comparison.statistics() if (row.signal, row.column) == ('arm_speed', 'all')]
        return cls(ripple_deg_s(comparison, comparison.robot), row.deviation_rms_percent)


@dataclass(frozen=True)
class Claim:
    """A claim of the thesis.

    Attributes
    ----------
    section
        Where it stands.
    text
        What it says, in our words.
    verdict
        ``HOLDS``, ``FAILS`` or ``UNKNOWN``.
    figure
        The numbers, in words; of what cannot be known the reason.

    """

    section: str
    text: str
    verdict: str
    figure: str

    @property
    def sentence(self) -> str:
        """One line for people."""
        return f'{self.section}: {self.text}: {self.verdict.upper()}: {self.figure}'


def claims(
    number: int | None,
    comparison: Comparison,
    attribution: Attribution | None,
    elsewhere: Mapping[int, ArmSpeeds] | None = None,
) -> list[Claim]:
    """Hold a run of an experiment against every claim of its section and of 11.1.4; none for other programs.

    Parameters
    ----------
    number
        Of the experiment.
    comparison
        Of model and robot.
    attribution
        What explains it, if that is known.
    elsewhere
        Arm speeds of the same two in other experiments, by their numbers, if they are known.

    """
    if number is None:
        return []
    rows = {(row.signal, row.column): row for row in comparison.statistics()}
    section = f'11.1.{number}'
    found = [
        _row(section, 'arm velocities match', rows, 'arm_speed', 'all', _alike),
        _ripple(section, number, comparison, elsewhere or {}),
        _row(
            section,
            'the acceleration follows its reference in the mean',
            rows,
            'arm_acceleration',
            'all',
            _follows,
        ),
    ]
    if number == 1:
        found += [
            _row(section, 'the robot leaves its reference in y more than the model', rows, 'tcp', 'y', _robot_more),
            _row(section, 'the model leaves its reference in x more than the robot', rows, 'tcp', 'x', _model_more),
            _row(section, 'the model leaves its reference in z more than the robot', rows, 'tcp', 'z', _model_more),
            _row(section, 'the error norm of the model is larger than that of the robot', rows, 'tcp_error_norm', '',
                 _larger_norm),
        ]  # fmt: skip
    if number == 3:
        found.insert(1, _better(section, rows, elsewhere or {}))
    if number == 2:
        found.append(_row(section, 'the error norms do not agree', rows, 'tcp_error_norm', '', _apart))
    return [
        *found,
        _row(
            '11.1.4', 'the arm angles of the model follow what is desired', rows, 'arm_angle', 'all', _reached
        ),
        _row('11.1.4', 'the TCP of the model follows what is desired', rows, 'tcp', 'all', _reached),
        _row('11.1.4', 'arm angles of model and robot are alike', rows, 'arm_angle', 'all', _alike),
        _row('11.1.4', 'TCP positions of model and robot are alike', rows, 'tcp', 'all', _alike),
        _row('11.1.4', 'the error norms deviate clearly', rows, 'tcp_error_norm', '', _apart),
        _row('11.1.4', 'the currents deviate clearly', rows, 'current', 'all', _apart),
        _dynamics(attribution),
    ]


Judge = Callable[[Statistics], tuple[str, str]]


def _row(
    section: str,
    text: str,
    rows: dict[tuple[str, str], Statistics],
    signal: str,
    column: str,
    judge: Judge,
) -> Claim:
    row = rows.get((signal, column))
    if row is None:
        return Claim(section, text, UNKNOWN, f'the runs do not both tell {signal}')
    return Claim(section, text, *judge(row))


def _answer(holds: bool) -> str:
    return HOLDS if holds else FAILS


def _alike(row: Statistics) -> tuple[str, str]:
    percent = row.deviation_rms_percent
    if percent is None:
        return UNKNOWN, 'the model does not move'
    figure = f'{row.deviation_rms:.2g} {row.unit} rms apart, {percent:.2g} % of the peak'
    return _answer(percent < ALIKE_PERCENT), figure


def _apart(row: Statistics) -> tuple[str, str]:
    share = 100.0 * row.deviation_rms / row.model_rms if row.model_rms > 0.0 else math.inf
    figure = f'{row.deviation_rms:.3g} {row.unit} rms apart, {share:.2g} % of the rms of the model'
    return _answer(share > APART_PERCENT), figure


def _follows(row: Statistics) -> tuple[str, str]:
    if row.model_from_reference_rms is None or not row.model_rms:
        return UNKNOWN, 'the run tells no reference'
    share = 100.0 * row.model_from_reference_rms / row.model_rms
    figure = f'model {row.model_from_reference_rms:.3g} {row.unit} rms from its reference, {share:.2g} % of its rms'
    return _answer(share < FOLLOWS_PERCENT), figure


def _reached(row: Statistics) -> tuple[str, str]:
    if row.model_from_reference_rms is None or not row.peak:
        return UNKNOWN, 'the run tells no reference'
    share = 100.0 * row.model_from_reference_rms / row.peak
    figure = f'model {row.model_from_reference_rms:.2g} {row.unit} rms from its reference, {share:.2g} % of the peak'
    return _answer(share < ALIKE_PERCENT), figure


def _from_reference(row: Statistics) -> tuple[float, float, str] | None:
    model, robot = row.model_from_reference_rms, row.robot_from_reference_rms
    if model is None or robot is None:
        return None
    return model, robot, f'model {model:.3g}, robot {robot:.3g} {row.unit} rms from the reference'


def _robot_more(row: Statistics) -> tuple[str, str]:
    found = _from_reference(row)
    return (
        (UNKNOWN, 'the runs tell no reference') if found is None else (_answer(found[1] > found[0]), found[2])
    )


def _model_more(row: Statistics) -> tuple[str, str]:
    found = _from_reference(row)
    return (
        (UNKNOWN, 'the runs tell no reference') if found is None else (_answer(found[0] > found[1]), found[2])
    )


def _larger_norm(row: Statistics) -> tuple[str, str]:
    figure = (
        f'rms {row.model_rms:.3g} of the model, {row.robot_rms:.3g} {row.unit} of the robot; '
        f'at most {row.model_max:.3g} and {row.robot_max:.3g}'
    )
    return _answer(row.model_rms > row.robot_rms), figure


def _better(
    section: str, rows: dict[tuple[str, str], Statistics], elsewhere: Mapping[int, ArmSpeeds]
) -> Claim:
    text = 'the model follows the velocities of the robot better than in experiments 1 and 2'
    row = rows.get(('arm_speed', 'all'))
    if row is None or row.deviation_rms_percent is None:
        return Claim(section, text, UNKNOWN, 'the runs do not both tell how the arms move')
    own = row.deviation_rms_percent
    figure = f'{own:.2g} % of the peak apart, rms'
    others = {n: elsewhere[n].apart_percent for n in (1, 2) if n in elsewhere}
    known = {n: percent for n, percent in others.items() if percent is not None}
    if len(known) < 2:
        return Claim(section, text, UNKNOWN, f'{figure}; that of experiments 1 and 2 is not known')
    told = ', '.join(f'{percent:.2g} % in experiment {n}' for n, percent in known.items())
    return Claim(section, text, _answer(own < min(known.values())), f'{figure}; {told}')


def _ripple(section: str, number: int, comparison: Comparison, elsewhere: Mapping[int, ArmSpeeds]) -> Claim:
    text = (
        'the robot has a smaller ripple of its velocities than in experiments 1 and 2'
        if number == 3
        else 'the robot has a ripple of its velocities that the model has not'
    )
    if 'arm_speed' not in comparison.names:
        return Claim(section, text, UNKNOWN, 'the runs do not both tell arm_speed')
    model, robot = (ripple_deg_s(comparison, run) for run in (comparison.model, comparison.robot))
    figure = f'robot {robot:.3g}, model {model:.3g} deg/s rms'
    if number == 3:
        others = {n: elsewhere[n].ripple_deg_s for n in (1, 2) if n in elsewhere}
        if len(others) < 2:
            return Claim(section, text, UNKNOWN, f'{figure}; that of experiments 1 and 2 is not known')
        told = ', '.join(f'{other:.3g} in experiment {n}' for n, other in others.items())
        return Claim(section, text, _answer(robot < min(others.values())), f'{figure}; robot {told}')
    return Claim(section, text, _answer(robot > RIPPLE_RATIO * model), figure)


def ripple_deg_s(comparison: Comparison, run: Run) -> float:
    """Return the small amplitude variation of arm speeds [deg/s rms]: what their mean over 11 cycles leaves."""
    speed = comparison.measured(run.actual['arm_speed'])
    width = 2 * RIPPLE_CYCLES + 1
    if len(speed) <= width:
        return 0.0
    window = np.ones(width) / width
    mean = np.column_stack([np.convolve(column, window, 'valid') for column in speed.T])
    left = speed[RIPPLE_CYCLES:-RIPPLE_CYCLES] - mean
    return math.degrees(float(np.sqrt(np.mean(left**2))))


def _dynamics(attribution: Attribution | None) -> Claim:
    text = 'what the model lacks of the dynamics makes the error norm deviate'
    if attribution is None:
        return Claim('11.1.4', text, UNKNOWN, 'no attribution was made')
    outcome = attribution.outcomes.get(('tcp_error_norm', 'deviation'))
    if outcome is None or outcome.total <= 0.0:
        return Claim('11.1.4', text, UNKNOWN, 'there is nothing to explain')
    dynamic = ('forearm_rods', 'gear', 'friction', 'cogging', 'torque_ripple')
    share = 100.0 * sum(outcome.share.get(name, 0.0) for name in dynamic) / outcome.total
    rest = f'the rest are sensors, geometry and parameters ({100.0 - share:.0f} %)'
    return Claim('11.1.4', text, _answer(share > 50.0), f'{share:.0f} % of the mean square; {rest}')
