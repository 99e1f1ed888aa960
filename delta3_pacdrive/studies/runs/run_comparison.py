"""Comparison of two runs: aligned in time, subtracted signal by signal, with figures for each move.

``alignment`` defines the common time. A run with another bus cycle, or with samples between the cycles of the first,
is interpolated linearly.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.signals import (
    CURRENT_SIGNALS,
    SIGNALS,
    SUPPLY_SIGNALS,
    THERMAL_SIGNALS,
    TORQUE_SIGNALS,
    TRUE_SIGNALS,
)
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.framework.columns import to_dict
from delta3_pacdrive.studies.runs.alignment import START, Alignment, align
from delta3_pacdrive.studies.runs.clock_estimation import ON_GRID, resampled
from delta3_pacdrive.studies.runs.run_signals import currents_of, derivatives
from delta3_pacdrive.studies.runs.runs import DrivenMove, Run, differing

AXES = range(3)
ROWS_MIN = 20  # for a significant correlation
QUIET = 1e-3  # of the largest axis: below it an axis does not move
SAME = 0.95  # correlation of the same signal
CLEARLY = 0.1  # advantage in correlation at which axes count as exchanged
OTHER_SCALE = 1.1  # ratio of two signals that is reported
NEAR = 0.01  # relative distance to a ratio with a known cause
QUANTITIES = SIGNALS | TORQUE_SIGNALS | CURRENT_SIGNALS | TRUE_SIGNALS | SUPPLY_SIGNALS
QUANTITIES |= THERMAL_SIGNALS


@dataclass(frozen=True)
class Difference:
    """Signal of the second run minus that of the first."""

    unit: str
    rms: float  # of the norm over the three columns
    largest: float
    at_s: float  # time of the largest


@dataclass(frozen=True)
class MoveFigures:
    """Figures of an executed move; nan where a signal is not recorded.

    Currents cover all samples of the current loops if these are recorded, otherwise those of the AT.
    """

    duration_s: float
    speed_max_m_s: float
    current_peak_a: float
    current_rms_a: float
    tcp_error_max_m: float
    following_error_max_rad: float


@dataclass(frozen=True)
class Comparison:
    """Two runs on a common time base."""

    alignment: Alignment
    time_s: Floats  # cycles of the first run that both have, shape (n,)
    differences: dict[str, Floats]  # second minus first by signal, shape (n, 3)
    figures: dict[str, Difference]  # figures of these differences by signal
    moves: tuple[tuple[DrivenMove, DrivenMove], ...]  # moves with the same number in both runs
    parameters: dict[str, tuple[Any, Any]]  # differing parameters by name, with the values of both robots
    uncompared: int  # cycles in only one of the runs, or with a signal missing in one
    doubts: tuple[str, ...] = ()  # possible errors in the alignment or in an axis, sign or unit, as sentences

    @property
    def equal(self) -> bool:
        """Whether all signals are equal where both runs contain them."""
        return not any(figure.largest > 0.0 for figure in self.figures.values())

    @property
    def same(self) -> bool:
        """Whether all signals are equal and neither run has additional cycles."""
        return self.equal and not self.uncompared


def compare(first: Run, second: Run, how: str = START) -> Comparison:
    """Compare two runs, aligned by the method ``how`` of ``align``.

    Raises
    ------
    TraceError
        The runs have no signal or no time in common.

    """
    common = [name for name in QUANTITIES if name in first.window.signals and name in second.window.signals]
    if not common:
        raise TraceError(f'{first.name} and {second.name} have no signal in common')
    alignment = align(first, second, how)
    second = alignment.clocked(second)
    time_s, shifted = first.window.time_s, second.window.time_s + alignment.shift_s
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
    held = {name: first.window[name] for name in common}
    differences = subtracted(
        first=first,
        second=second,
        of_first=held,
        of_second=second.window.signals,
        time_s=time_s,
        alignment=alignment,
    )
    lacking, notes = np.zeros(len(time_s), dtype=bool), []
    for name in common:
        one, other = (
            first.window[name][both],
            resampled(shifted, second.window[name], time_s, second.period_s),
        )
        notes += mismatches(name, one, other, first.robot.dynamics.gear_ratio)
        lacking |= (np.isnan(one) != np.isnan(other)).any(axis=1)
    return Comparison(
        alignment=alignment,
        time_s=time_s,
        differences=differences,
        figures={name: _figures(QUANTITIES[name][0], values, time_s) for name, values in differences.items()},
        moves=tuple(_pairs(first, second)),
        parameters=differing(first.robot, second.robot),
        uncompared=outside + int(lacking.sum()),
        doubts=(*alignment.doubts, *notes),
    )


def mismatches(
    name: str,
    one: Floats,
    other: Floats,
    gear_ratio: float,
    runs: tuple[str, str] = ('the first', 'the second run'),
    near: float = NEAR,
) -> list[str]:
    """Return sentences about exchanged axes, opposite signs or different units of a signal.

    ``one`` and ``other`` are its values in both runs at the same times, shape (n, 3); ``gear_ratio`` is that of the
    first robot, ``runs`` are the names of the runs in the sentences, and ``near`` is the relative distance to a ratio
    with a known cause.
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
    first, second = runs
    if moved:
        pairs = ', '.join(f'{names[i]} is {names[best[i]]}' for i in moved)
        found.append(f'{name}: axes are exchanged in {second}: {pairs}')
    order = best if moved else tuple(AXES)
    signed = np.array([correlation[i, j] for i, j in enumerate(order)])
    opposite = [i for i in AXES if signed[i] < -SAME]
    if opposite:
        listed = ', '.join(f'{names[i]} {signed[i]:.3f}' for i in opposite)
        found.append(f'{name}: {second} has the opposite sign (correlation of {listed})')
    alike = [i for i in AXES if abs(signed[i]) > SAME]
    if alike:
        ratio = float(np.median([sizes[1][order[i]] / sizes[0][i] for i in alike]))
        alike_to = (text for value, text in _factors(gear_ratio) if abs(ratio / value - 1.0) < near)
        known_as = next(alike_to, '')
        # error signals of two robots rarely have the same size
        if known_as or (abs(math.log(ratio)) > math.log(OTHER_SCALE) and 'error' not in name):
            found.append(f'{name}: values of {second} are {ratio:.4g} times those of {first}{known_as}')
    return found


