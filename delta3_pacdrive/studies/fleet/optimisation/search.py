"""Search with Optuna: chooses values from the results of earlier trials and rates the importance of quantities.

Values are chosen in rounds of ``together`` trials, and the results of a round are reported before the next is chosen.
The choice therefore does not depend on the number of processes, and repeating a search with known results chooses the
same values.
"""

import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from delta3_pacdrive.studies.fleet.optimisation.study import Optimisation, Trial
from delta3_pacdrive.studies.fleet.sweep.program_values import value_at
from delta3_pacdrive.studies.fleet.sweep.single_run import Row
from delta3_pacdrive.studies.fleet.sweep.study import PROGRAM, Law, Outcome, Variation

NEEDED = "optimisations need optuna: pip install 'delta3_pacdrive[optimise]'"
FAILED = 1e9  # excess over the limits of a trial without a result
FREE_TRIALS = 10  # random trials before the search uses results
EXCESS = 'excess'
HEAD = ('run', 'outcome', 'reason')


class Search:
    """Chooses the values of trials."""

    def __init__(self, optimisation: Optimisation) -> None:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._optimisation = optimisation
        self._chosen = {one.key: _choice(one) for one in optimisation.sweep.vary}
        self._trials: dict[int, Any] = {}
        with _quiet():
            sampler = optuna.samplers.TPESampler(
                seed=optimisation.sweep.seed,
                multivariate=True,
                constant_liar=True,
                n_startup_trials=FREE_TRIALS,
                constraints_func=lambda trial: trial.user_attrs[EXCESS],
            )
            kinds = optuna.study.StudyDirection
            direction = kinds.MAXIMIZE if optimisation.maximise else kinds.MINIMIZE
            self._study = optuna.create_study(direction=direction, sampler=sampler)
            base = {
                one.key: _placed(one, base_value(optimisation, one.key)) for one in optimisation.sweep.vary
            }
            self.begins_with_base = None not in base.values()
            if self.begins_with_base:
                self._study.enqueue_trial(base)

    def rounds(self) -> Iterator[list[tuple[int, dict[str, Any]]]]:
        """Yield rounds of trial numbers and values; report the results of a round before requesting the next."""
        trials, size = self._optimisation.sweep.runs, self._optimisation.together
        for first in range(1, trials + 1, size):
            yield [(number, self._ask(number)) for number in range(first, min(first + size, trials + 1))]

    def _ask(self, number: int) -> dict[str, Any]:
        with _quiet():
            trial = self._trials[number] = self._study.ask(self._chosen)
        return {one.key: _value(one, trial.params[one.key]) for one in self._optimisation.sweep.vary}

    def report(self, trials: Iterable[Trial]) -> None:
        """Report the results of a round to the search."""
        for one in trials:
            asked, value = self._trials.pop(one.number), one.kept.get(self._optimisation.goal)
            failed = one.outcome != Outcome.DONE or value is None
            asked.set_user_attr(EXCESS, [FAILED if failed else 0.0, *one.excess.values()])
            worst = float('-inf') if self._optimisation.maximise else float('inf')
            with _quiet():
                self._study.tell(asked, worst if failed else value)

    def importance(self) -> dict[str, float]:
        """Return the share of each quantity in the quality of a trial, largest first; empty if unknown."""
        import optuna

        with _quiet():
            evaluator = optuna.importance.PedAnovaImportanceEvaluator()
            try:
                found = optuna.importance.get_param_importances(self._study, evaluator=evaluator)
            except (RuntimeError, ValueError):  # too few trials, or no differences
                return {}
        return {key: float(share) for key, share in found.items()}


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress warnings of experimental features."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        yield


def _choice(one: Variation) -> Any:
    """Return the distribution of a quantity; for lists that of the index, ordered for numbers."""
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    if one.law is Law.UNIFORM:
        return FloatDistribution(*one.values)
    if one.is_number:
        return IntDistribution(0, len(one.values) - 1)
    return CategoricalDistribution(tuple(range(len(one.values))))


def _value(one: Variation, chosen: Any) -> Any:
    if one.law is Law.UNIFORM:
        return float(chosen)
    return _ordered(one)[chosen]


def _placed(one: Variation, value: Any) -> Any:
    """Return the optuna parameter of a value; None if it is outside the search space."""
    if one.law is Law.UNIFORM:
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        return float(value) if is_number and one.values[0] <= value <= one.values[1] else None
    return _ordered(one).index(value) if value in one.values else None


def _ordered(one: Variation) -> list[Any]:
    return sorted(one.values) if one.is_number else list(one.values)


def base_value(optimisation: Optimisation, key: str) -> Any:
    """Return the value of a quantity in the files; None if it is not set there."""
    if key.startswith(PROGRAM):
        return value_at(optimisation.sweep.program, key.removeprefix(PROGRAM))
    name, bracket, rest = key.partition('[')
    value = optimisation.sweep.parameters[name]
    return value[int(rest.removesuffix(']'))] if bracket else value


def trial_of(optimisation: Optimisation, number: int, values: Mapping[str, Any], row: Row) -> Trial:
    """Return the trial of a run."""
    kept = {
        name: float(value)
        for name, value in row.items()
        if name not in HEAD and name not in values and value is not None and value == value
    }
    outcome, reason = Outcome(row['outcome']), row['reason']
    if outcome == Outcome.DONE and optimisation.goal not in kept:
        reason = f'the run has no {optimisation.goal}'
    excess = {
        name: (kept[name] - limit) / max(abs(limit), 1e-12) if name in kept else FAILED
        for name, limit in optimisation.sweep.limits.items()
    }
    return Trial(number=number, values=values, kept=kept, outcome=outcome, reason=reason, excess=excess)


def base_values(optimisation: Optimisation) -> dict[str, Any]:
    """Return the values in the files, without values that are not set there."""
    found = {one.key: base_value(optimisation, one.key) for one in optimisation.sweep.vary}
    return {key: value for key, value in found.items() if value is not None}
