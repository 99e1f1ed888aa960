"""``delta3 optimise``: optimise values of parameters and of the program under constraints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from delta3_pacdrive.cli.command import Command, option
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.cli.studies import run_study
from delta3_pacdrive.cli.sweep import ManyRunsOptions, run_settings


@dataclass
class Options(ManyRunsOptions):
    """Options of the command."""

    output: str = option('folder for trials, best trial, figures and report', 'DIR', default='optimisation')


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive.studies.fleet.optimisation import report, run

    folder = Path(options.output).absolute()
    make = partial(run.Study, run_settings(options), folder, options.command_line)
    return run_study(options, make, report.text, folder)


main = Command(
    'optimise',
    'Optimise values of parameters and of the program for an objective under constraints, as specified in a file. '
    'Completed trials are kept; the same command continues. Writes the best trial as a parameter file and a program.',
    Options,
    run,
)
