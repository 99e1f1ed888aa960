"""What the commands share that make many runs with workers: their options, and what an interruption leaves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.command import JsonOptions, argument, option
from delta3_pacdrive.cli.option_types import integer_within
from delta3_pacdrive.cli.studies import run_study

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from delta3_pacdrive.analysis.study import OnProgress
    from delta3_pacdrive.analysis.sweep.study import Settings


@dataclass
class ManyRunsOptions(JsonOptions):
    """Options of a command that makes many runs."""

    specification: str = argument('file that says what varies, YAML or Python')
    workers: int = option(
        'processes that make the runs; one for each core if not given',
        'N',
        default=0,
        type=integer_within(1, 1024),
    )
    scheduler: str | None = option(
        'address of a dask cluster that is up, instead of own processes', 'tcp://HOST:PORT'
    )

    parameters = None  # they stand in its file


def settings_of(options: Any) -> Settings:
    """Return the settings of the study; raises SweepError if workers are to be in two places."""
    from delta3_pacdrive.analysis.sweep.study import Settings
    from delta3_pacdrive.errors import SweepError

    if options.workers and options.scheduler:
        raise SweepError(
            '--workers is for own processes, --scheduler for a cluster that has its own: give one of them'
        )
    return Settings(Path(options.specification), options.workers, options.scheduler or '')


def run_many(options: Any, study: Callable[..., Any], text: Callable[[dict[str, Any]], Iterable[str]]) -> int:
    """Make the runs of a study, print its summary and return the exit status; an interrupted study goes on later.

    Parameters
    ----------
    options
        ``ManyRunsOptions`` with ``output``.
    study
        Class of the study; ``kept_text`` describes the runs on disk.
    text
        Turns the summary into lines for people.

    """
    settings, folder = settings_of(options), Path(options.output).absolute()
    studies: list[Any] = []

    def work(show: OnProgress) -> dict[str, Any]:
        studies.append(study(settings, folder, options.command_line, show))
        found: dict[str, Any] = studies[0].run()
        return found

    def unfinished() -> str:
        if not studies:
            return 'interrupted: nothing was made'
        return f'interrupted: {studies[0].kept_text} in {folder}; the command goes on'

    return run_study(options, work, text, unfinished, folder)
