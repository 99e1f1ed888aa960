"""Two runs side by side: brought to one time, subtracted signal by signal, and the figures of each move.

How they are brought there says ``alignment``. A run with another bus cycle, or with samples between the cycles of the
first, is interpolated linearly.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np

from delta3_pacdrive.analysis.alignment import START, Alignment, align
from delta3_pacdrive.analysis.clock_estimation import ON_GRID, resampled
from delta3_pacdrive.analysis.run_signals import currents_of, derivatives
from delta3_pacdrive.analysis.runs import DrivenMove, Run, differing
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.signals import CURRENT_SIGNALS, SIGNALS, TORQUE_SIGNALS, TRUE_SIGNALS
from delta3_pacdrive.recording.trace import Trace

AXES = range(3)
ROWS_MIN = 20  # of which a correlation says something
QUIET = 1e-3  # of the largest axis: an axis below it does not move
SAME = 0.95  # correlation of the same signal
CLEARLY = 0.1  # better correlation from which on axes are exchanged
OTHER_SCALE = 1.1  # ratio of two signals from which on it is mentioned
NEAR = 0.01  # of a ratio with a known cause
QUANTITIES = SIGNALS | TORQUE_SIGNALS | CURRENT_SIGNALS | TRUE_SIGNALS


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
    """Figures of a move as it was driven; nan where a signal is not recorded.

    Currents are those of all samples of the current loops; of the AT where a recording has no others.
    """

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
    doubts
        Why the alignment, or an axis, sign or unit of a signal, may be wrong, in sentences.

    """

    alignment: Alignment
    time_s: Floats
    differences: dict[str, Floats]
    figures: dict[str, Difference]
    moves: tuple[tuple[DrivenMove, DrivenMove], ...]
    parameters: dict[str, tuple[Any, Any]]
    uncompared: int
    doubts: tuple[str, ...] = ()

    @property
    def equal(self) -> bool:
        """Whether no signal differs at all where both runs have it."""
        return not any(figure.largest > 0.0 for figure in self.figures.values())

    @property
    def same(self) -> bool:
        """Whether no signal differs at all, and neither run has cycles that the other one lacks."""
        return self.equal and not self.uncompared


def compare(first: Run, second: Run, how: str = START) -> Comparison:
    """Compare two runs.

    Parameters
    ----------
    first, second
        The runs.
    how
        They are aligned, as ``align`` takes it.

    Raises
    ------
    TraceError
        They have no signal in common, or no time.

    """
    common = [name for name in QUANTITIES if name in first.part.signals and name in second.part.signals]
    if not common:
        raise TraceError(f'{first.name} and {second.name} have no signal in common')
    alignment = align(first, second, how)
    second = alignment.clocked(second)
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
    lacking, notes = np.zeros(len(time_s), dtype=bool), []
    for name in common:
        one, other = first.part[name][both], resampled(shifted, second.part[name], time_s, second.period_s)
        notes += mismatches(name, one, other, first.robot.dynamics.gear_ratio)
        lacking |= (np.isnan(one) != np.isnan(other)).any(axis=1)
    return Comparison(
        alignment,
        time_s,
        differences,
        {name: _figures(QUANTITIES[name][0], values, time_s) for name, values in differences.items()},
        tuple(_pairs(first, second)),
        differing(first.robot, second.robot),
        outside + int(lacking.sum()),
        (*alignment.doubts, *notes),
    )


