"""``delta3 optimise``: values of parameters and of the program for which a number of the run is best, within limits."""

from __future__ import annotations

from dataclasses import dataclass

from delta3_pacdrive.cli.command import Command, option
from delta3_pacdrive.cli.many_runs import ManyRunsOptions, run_many


@dataclass
class Options(ManyRunsOptions):
    """Options of the command."""

    output: str = option(
        'folder for the trials, the best of them, figures and report', 'DIR', default='optimisation'
    )


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive.analysis.optimisation import report, run

    return run_many(options, run.Study, report.text)


main = Command(
    'optimise',
    'Choose values of parameters and of the program for which a number of the run is best, and others keep their '
    'limits, as a file says. What is done is kept, and the same command goes on. The best trial is left as a parameter '
    'file and a program.',
    Options,
    run,
)