def _factors(gear_ratio: float) -> Iterator[tuple[float, str]]:
    """Yield ratios with a known cause, with a description."""
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
    """Return the signals of the second run minus those of the first, at cycles of the first run."""
    own, shifted = first.window.time_s, second.window.time_s + alignment.shift_s
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
    part = run.window
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
        duration_s=move.end_s - move.start_s,
        speed_max_m_s=largest('tcp_velocity'),
        current_peak_a=_finite_max(peak),
        current_rms_a=float(np.sqrt(square.mean(axis=0)).max()) if len(square) else math.nan,
        tcp_error_max_m=largest('tcp_error'),
        following_error_max_rad=_finite_max(np.abs(error)),
    )


def driven_currents(run: Run) -> tuple[list[float], list[float]] | None:
    """Return peak and rms current [A] of each motor from the first to the last move; None if not recorded."""
    part = run.window
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
    """Return a comparison ready for JSON; unknown values are None."""
    moves = []
    for one, other in found.moves:
        figures = to_dict(move_figures(first, one)), to_dict(move_figures(second, other))
        row: dict[str, Any] = {'move': one.number, 'kind': one.kind}
        moves.append(row | {name: [values[name] for values in figures] for name in figures[0]})
    aligned = list(to_dict(found.alignment).items())
    document: dict[str, Any] = {
        'same': found.same,
        'equal': found.equal,
        'uncompared': found.uncompared,
        'alignment': dict([*aligned[:7], ('doubts', found.doubts), *aligned[7:]]),
        'from_s': found.time_s[0],
        'to_s': found.time_s[-1],
        'cycles': len(found.time_s),
        'signals': found.figures,
        'moves': moves,
    }
    result: dict[str, Any] = to_dict(document)
    return result | {'parameters': {name: list(pair) for name, pair in found.parameters.items()}}


def from_exact(trace: Trace, exact: Trace) -> dict[str, float]:
    """Return the deviations of a simulation with decoupled arms from that of the exact plant."""
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
