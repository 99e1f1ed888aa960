"""``delta3 line``: event-driven simulation of a shift of several robots at common belts."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.command import Command, JsonOptions, argument, flag, option, settings_of
from delta3_pacdrive.cli.option_types import SEED, integer_within, number_within
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.cli.studies import run_study

if TYPE_CHECKING:
    from collections.abc import Iterable

MINUTE_S = 60.0
RULES = ('first come', 'nearest', 'balanced', 'optimal')  # as ``studies.fleet.line.design`` has them


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    specification: str = argument('line file, or line for the packaged one')
    rule: str | None = option('allocation rule for parts, instead of that of the file', choices=RULES)
    seed: int | None = option('seed of the parts, instead of that of the file', 'N', type=SEED)
    hours: float | None = option(
        'duration of the shift [h], instead of that of the file', 'H', type=number_within(1e-3, 24.0)
    )
    plans: int = option(
        'number of plans used to verify the tables of cycle times',
        'N',
        default=100,
        type=integer_within(0, 100_000),
    )
    replay: str | None = option('replay one minute of this robot with the full simulation', 'ROBOT')
    minute: int | None = option(
        'minute of the shift for --replay and --common-supply, from 1', 'N', type=integer_within(1, 24 * 60)
    )
    common_supply: bool = flag(
        'replay all robots in this minute, and show the load of one DC link for all of them',
        excludes=('--replay',),
    )
    output: str = option('folder for tables, figures and report', 'DIR', default='line_shift')

    parameters = None  # given in the line file


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive.errors import LineError
    from delta3_pacdrive.studies.fleet.line import report, run, specification, study
    from delta3_pacdrive.studies.fleet.line.design import Rule

    settings = settings_of(
        study.Settings,
        options,
        specification=specification.find(options.specification),
        rule=None if options.rule is None else Rule(options.rule),
    )
    if (options.replay is None and not options.common_supply) != (options.minute is None):
        raise LineError('--replay or --common-supply, and --minute must be given together')
    folder = Path(options.output).absolute()

    def simulated(made: run.Study) -> dict[str, Any]:
        if options.minute is None:
            return made.run()
        made.require_minute(options.minute, options.replay)
        summary, begin_s = made.run(), MINUTE_S * (options.minute - 1)
        from delta3_pacdrive.benchmarks import line_replay

        if options.replay is None:
            return summary | {'common_supply': asdict(line_replay.common(made, begin_s))}
        made.on_progress(f'{options.replay} again', 0, 0)
        again = line_replay.replay(made.line, made.belt_of(options.replay), options.replay, begin_s)
        return summary | {'replay': line_replay.summary(again.parts)}

    def text(summary: dict[str, Any]) -> Iterable[str]:
        yield from report.text(summary)
        if 'replay' in summary:
            from delta3_pacdrive.benchmarks import line_replay

            yield from ['', *line_replay.text(summary['replay'])]
        if 'common_supply' in summary:
            from delta3_pacdrive.studies.runs.run_supply import CommonSupply

            yield from ['', *CommonSupply.of(summary['common_supply']).lines()]

    return run_study(
        options, lambda show: run.Study(settings, folder, options.command_line, show), text, folder, simulated
    )


main = Command(
    'line',
    'Simulate a shift of several robots at common belts with planned cycle times: which robot picks which part by the '
    'allocation rule, and which parts are missed for which reason.',
    Options,
    run,
)
