"""What an optimisation is: what may be chosen, what is best, and what became of every trial."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.analysis.sweep.design import Outcome, Sweep

BASE = 0  # number of the run with the values of the files, if these cannot be chosen


@dataclass(frozen=True)
class Optimisation:
    """An optimisation, as its file has it.

    Attributes
    ----------
    sweep
        Program, robot, what is chosen (``vary``), kept and limited; its runs are the trials.
    goal
        Number that is to be best.
    maximise
        Whether the largest one is best.
    together
        Trials that are chosen at a time, before any of them is known.

    """

    sweep: Sweep
    goal: str
    maximise: bool
    together: int


@dataclass(frozen=True)
class Trial:
    """One choice and what became of it.

    Attributes
    ----------
    number
        From 1 on; ``BASE`` is none of the search.
    values
        That were chosen, by what is chosen.
    kept
        Numbers of its run; none if it was refused.
    outcome, reason
        What has become of the run, and why.
    excess
        How far it breaks each limit, as a share of that, by their names; negative within it.

    """

    number: int
    values: Mapping[str, Any]
    kept: Mapping[str, float]
    outcome: Outcome
    reason: str
    excess: Mapping[str, float]

    @property
    def keeps_limits(self) -> bool:
        """Whether it came to its end within all limits."""
        return self.outcome == Outcome.DONE and all(one <= 0.0 for one in self.excess.values())


@dataclass(frozen=True)
class Trials:
    """All trials of an optimisation.

    Attributes
    ----------
    wanted
        What was asked for.
    base
        The run with the values of the files: the first trial, or one beside all trials.
    trials
        In the order in which they were chosen.
    importance
        Share of each quantity in whether a trial is a good one, by what is chosen; empty if that is not known.

    """

    wanted: Optimisation
    base: Trial
    trials: Sequence[Trial]
    importance: Mapping[str, float]

    def value(self, trial: Trial) -> float | None:
        """Return the number that is to be best; None if the run has none."""
        return trial.kept.get(self.wanted.goal)

    @property
    def best(self) -> Trial | None:
        """The best trial within all limits, the first of several; None without any."""
        good = [one for one in self.trials if one.keeps_limits and self.value(one) is not None]
        sign = -1.0 if self.wanted.maximise else 1.0
        return min(good, key=lambda one: sign * one.kept[self.wanted.goal], default=None)

    @property
    def nearest(self) -> Trial | None:
        """The trial that breaks limits least, where none keeps them; None if no run came to its end."""
        done = [one for one in self.trials if one.outcome == Outcome.DONE]
        return min(done, key=lambda one: sum(max(share, 0.0) for share in one.excess.values()), default=None)
