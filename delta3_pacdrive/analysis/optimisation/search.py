"""The search: Optuna chooses values, knows what became of those before, and says what mattered.

Values are chosen in rounds of ``together`` trials; what a round comes to is told before the next one is chosen. So they
are the same however many processes make the runs, and a search that is repeated with what is known chooses the same.
"""

import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from delta3_pacdrive.analysis.optimisation.design import Optimisation, Trial
from delta3_pacdrive.analysis.sweep.design import PROGRAM, Law, Outcome, Variation
from delta3_pacdrive.analysis.sweep.program_values import value_at
from delta3_pacdrive.analysis.sweep.single_run import Row

NEEDED = "optimisations need optuna: pip install 'delta3_pacdrive[optimise]'"
FAILED = 1e9  # what a trial without a number breaks its limits by
FREE_TRIALS = 10  # that are drawn at random before the search knows enough
EXCESS = 'excess'
HEAD = ('run', 'outcome', 'reason')


class Search:
    """A search chooses the values of trials.

    Parameters
    ----------
    wanted
        What is searched for.

    """

    def __init__(self, wanted: Optimisation) -> None:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._wanted, self._chosen = wanted, {one.key: _choice(one) for one in wanted.sweep.vary}
        self._trials: dict[int, Any] = {}
        with _quiet():
            sampler = optuna.samplers.TPESampler(
                seed=wanted.sweep.seed,
                multivariate=True,
                constant_liar=True,
                n_startup_trials=FREE_TRIALS,
                constraints_func=lambda trial: trial.user_attrs[EXCESS],
            )
            kinds = optuna.study.StudyDirection
            direction = kinds.MAXIMIZE if wanted.maximise else kinds.MINIMIZE
            self._study = optuna.create_study(direction=direction, sampler=sampler)
            base = {one.key: _placed(one, base_value(wanted, one.key)) for one in wanted.sweep.vary}
            self.begins_with_base = None not in base.values()
            if self.begins_with_base:
                self._study.enqueue_trial(base)

    def rounds(self) -> Iterator[list[tuple[int, dict[str, Any]]]]:
        """Return numbers and values of the trials, a round at a time; one is told before the next is asked for."""
        trials, size = self._wanted.sweep.runs, self._wanted.together
        for first in range(1, trials + 1, size):
            yield [(number, self._ask(number)) for number in range(first, min(first + size, trials + 1))]

    def _ask(self, number: int) -> dict[str, Any]:
        with _quiet():
            trial = self._trials[number] = self._study.ask(self._chosen)
        return {one.key: _value(one, trial.params[one.key]) for one in self._wanted.sweep.vary}

    def tell(self, trials: Iterable[Trial]) -> None:
        """Take what became of a round."""
        for one in trials:
            asked, value = self._trials.pop(one.number), one.kept.get(self._wanted.goal)
            failed = one.outcome != Outcome.DONE or value is None
            asked.set_user_attr(EXCESS, [FAILED if failed else 0.0, *one.excess.values()])
            worst = float('-inf') if self._wanted.maximise else float('inf')
            with _quiet():
                self._study.tell(asked, worst if failed else value)

    def importance(self) -> dict[str, float]:
        """Return the share of each quantity in whether a trial is a good one, largest first; empty if not known."""
        import optuna

        with _quiet():
            evaluator = optuna.importance.PedAnovaImportanceEvaluator()
            try:
                found = optuna.importance.get_param_importances(self._study, evaluator=evaluator)
            except (RuntimeError, ValueError):  # too few trials, or all of them alike
                return {}
        return {key: float(share) for key, share in found.items()}


@contextmanager
def _quiet() -> Iterator[None]:
    """Let the library not tell what is new in it."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        yield


def _choice(one: Variation) -> Any:
    """Return the distribution of a quantity; out of lists places are chosen, of numbers in their order."""
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
    """Return what stands for a value that may be chosen; None for one that may not."""
    if one.law is Law.UNIFORM:
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        return float(value) if is_number and one.values[0] <= value <= one.values[1] else None
    return _ordered(one).index(value) if value in one.values else None


def _ordered(one: Variation) -> list[Any]:
    return sorted(one.values) if one.is_number else list(one.values)


def base_value(wanted: Optimisation, key: str) -> Any:
    """Return the value that the files have of what is chosen; None if they have none."""
    if key.startswith(PROGRAM):
        return value_at(wanted.sweep.program, key.removeprefix(PROGRAM))
    name, bracket, rest = key.partition('[')
    value = wanted.sweep.parameters[name]
    return value[int(rest.removesuffix(']'))] if bracket else value


def trial_of(wanted: Optimisation, number: int, values: Mapping[str, Any], row: Row) -> Trial:
    """Return the trial whose run left a row."""
    kept = {
        name: float(value)
        for name, value in row.items()
        if name not in HEAD and name not in values and value is not None and value == value
    }
    outcome, reason = Outcome(row['outcome']), row['reason']
    if outcome == Outcome.DONE and wanted.goal not in kept:
        reason = f'its run has no {wanted.goal}'
    excess = {
        name: (kept[name] - limit) / max(abs(limit), 1e-12) if name in kept else FAILED
        for name, limit in wanted.sweep.limits.items()
    }
    return Trial(number, values, kept, outcome, reason, excess)


def base_values(wanted: Optimisation) -> dict[str, Any]:
    """Return the values that the files have; those of the program that stand nowhere are left out."""
    found = {one.key: base_value(wanted, one.key) for one in wanted.sweep.vary}
    return {key: value for key, value in found.items() if value is not None}
