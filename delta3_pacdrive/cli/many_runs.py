"""Options and execution of the commands with many runs: ``sweep`` and ``optimise``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.command import JsonOptions, argument, option, settings_of
from delta3_pacdrive.cli.option_types import integer_within
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.cli.studies import run_study

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from delta3_pacdrive.studies.fleet.sweep.study import Settings


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


def run_settings(options: Any) -> Settings:
    """Return the settings of the study; raises SweepError if both workers and scheduler are given."""
    from delta3_pacdrive.errors import SweepError
    from delta3_pacdrive.studies.fleet.sweep.study import Settings

    if options.workers and options.scheduler:
        raise SweepError('--workers (local processes) and --scheduler (cluster) exclude each other')
    specification, scheduler = Path(options.specification), options.scheduler or ''
    return settings_of(Settings, options, specification=specification, scheduler=scheduler)


def run_many(
    options: Any, study: Callable[..., Any], text: Callable[[dict[str, Any]], Iterable[str]]
) -> Output:
    """Execute the runs of a study and return its output.

    Parameters
    ----------
    options
        ``ManyRunsOptions`` with ``output``.
    study
        Class of the study.
    text
        Converts the summary to lines of text.

    """
    settings, folder = run_settings(options), Path(options.output).absolute()
    return run_study(options, lambda show: study(settings, folder, options.command_line, show), text, folder)
