"""Two runs side by side: brought to one time, subtracted signal by signal, and the figures of each move.

Runs that know when their program started are aligned by that. Where one does not, or where that is asked for, the
second run is shifted by whole cycles to where its motor speeds correlate best with those of the first. A run with
another bus cycle, or with samples between the cycles of the first, is interpolated linearly.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import correlate, correlation_lags

from delta3_pacdrive.analysis.run_signals import derivatives
from delta3_pacdrive.analysis.runs import DrivenMove, Run, differing
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.signals import SIGNALS, TRUE_SIGNALS

BY_START, BY_CORRELATION = 'program start', 'best correlation'
OVERLAP_MIN = 0.25  # share of the shorter run that has to have a counterpart
ON_GRID = 1e-6  # of a cycle
QUANTITIES = SIGNALS | TRUE_SIGNALS


@dataclass(frozen=True)
class Alignment:
    """The second run is brought to the time of the first.

    Attributes
    ----------
    by
        ``BY_START`` or ``BY_CORRELATION``.
    shift_s
        What is added to the times of the second run.
    correlation
        Of the motor speeds at this shift, 1 for equal ones; nan if they are not recorded or nothing moves.

    """

    by: str
    shift_s: float
    correlation: float


@dataclass(frozen=True)
class Difference:
    """A signal of the second run minus that of the first.

    Attributes
    ----------
    unit
        Of the signal.
    rms, largest
        Of the norm over the three columns.
    at_s
        Time of the largest.

    """

    unit: str
    rms: float
    largest: float
    at_s: float


@dataclass(frozen=True)
class MoveFigures:
    """Figures of a move as it was driven; nan where a signal is not recorded."""

    duration_s: float
    speed_max_m_s: float
    current_peak_a: float
    current_rms_a: float
    tcp_error_max_m: float
    following_error_max_rad: float


@dataclass(frozen=True)
class Comparison:
    """Two runs on one time base.

    Attributes
    ----------
    alignment
        How they were brought there.
    time_s
        Cycles of the first run that both have, shape (n,).
    differences
        By signal, shape (n, 3): second minus first.
    figures
        Of these, by signal.
    moves
        Pairs of moves that the two have in common, by number.
    parameters
        Values of both robots, by the names of those that differ.
    uncompared
        Cycles that only one of the two has, as a whole or of a signal.

    """

    alignment: Alignment
    time_s: Floats
    differences: dict[str, Floats]
    figures: dict[str, Difference]
    moves: tuple[tuple[DrivenMove, DrivenMove], ...]
    parameters: dict[str, tuple[Any, Any]]
    uncompared: int

    @property
    def equal(self) -> bool:
        """Whether no signal differs at all where both runs have it."""
        return not any(figure.largest > 0.0 for figure in self.figures.values())

    @property
    def same(self) -> bool:
        """Whether no signal differs at all, and neither run has cycles that the other one lacks."""
        return self.equal and not self.uncompared


def compare(first: Run, second: Run, by_correlation: bool = False) -> Comparison:
    """Compare two runs.

    Parameters
    ----------
    first, second
        The runs.
    by_correlation
        Whether they are aligned by what they do even if both know when their program started.

    Raises
    ------
    TraceError
        They have no signal in common, or no time.

    """
    common = [name for name in QUANTITIES if name in first.part.signals and name in second.part.signals]
    if not common:
        raise TraceError(f'{first.name} and {second.name} have no signal in common')
    alignment = align(first, second, by_correlation)
    time_s, shifted = first.part.time_s, second.part.time_s + alignment.shift_s
    slack = ON_GRID * first.period_s
    both = (time_s >= shifted[0] - slack) & (time_s <= shifted[-1] + slack)
    if not both.any():
        raise TraceError(
            f'{first.name} and {second.name} have no time in common: {time_s[0]:g} to {time_s[-1]:g} s, '
            f'and {shifted[0]:g} to {shifted[-1]:g} s'
        )
    outside = int((~both).sum())
    outside += int(((shifted < time_s[0] - slack) | (shifted > time_s[-1] + slack)).sum())
    time_s = time_s[both]
    held = {name: first.part[name] for name in common}
    differences = subtracted(first, second, held, second.part.signals, time_s, alignment)
    lacking = np.zeros(len(time_s), dtype=bool)
    for name in common:
        one, other = first.part[name][both], resampled(shifted, second.part[name], time_s, second.period_s)
        lacking |= (np.isnan(one) != np.isnan(other)).any(axis=1)
    return Comparison(
        alignment,
        time_s,
        differences,
        {name: _figures(QUANTITIES[name][0], values, time_s) for name, values in differences.items()},
        tuple(_pairs(first, second)),
        differing(first.robot, second.robot),
        outside + int(lacking.sum()),
    )


def subtracted(
    first: Run,
    second: Run,
    of_first: Mapping[str, Floats],
    of_second: Mapping[str, Floats],
    time_s: Floats,
    alignment: Alignment,
) -> dict[str, Floats]:
    """Return signals of the second run minus those of the first that both have, at cycles of the first."""
    own, shifted = first.part.time_s, second.part.time_s + alignment.shift_s
    return {
        name: resampled(shifted, of_second[name], time_s, second.period_s)
        - resampled(own, values, time_s, first.period_s)
        for name, values in of_first.items()
        if name in of_second
    }


def align(first: Run, second: Run, by_correlation: bool = False) -> Alignment:
    """Bring a run to the time of another; raises TraceError if that takes speeds that are not recorded."""
    by_start = first.knows_start and second.knows_start and not by_correlation
    if by_start:
        return Alignment(BY_START, 0.0, _correlation_at(first, second, 0.0))
    a, b = _speeds(first, first.period_s), _speeds(second, first.period_s)
    if a is None or b is None:
        raise TraceError(
            f'{first.name} and {second.name} cannot be aligned: one does not tell the start of its program, '
            'and the motor speeds of both are not recorded'
        )
    (time_a, speed_a), (time_b, speed_b) = a, b
    found = sum(correlate(speed_a[:, i], speed_b[:, i]) for i in range(3))
    lags = correlation_lags(len(speed_a), len(speed_b))
    overlap = np.minimum(len(speed_a), lags + len(speed_b)) - np.maximum(0, lags)
    found = np.where(overlap >= OVERLAP_MIN * min(len(speed_a), len(speed_b)), found, -np.inf)
    lag = int(lags[int(np.argmax(found))])
    shift_s = float(time_a[0] + lag * first.period_s - time_b[0])
    # whole cycles stay whole
    return Alignment(BY_CORRELATION, shift_s, _correlation_at(first, second, shift_s))


def resampled(time_s: Floats, values: Floats, at_s: Floats, period_s: float) -> Floats:
    """Return values (n, columns) at other times: the same numbers where the times are the same, else between two."""
    rows = np.rint((at_s - time_s[0]) / period_s).astype(np.int64).clip(0, len(time_s) - 1)
    if (np.abs(time_s[rows] - at_s) <= ON_GRID * period_s).all():
        return np.asarray(values[rows])
    return np.column_stack([np.interp(at_s, time_s, column) for column in values.T])


def _speeds(run: Run, period_s: float) -> tuple[Floats, Floats] | None:
    """Return times and motor speeds on a grid of this period, without gaps; None if nothing tells them."""
    part = run.part
    if 'motor_speed' in part.signals:
        speed = part['motor_speed']
    elif 'motor_position' in part.signals or 'motor_command' in part.signals:
        name = 'motor_position' if 'motor_position' in part.signals else 'motor_command'
        speed = derivatives(part[name], run.period_s)[0]
    else:
        return None
    time_s = part.time_s
    if not math.isclose(run.period_s, period_s):
        grid = np.arange(round((time_s[-1] - time_s[0]) / period_s) + 1) * period_s + time_s[0]
        speed, time_s = resampled(time_s, speed, grid, run.period_s), grid
    return time_s, np.nan_to_num(speed)


def _correlation_at(first: Run, second: Run, shift_s: float) -> float:
    a, b = _speeds(first, first.period_s), _speeds(second, first.period_s)
    if a is None or b is None:
        return math.nan
    (time_a, speed_a), (time_b, speed_b) = a, b
    shifted = time_b + shift_s
    both = (time_a >= shifted[0]) & (time_a <= shifted[-1])
    if not both.any():
        return math.nan
    one, other = speed_a[both], resampled(shifted, speed_b, time_a[both], first.period_s)
    scale = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float((one * other).sum()) / scale if scale > 0.0 else math.nan


def _figures(unit: str, difference: Floats, time_s: Floats) -> Difference:
    norm = np.linalg.norm(difference, axis=1)
    if not np.isfinite(norm).any():
        return Difference(unit, math.nan, math.nan, math.nan)
    worst = int(np.nanargmax(norm))
    return Difference(unit, float(np.sqrt(np.nanmean(norm**2))), float(norm[worst]), float(time_s[worst]))


def _pairs(first: Run, second: Run) -> Iterator[tuple[DrivenMove, DrivenMove]]:
    others = {move.number: move for move in second.moves}
    for move in first.moves:
        if move.number in others:
            yield move, others[move.number]


def move_figures(run: Run, move: DrivenMove) -> MoveFigures:
    """Return the figures of a move of a run."""
    part = run.part
    slack = ON_GRID * run.period_s
    within = (part.time_s >= move.start_s - slack) & (part.time_s < move.end_s + slack)

    def largest(name: str, difference: bool = False) -> float:
        if name not in part.signals:
            return math.nan
        values = derivatives(part[name], run.period_s)[0] if difference else part[name]
        return _finite_max(np.linalg.norm(values[within], axis=1))

    current = part.signals.get('current', np.full((len(part.time_s), 3), np.nan))[within]
    error = part.signals.get('following_error', np.full((len(part.time_s), 3), np.nan))[within]
    square = current[np.isfinite(current).all(axis=1)] ** 2
    return MoveFigures(
        move.end_s - move.start_s,
        largest('tcp_velocity'),
        _finite_max(np.abs(current)),
        float(np.sqrt(square.mean(axis=0)).max()) if len(square) else math.nan,
        largest('tcp_error'),
        _finite_max(np.abs(error)),
    )


def _finite_max(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if len(finite) else math.nan


def to_document(found: Comparison, first: Run, second: Run) -> dict[str, Any]:
    """Return a comparison of two runs, ready for JSON; None stands for what is not known."""
    moves = []
    for one, other in found.moves:
        figures = vars(move_figures(first, one)), vars(move_figures(second, other))
        row: dict[str, Any] = {'move': one.number, 'kind': one.kind}
        moves.append(row | {name: [_known(values[name]) for values in figures] for name in figures[0]})
    return {
        'same': found.same,
        'equal': found.equal,
        'uncompared': found.uncompared,
        'alignment': {
            'by': found.alignment.by,
            'shift_s': found.alignment.shift_s,
            'correlation': _known(found.alignment.correlation),
        },
        'from_s': float(found.time_s[0]),
        'to_s': float(found.time_s[-1]),
        'cycles': len(found.time_s),
        'signals': {
            name: {
                'unit': one.unit,
                'rms': _known(one.rms),
                'largest': _known(one.largest),
                'at_s': _known(one.at_s),
            }
            for name, one in found.figures.items()
        },
        'moves': moves,
        'parameters': {name: list(values) for name, values in found.parameters.items()},
    }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
