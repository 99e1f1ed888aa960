"""Options and execution of the commands with many runs: ``sweep`` and ``optimise``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.command import JsonOptions, argument, option
from delta3_pacdrive.cli.option_types import integer_within
from delta3_pacdrive.cli.studies import run_study

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from delta3_pacdrive.studies.fleet.sweep.study import Settings
    from delta3_pacdrive.studies.framework.study import OnProgress


@dataclass
class ManyRunsOptions(JsonOptions):
    """Options of a command with many runs."""

    specification: str = argument('specification of the varied values, YAML or Python')
    workers: int = option(
        'number of worker processes (default: one per core)',
        'N',
        default=0,
        type=integer_within(1, 1024),
    )
    scheduler: str | None = option(
        'address of a dask cluster to use instead of local processes', 'tcp://HOST:PORT'
    )

    parameters = None  # given in the specification


def settings_of(options: Any) -> Settings:
    """Return the settings of the study; raises SweepError if both workers and scheduler are given."""
    from delta3_pacdrive.errors import SweepError
    from delta3_pacdrive.studies.fleet.sweep.study import Settings

    if options.workers and options.scheduler:
        raise SweepError('--workers (local processes) and --scheduler (cluster) exclude each other')
    return Settings(Path(options.specification), options.workers, options.scheduler or '')


def run_many(options: Any, study: Callable[..., Any], text: Callable[[dict[str, Any]], Iterable[str]]) -> int:
    """Execute the runs of a study, print its summary and return the exit status.

    Parameters
    ----------
    options
        ``ManyRunsOptions`` with ``output``.
    study
        Class of the study.
    text
        Converts the summary to lines of text.

    """
    settings, folder = settings_of(options), Path(options.output).absolute()
    studies: list[Any] = []

    def work(show: OnProgress) -> dict[str, Any]:
        studies.append(study(settings, folder, options.command_line, show))
        found: dict[str, Any] = studies[0].run()
        return found

    def unfinished() -> str:
        if not studies:
            return 'interrupted before the first run'
        return f'interrupted: {studies[0].kept_text} in {folder}; the same command continues'

    return run_study(options, work, text, unfinished, folder)
