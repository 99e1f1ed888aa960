"""Definition and results of an optimisation: search space, goal, trials. Its settings are those of a sweep."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from delta3_pacdrive.studies.fleet.sweep.study import Outcome, Sweep

BASE = 0  # number of the run with the values of the files, if they are outside the search space


@dataclass(frozen=True)
class Optimisation:
    """Optimisation as defined in its file."""

    sweep: Sweep  # program, robot, varied quantities, results and limits; its runs are the trials
    goal: str  # number to be optimised
    maximise: bool
    together: int  # number of trials chosen at a time, before their results are known


@dataclass(frozen=True)
class Trial:
    """Chosen values and the result of their run."""

    number: int  # from 1; BASE is outside the search
    values: Mapping[str, Any]  # by varied quantity
    kept: Mapping[str, float]  # numbers of the run; empty if it was rejected
    outcome: Outcome
    reason: str
    excess: Mapping[str, float]  # excess over each limit relative to the limit; negative within it

    @property
    def keeps_limits(self) -> bool:
        """Whether the run was completed within all limits."""
        return self.outcome == Outcome.DONE and all(one <= 0.0 for one in self.excess.values())


@dataclass(frozen=True)
class Trials:
    """All trials of an optimisation."""

    optimisation: Optimisation  # definition
    base: Trial  # run with the values of the files: the first trial, or a separate run
    trials: Sequence[Trial]  # in the order of their choice
    # share of each varied quantity in the quality of a trial; empty if unknown
    importance: Mapping[str, float]

    def value(self, trial: Trial) -> float | None:
        """Return the number to be optimised; None if the run has none."""
        return trial.kept.get(self.optimisation.goal)

    @property
    def best(self) -> Trial | None:
        """The best trial within all limits, the first of equal ones; None if there is none."""
        good = [one for one in self.trials if one.keeps_limits and self.value(one) is not None]
        sign = -1.0 if self.optimisation.maximise else 1.0
        return min(good, key=lambda one: sign * one.kept[self.optimisation.goal], default=None)

    @property
    def nearest(self) -> Trial | None:
        """The trial with the smallest excess over the limits; None if no run was completed."""
        done = [one for one in self.trials if one.outcome == Outcome.DONE]
        return min(done, key=lambda one: sum(max(share, 0.0) for share in one.excess.values()), default=None)


@dataclass(frozen=True)
class Results:
    """All trials, and how they were made."""

    trials: Trials
    seconds: float  # duration of the new runs; nan without any
    made: int  # number of new runs
    workers: int  # number of worker processes
    files: tuple[Path, ...]  # parameters and program of the best trial; empty without one
