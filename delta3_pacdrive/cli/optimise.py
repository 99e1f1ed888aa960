"""``delta3 optimise``: optimise values of parameters and of the program under constraints."""

from __future__ import annotations

from dataclasses import dataclass

from delta3_pacdrive.cli.command import Command, option
from delta3_pacdrive.cli.many_runs import ManyRunsOptions, run_many
from delta3_pacdrive.cli.output import Output


@dataclass
class Options(ManyRunsOptions):
    """Options of the command."""

    output: str = option('folder for trials, best trial, figures and report', 'DIR', default='optimisation')


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive.studies.fleet.optimisation import report, run

    return run_many(options, run.Study, report.text)


main = Command(
    'optimise',
    'Optimise values of parameters and of the program for an objective under constraints, as specified in a file. '
    'Completed trials are kept; the same command continues. Writes the best trial as a parameter file and a program.',
    Options,
    run,
)
