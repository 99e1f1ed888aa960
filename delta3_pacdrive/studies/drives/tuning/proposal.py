"""Search for the stiffest gains that keep given margins over the whole workspace with every payload.

The integrator compensates a load on the shaft. The time integral of the deviation is inversely proportional to
K_Ivel K_Ppos. The search maximizes this product subject to the margins of the velocity loop, the position loop and the
cascade cut at the current set point, from the lightest to the heaviest load, each on its own and exchanging with the
plant as in simulations. The gain margin limits increase and reduction of a gain.

The search is a differential evolution over logarithms of K_Pvel, K_Ivel/K_Pvel and K_Ppos (with elastic gears also of
centre and damping of a notch filter), evaluated by ``candidates``. The result is checked with the difference equations;
the search is repeated near the result with targets raised by the difference between both models.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import optimize

from delta3_pacdrive.errors import TuningError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import RATED_PAYLOAD_KG, Parameters
from delta3_pacdrive.parameters.notch import Notch
from delta3_pacdrive.studies.drives.loops.analysis import (
    EXCHANGED,
    LOOPS,
    LoopResult,
    OperatingPoint,
    exact_shaft,
    exchanged_shaft,
    linear_cascade_loop,
    linear_loop,
)
from delta3_pacdrive.studies.drives.loops.load import Gear, Load, extremes, gear_of
from delta3_pacdrive.studies.drives.tuning.candidates import (
    NEVER_DB,
    NEVER_DEG,
    Candidates,
    Gains,
    Least,
    PlantResponse,
)
from delta3_pacdrive.studies.framework.study import OnProgress, silent

PHASE_DEG, GAIN_DB = (10.0, 80.0), (1.0, 20.0)  # allowed targets
LOADS = 3  # from the lightest to the heaviest, at equal ratios
CROSSOVER_RAD_S = (5.0, 5000.0)  # search range of the velocity loop
RATIO_1_S = (0.5, 1000.0)  # K_Ivel/K_Pvel
POSITION_1_S = (0.5, 1000.0)
# notch filter: frequency relative to the resonance, damping, depth
NOTCH_SHARE, NOTCH_DAMPING, NOTCH_DEPTH = (0.5, 2.5), (0.1, 1.2), 0.1
POPULATION, GENERATIONS, SETTLED = 10, 120, 1e-4  # of the evolution; population per dimension
NEAR, NEAR_GENERATIONS, ROUNDS = 0.1, 40, 4  # repeated search: half width as share of the range
SEED = 1
SHORT, UNSTABLE = 20.0, 1e3  # penalties; the first for a margin of 0
DIGITS = 4  # of a proposed gain
BEYOND_DB, BEYOND_DEG = 0.005, 0.02  # excess of the targets of a repeated search
POINTS = 300  # frequencies of the linear loops


@dataclass(frozen=True)
class Targets:
    """Margins required of every loop; raises TuningError if one is out of range."""

    phase_deg: float = 45.0
    gain_db: float = 6.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        for value, (low, high), name, unit in (
            (self.phase_deg, PHASE_DEG, 'phase', 'deg'),
            (self.gain_db, GAIN_DB, 'gain', 'dB'),
        ):
            if not low <= value <= high:
                raise TuningError(
                    f'the {name} margin is {value:g} {unit}, but must be between {low:g} and {high:g} {unit}'
                )


@dataclass(frozen=True)
class Kept:
    """Least margins over loops and loads, from the difference equations."""

    gain_db: float  # for increase and reduction of the gain
    phase_deg: float  # at the crossing closest to -1
    gain_where: str  # loop and load with the least margin
    phase_where: str
    stable: bool  # all loops


@dataclass(frozen=True)
class Proposal:
    """Proposed gains and their margins."""

    targets: Targets
    gains: Gains
    robot: Parameters
    kept: Kept
    before: Kept
    payload_kg: float

    @property
    def kept_text(self) -> str:
        """The margins that are kept, for a file."""
        return (
            f'{self.kept.phase_deg:.1f} deg and {self.kept.gain_db:.1f} dB over the workspace with 0 to '
            f'{self.payload_kg:g} kg'
        )


def propose(
    parameters: Parameters,
    targets: Targets,
    speed_rad_s: float,
    payload_kg: float | None = None,
    on_progress: OnProgress = silent,
) -> Proposal:
    """Return the gains with the largest K_Ivel K_Ppos that keep the margins.

    Parameters
    ----------
    parameters
        Parameters of the robot.
    targets
        Required margins.
    speed_rad_s
        Speed of the shafts, which determines the slope of the friction.
    payload_kg
        Largest payload of the range from 0; None: the rated one.
    on_progress
        Callback for the progress of the search.

    Raises
    ------
    TuningError
        No gains keep the margins; the message contains the nearest ones.

    """
    largest = RATED_PAYLOAD_KG if payload_kg is None else payload_kg
    loads = spread(parameters, largest)
    shafts = [exact_shaft(parameters, load, speed_rad_s) for load in loads]
    shafts += [
        shaft
        for shaft in (exchanged_shaft(parameters, load, speed_rad_s) for load in loads)
        if shaft not in shafts
    ]
    inertia = math.sqrt(loads[0].inertia_kg_m2 * loads[-1].inertia_kg_m2)
    gear = gear_of(parameters)
    resonance = None if gear is None else _resonance_hz(gear, inertia)
    ranges = _ranges(parameters, inertia, resonance)
    search = _Search(Candidates(parameters, shafts), ranges, on_progress)
    aim, around = targets, None
    best: tuple[Gains, Kept] | None = None
    for number in range(ROUNDS):
        around = search.best(aim, around, number)
        gains = search.gains(around)
        kept = margins_kept(gains.of(parameters), loads, speed_rad_s)
        keeps = kept.stable and kept.gain_db >= targets.gain_db and kept.phase_deg >= targets.phase_deg
        if keeps and (best is None or gains.stiffness > best[0].stiffness):
            best = gains, kept
        aim = search.aim(targets, gains, kept)
    if best is not None:
        before = margins_kept(parameters, loads, speed_rad_s)
        gains, kept = best
        return Proposal(
            targets=targets,
            gains=gains,
            robot=gains.of(parameters),
            kept=kept,
            before=before,
            payload_kg=largest,
        )
    raise TuningError(
        f'no gains keep {targets.phase_deg:g} deg and {targets.gain_db:g} dB over the workspace '
        f'with 0 to {largest:g} kg: '
        + (
            f'the nearest keep {_apart(kept.phase_deg, targets.phase_deg)} deg and '
            f'{_apart(kept.gain_db, targets.gain_db)} dB'
            if kept.stable
            else 'the nearest are not stable'
        )
    )


def propose_measured(
    parameters: Parameters,
    targets: Targets,
    plant: PlantResponse,
    inertia_kg_m2: float,
    resonance_hz: float | None,
    *,
    on_progress: OnProgress = silent,
) -> tuple[Gains, Least]:
    """Return the gains with the largest K_Ivel K_Ppos that keep the margins with measured plants, and their margins.

    Parameters
    ----------
    parameters
        Periods of the loops, and the second notch filter, which stays.
    targets
        Required margins.
    plant
        Measured responses of the axes.
    inertia_kg_m2
        Inertia, motor side, and ``resonance_hz`` of an elastic gear (None: rigid), for the ranges of the search.

    Raises
    ------
    TuningError
        No gains keep the margins; the message contains the nearest ones.

    """
    candidates = Candidates(parameters, plant)
    search = _Search(candidates, _ranges(parameters, inertia_kg_m2, resonance_hz), on_progress)
    aim = Targets(
        min(targets.phase_deg + BEYOND_DEG, PHASE_DEG[1]), min(targets.gain_db + BEYOND_DB, GAIN_DB[1])
    )
    gains = search.gains(search.best(aim, None, 0))
    least = candidates.least([gains])
    phase, gain, stable = float(least.phase_deg[0]), float(least.gain_db[0]), bool(least.stable[0])
    if stable and phase >= targets.phase_deg and gain >= targets.gain_db:
        return gains, least
    nearest = (
        f'the nearest keep {_apart(phase, targets.phase_deg)} deg and {_apart(gain, targets.gain_db)} dB'
    )
    raise TuningError(
        f'no gains keep {targets.phase_deg:g} deg and {targets.gain_db:g} dB with the measured axes: '
        + (nearest if stable else 'the nearest are not stable')
    )


def _apart(value: float, target: float) -> str:
    """Return a margin with one to six digits, as many as needed to distinguish it from its target."""
    texts = (f'{value:.{digits}f}' for digits in range(1, 7))
    return next((text for text in texts if float(text) != target), f'{value:.1f}')


def spread(parameters: Parameters, payload_kg: float) -> list[Load]:
    """Return loads from the lightest mode without payload to the heaviest mode with the largest payload."""
    lightest = extremes(parameters.replace(dynamics__payload_mass_kg=0.0))[0]
    heaviest = extremes(parameters.replace(dynamics__payload_mass_kg=payload_kg))[1]
    between = np.geomspace(lightest.inertia_kg_m2, heaviest.inertia_kg_m2, LOADS)[1:-1]
    middle = [Load(f'a mode of {1e4 * inertia:.2f}e-4 kg m2', float(inertia)) for inertia in between]
    return [
        replace(lightest, name=f'{lightest.name}, 0 kg'),
        *middle,
        replace(heaviest, name=f'{heaviest.name}, {payload_kg:g} kg'),
    ]


def margins_kept(parameters: Parameters, loads: Sequence[Load], speed_rad_s: float) -> Kept:
    """Return the least margins over loops and loads, from the difference equations."""
    gains, phases, stable = [], [], True
    for load in loads:
        for loop in _loops(parameters, load, speed_rad_s):
            stable = stable and loop.stable
            m, where = loop.margins, f'{loop.name}, {load.name}'
            gains += [(abs(db), where) for db in (m.gain_margin_db, m.gain_reduction_db) if db is not None]
            if m.phase_margin_deg is not None:
                phases.append((abs(m.phase_margin_deg), where))
    gain, phase = min(gains, default=(NEVER_DB, '')), min(phases, default=(NEVER_DEG, ''))
    return Kept(gain[0], phase[0], gain[1], phase[1], stable)


def _loops(parameters: Parameters, load: Load, speed_rad_s: float) -> list[LoopResult]:
    operation = OperatingPoint(load, speed_rad_s)
    exact, exchanged = (shaft(parameters, load, speed_rad_s) for shaft in (exact_shaft, exchanged_shaft))
    found = [linear_loop(loop, parameters, operation, POINTS) for loop in LOOPS[1:]]
    found.append(linear_cascade_loop(parameters, exact, POINTS))
    if exchanged != exact:
        found.append(linear_cascade_loop(parameters, exchanged, POINTS, EXCHANGED))
    return found


def _ranges(
    parameters: Parameters, inertia_kg_m2: float, resonance_hz: float | None
) -> list[tuple[float, float]]:
    """Return the search range of each dimension."""
    per_gain = parameters.motor.torque_constant_n_m_a / inertia_kg_m2
    ranges = [(CROSSOVER_RAD_S[0] / per_gain, CROSSOVER_RAD_S[1] / per_gain), RATIO_1_S, POSITION_1_S]
    if resonance_hz is not None:
        high = min(NOTCH_SHARE[1] * resonance_hz, 0.39 / parameters.drive.velocity_period_s)
        ranges += [(max(NOTCH_SHARE[0] * resonance_hz, 10.0), high), NOTCH_DAMPING]
    return ranges


def _resonance_hz(gear: Gear, inertia_kg_m2: float) -> float:
    arm = inertia_kg_m2 - gear.rotor_kg_m2
    return math.sqrt(gear.stiffness_n_m_rad * (1.0 / gear.rotor_kg_m2 + 1.0 / arm)) / math.tau


class _Search:
    """Search for the best candidate within ranges."""

    def __init__(
        self, candidates: Candidates, ranges: list[tuple[float, float]], on_progress: OnProgress
    ) -> None:
        self._candidates, self._on_progress = candidates, on_progress
        self._bounds = np.log10(np.array(ranges))

    def gains(self, point: Floats) -> Gains:
        """Return the gains at a point of the search space, rounded as they are proposed."""
        velocity, ratio, position, *rest = (10.0**point).tolist()
        rounded = [float(f'{x:.{DIGITS}g}') for x in (velocity, velocity * ratio, position)]
        found = Gains(rounded[0], rounded[1], rounded[2])
        if not rest:
            return found
        # only the first filter is searched; the second one keeps its parameters
        return replace(found, notch=_notch(*rest))

    def aim(self, targets: Targets, gains: Gains, kept: Kept) -> Targets:
        """Return targets for candidates with which the difference equations keep ``targets`` near these gains."""
        least = self._candidates.least([gains])
        more_db, more_deg = float(least.gain_db[0]) - kept.gain_db, float(least.phase_deg[0]) - kept.phase_deg
        return Targets(
            min(max(targets.phase_deg + more_deg + BEYOND_DEG, PHASE_DEG[0]), PHASE_DEG[1]),
            min(max(targets.gain_db + more_db + BEYOND_DB, GAIN_DB[0]), GAIN_DB[1]),
        )

    def best(self, aim: Targets, around: Floats | None, number: int) -> Floats:
        """Return the best point of the whole range, or of the neighbourhood of a point."""
        bounds, generations = self._bounds, GENERATIONS
        if around is not None:
            half = NEAR * (bounds[:, 1] - bounds[:, 0])
            bounds = np.clip(np.stack([around - half, around + half], axis=1), bounds[:, :1], bounds[:, 1:])
            generations = NEAR_GENERATIONS
        done = 0

        def report(*_: Any, **__: Any) -> None:
            nonlocal done
            done += 1
            self._on_progress(f'search {number + 1}', done, generations)

        found = optimize.differential_evolution(
            lambda points: self._cost(points, aim),
            bounds,
            popsize=POPULATION,
            maxiter=generations,
            tol=SETTLED,
            init='sobol',
            x0=around,
            seed=SEED,
            polish=False,
            vectorized=True,
            updating='deferred',
            callback=report,
        )
        return np.asarray(found.x)

    def _cost(self, points: Floats, aim: Targets) -> Floats:
        """Return the cost of points of shape (dimensions, candidates)."""
        gains = [self.gains(point) for point in points.T]
        least = self._candidates.least(gains)
        short_db = np.maximum(aim.gain_db - least.gain_db, 0.0) / aim.gain_db
        short_deg = np.maximum(aim.phase_deg - least.phase_deg, 0.0) / aim.phase_deg
        size = np.array([math.log10(g.stiffness) for g in gains])
        return np.asarray(SHORT * (short_db + short_deg) - size + np.where(least.stable, 0.0, UNSTABLE))


def _notch(frequency_hz: float, damping: float) -> Notch:
    return Notch(float(f'{frequency_hz:.3g}'), float(f'{damping:.2g}'), NOTCH_DEPTH)