def mismatches(name: str, one: Floats, other: Floats, gear_ratio: float) -> list[str]:
    """Return sentences about axes of a signal that are exchanged, of opposite sign or in another unit.

    Parameters
    ----------
    name
        Of the signal.
    one, other
        Its values in both runs at the same times, shape (n, 3).
    gear_ratio
        Of the first robot.

    """
    known = np.isfinite(np.hstack([one, other])).all(axis=1)
    if known.sum() < ROWS_MIN or one.shape[1] != len(AXES):
        return []
    names = 'xyz' if name.startswith('tcp_') else '123'
    one, other = (values[known] - values[known].mean(axis=0) for values in (one, other))
    sizes = np.sqrt((one**2).sum(axis=0)), np.sqrt((other**2).sum(axis=0))
    # rows: axes of the first run; an axis that does not move correlates with nothing
    scale = np.outer(*(np.where(size > QUIET * max(size.max(), 1e-300), size, np.inf) for size in sizes))
    correlation = one.T @ other / scale
    best = max(permutations(AXES), key=lambda order: sum(abs(correlation[i, j]) for i, j in enumerate(order)))
    own = np.abs(np.diagonal(correlation))
    moved = [i for i in AXES if best[i] != i and abs(correlation[i, best[i]]) > max(SAME, own[i] + CLEARLY)]
    found = []
    if moved:
        pairs = ', '.join(f'{names[i]} is {names[best[i]]}' for i in moved)
        found.append(f'{name}: axes are exchanged in the second run: {pairs}')
    order = best if moved else tuple(AXES)
    signed = np.array([correlation[i, j] for i, j in enumerate(order)])
    opposite = [i for i in AXES if signed[i] < -SAME]
    if opposite:
        listed = ', '.join(f'{names[i]} {signed[i]:.3f}' for i in opposite)
        found.append(f'{name}: the second run has the opposite sign (correlation of {listed})')
    alike = [i for i in AXES if abs(signed[i]) > SAME]
    if alike:
        ratio = float(np.median([sizes[1][order[i]] / sizes[0][i] for i in alike]))
        near = (text for value, text in _factors(gear_ratio) if abs(ratio / value - 1.0) < NEAR)
        known_as = next(near, '')
        # errors of two robots are seldom as large
        if known_as or (abs(math.log(ratio)) > math.log(OTHER_SCALE) and 'error' not in name):
            found.append(
                f'{name}: values of the second run are {ratio:.4g} times those of the first{known_as}'
            )
    return found


def _factors(gear_ratio: float) -> Iterator[tuple[float, str]]:
    """Yield ratios with a known cause."""
    pairs = (
        (math.sqrt(2.0), 'amplitude', 'rms'),
        (math.degrees(1.0), 'degrees', 'radians'),
        (gear_ratio, 'motor side', 'arm side'),
        (60.0 / math.tau, 'rpm', 'rad/s'),
        (1e3, 'a unit with milli-', 'the unit without'),
    )
    for value, large, small in pairs:
        yield value, f', as {large} instead of {small} would be'
        yield 1.0 / value, f', as {small} instead of {large} would be'


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

    peak, rms = (values[within] for values in currents_of(part))
    error = part.signals.get('following_error', np.full((len(part.time_s), 3), np.nan))[within]
    square = rms[np.isfinite(rms).all(axis=1)] ** 2
    return MoveFigures(
        move.end_s - move.start_s,
        largest('tcp_velocity'),
        _finite_max(peak),
        float(np.sqrt(square.mean(axis=0)).max()) if len(square) else math.nan,
        largest('tcp_error'),
        _finite_max(np.abs(error)),
    )


def driven_currents(run: Run) -> tuple[list[float], list[float]] | None:
    """Return peak and rms current [A] of each motor from the first move to the end of the last one, if recorded."""
    part = run.part
    if not run.moves:
        return None
    slack = ON_GRID * run.period_s
    start_s, end_s = min(move.start_s for move in run.moves), max(move.end_s for move in run.moves)
    within = (part.time_s >= start_s - slack) & (part.time_s < end_s + slack)
    peak, rms = (values[within] for values in currents_of(part))
    known = np.isfinite(rms).all(axis=1)
    if not known.any():
        return None
    return np.nanmax(peak[known], axis=0).tolist(), np.sqrt((rms[known] ** 2).mean(axis=0)).tolist()


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
            'of': found.alignment.of,
            'uncertainty_s': _known(found.alignment.uncertainty_s),
            'rival_shift_s': _known(found.alignment.rival_shift_s),
            'rival_correlation': _known(found.alignment.rival_correlation),
            'doubts': list(found.doubts),
            'rate': found.alignment.rate,
            'rate_uncertainty': _known(found.alignment.rate_uncertainty),
            'at_s': found.alignment.at_s,
            'axes': list(found.alignment.axes),
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


def from_exact(trace: Trace, exact: Trace) -> dict[str, float]:
    """Return how far a simulation with decoupled arms is from that of the exact plant, cycle by cycle."""
    cycles = min(len(trace.time_s), len(exact.time_s))

    def apart(name: str) -> Floats:
        return np.asarray(np.abs(trace[name][:cycles] - exact[name][:cycles]))

    tcp = np.linalg.norm(apart('tcp_true'), axis=1)
    return {
        'tcp_max_m': float(tcp.max()),
        'tcp_rms_m': float(np.sqrt(np.mean(tcp**2))),
        'current_max_a': float(apart('current_mean').max()),
        'coupling_torque_max_n_m': float(apart('coupling_torque').max()),
    }
