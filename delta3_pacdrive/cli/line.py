"""``delta3 line``: a shift of several robots at belts, from event to event: who picks what, and what is missed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.cli.command import Command, JsonOptions, argument, option
from delta3_pacdrive.cli.option_types import SEED, integer_within, number_within
from delta3_pacdrive.cli.studies import conduct

RULES = ('first come', 'nearest', 'balanced', 'optimal')  # as ``analysis.line.design`` has them


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    specification: str = argument('file of the line, or line: the packaged one')
    rule: str | None = option('allocate parts by this rule instead of that of the file', choices=RULES)
    seed: int | None = option('seed of the parts instead of that of the file', 'N', type=SEED)
    hours: float | None = option(
        'how long the shift is, instead of what the file says', 'H', type=number_within(1e-3, 24.0)
    )
    plans: int = option(
        'real plans that the tables of cycle times are checked against',
        'N',
        default=100,
        type=integer_within(0, 100_000),
    )
    output: str = option('folder for tables, figures and report', 'DIR', default='line')

    parameters = None  # they stand in its file


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive.analysis.line import report, run, specification, study
    from delta3_pacdrive.analysis.line.design import Rule

    settings = study.Settings(
        specification.find(options.specification),
        None if options.rule is None else Rule(options.rule),
        options.seed,
        options.hours,
        options.plans,
    )
    folder = Path(options.output).absolute()
    return conduct(
        options,
        lambda show: run.Study(settings, folder, options.command_line, show).run(),
        report.text,
        writes=folder,
    )


main = Command(
    'line',
    'One shift of several robots at belts that run through all of them, from event to event with planned cycle times: '
    'who picks what by which rule, and which parts are missed and why.',
    Options,
    run,
)
