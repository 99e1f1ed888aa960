"""``delta3 optimise``: values of parameters and of the program for which a number of the run is best, within limits."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from delta3_pacdrive.cli.command import Command, JsonOptions, argument, option
from delta3_pacdrive.cli.option_types import integer_within
from delta3_pacdrive.cli.studies import conduct

if TYPE_CHECKING:
    from delta3_pacdrive.analysis.study import OnProgress


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    specification: str = argument('file of the optimisation, YAML or Python')
    workers: int = option(
        'processes that make the runs; one for each core if not given',
        'N',
        default=0,
        type=integer_within(1, 1024),
    )
    scheduler: str | None = option(
        'address of a dask cluster that is up, instead of own processes', 'tcp://HOST:PORT'
    )
    output: str = option(
        'folder for the trials, the best of them, figures and report', 'DIR', default='optimisation'
    )

    parameters = None  # they stand in its file


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive.analysis.optimisation import report, run, study
    from delta3_pacdrive.errors import SweepError

    if options.workers and options.scheduler:
        raise SweepError(
            '--workers is for own processes, --scheduler for a cluster that has its own: give one of them'
        )
    settings = study.Settings(Path(options.specification), options.workers, options.scheduler or '')
    folder = Path(options.output).absolute()
    studies: list[run.Study] = []

    def made(show: OnProgress) -> run.Study:
        studies.append(run.Study(settings, folder, options.command_line, show))
        return studies[0]

    def unfinished() -> str:
        if not studies:
            return 'interrupted: nothing was made'
        return f'interrupted: {studies[0].kept} runs are in {folder}; the command goes on'

    return conduct(options, lambda show: made(show).run(), report.text, unfinished, folder)


main = Command(
    'optimise',
    'Choose values of parameters and of the program for which a number of the run is best, and others keep their '
    'limits, as a file says. What is done is kept, and the same command goes on. The best trial is left as a parameter '
    'file and a program.',
    Options,
    run,
)
