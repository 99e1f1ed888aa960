"""Conclusions of a comparison as sentences: agreement with the thesis, and attribution to effects."""

import math
from dataclasses import dataclass

from delta3_pacdrive.studies.thesis.experiments.attribution import EFFECTS, Attribution, Outcome
from delta3_pacdrive.studies.thesis.experiments.compared_signals import QUANTITIES
from delta3_pacdrive.studies.thesis.experiments.comparison import Statistics

SMALL_PERCENT = 1.0  # of the peak: indistinguishable curves in a printed figure
CLEAR_PERCENT = 10.0  # rms of the deviation relative to the model's rms: clearly visible
NAMED_PERCENT = 5.0  # smallest share that is listed
OF_CURVES = (
    'arm_angle',
    'arm_speed',
    'arm_acceleration',
    'current',
    'tcp',
    'tcp_error_norm',
    'tcp_error_norm_true',
)
OTHER = 'other parameters'


@dataclass(frozen=True)
class Conclusion:
    """Claim of 11.1.4, and whether this run confirms it."""

    claim: str
    holds: bool
    sentence: str


def conclusions(rows: list[Statistics]) -> list[Conclusion]:
    """Check a run against the results of the thesis; signals missing in both runs are omitted.

    The thesis reports small deviations of angles and TCP, and clear deviations of the error norm and the current.
    """
    whole = {row.signal: row for row in rows if row.column in ('', 'all')}
    return [
        *(_small(name, whole[name]) for name in ('arm_angle', 'tcp') if name in whole),
        *(_clear(name, whole[name]) for name in ('tcp_error_norm', 'current') if name in whole),
    ]


def truth(rows: list[Statistics]) -> str:
    """Return the true TCP errors in one sentence; empty if the runs do not contain them."""
    whole = {row.signal: row for row in rows if row.column in ('', 'all')}
    if 'tcp_error_norm_true' not in whole:
        return ''
    seen, true = whole['tcp_error_norm'], whole['tcp_error_norm_true']
    return (
        f"the robot's true TCP is {true.robot_max:.3f} mm off at most and {true.robot_rms:.3f} mm rms, "
        f'its encoders show {seen.robot_max:.3f} and {seen.robot_rms:.3f} mm; '
        f'the model {true.model_max:.3f} and {true.model_rms:.3f} mm'
    )


def explanations(attribution: Attribution) -> list[str]:
    """Return one sentence per curve and per statistic with the shares of the effects."""
    outcomes = attribution.outcomes
    curves = [name for name in OF_CURVES if (name, 'deviation') in outcomes]
    sentences = [_of_curve(outcomes[name, 'deviation'], attribution) for name in curves]
    sentences += [_of_statistic(o, attribution) for o in outcomes.values() if o.statistic != 'deviation']
    return sentences


def other_text(attribution: Attribution) -> str:
    """Name the parameters that differ between model and robot in addition to the effects."""
    names = attribution.other_parameters
    listed = ', '.join(names[:3]) + (', ...' if len(names) > 3 else '')
    return f'{OTHER} ({listed})' if names else OTHER


def _small(name: str, row: Statistics) -> Conclusion:
    quantity = QUANTITIES[name]
    percent = row.deviation_max_percent
    return Conclusion(
        f'small deviation of the {quantity.text}',
        percent is not None and percent < SMALL_PERCENT,
        f'{quantity.text}: robot and model at most {row.deviation_max:.2g} {row.unit} apart'
        f'{_percent(percent, "of its travel")}, {row.deviation_rms:.2g} {row.unit} rms',
    )


def _clear(name: str, row: Statistics) -> Conclusion:
    quantity = QUANTITIES[name]
    share = 100.0 * row.deviation_rms / row.model_rms if row.model_rms > 0.0 else None
    return Conclusion(
        f'clear deviation of the {quantity.text}',
        share is not None and share > CLEAR_PERCENT,
        f'{quantity.text}: robot and model {row.deviation_rms:.3g} {row.unit} rms apart'
        f'{_percent(share, "of the rms of the model")}, at most {row.deviation_max:.3g} {row.unit}'
        f'{_percent(row.deviation_max_percent, "of its peak")}; peak {row.robot_max:.3g} instead of '
        f'{row.model_max:.3g} {row.unit}, rms {row.robot_rms:.3g} instead of {row.model_rms:.3g} {row.unit}',
    )


def _percent(value: float | None, of: str) -> str:
    return '' if value is None else f' ({value:.2g} % {of})'


def _of_curve(outcome: Outcome, attribution: Attribution) -> str:
    quantity = QUANTITIES[outcome.signal]
    rms = quantity.factor * math.sqrt(max(outcome.total, 0.0))
    begin = f'{quantity.text}, {rms:.3g} {quantity.shown_unit} rms apart'
    if outcome.total <= 0.0:
        return f'{begin}: no deviation to explain'
    shares = {EFFECTS[name].text: 100.0 * value / outcome.total for name, value in outcome.share.items()}
    shares[other_text(attribution)] = 100.0 * outcome.other / outcome.total
    named = {name: share for name, share in shares.items() if abs(share) >= NAMED_PERCENT}
    rest = sum(shares.values()) - sum(named.values())
    parts = [f'{share:z.0f} % {name}' for name, share in sorted(named.items(), key=lambda item: -item[1])]
    return f'{begin}: {", ".join([*parts, f"{rest:z.0f} % the rest"])}'


def _of_statistic(outcome: Outcome, attribution: Attribution) -> str:
    quantity = QUANTITIES[outcome.signal]
    factor, unit = quantity.factor, quantity.shown_unit
    what = {'max': 'peak', 'rms': 'rms'}[outcome.statistic]
    parts = {EFFECTS[name].text: factor * value for name, value in outcome.share.items()}
    parts[other_text(attribution)] = factor * outcome.other
    named = sorted(parts.items(), key=lambda item: -abs(item[1]))[:3]
    rest = factor * outcome.total - sum(value for _, value in named)
    listed = ', '.join([*(f'{value:+.4f} {name}' for name, value in named), f'{rest:+z.4f} the rest'])
    return (
        f'{quantity.text}, {what} {factor * outcome.robot:.3g} instead of {factor * outcome.model:.3g} {unit} '
        f'({factor * outcome.total:+.4f}): {listed}'
    )
