"""``delta3 sweep``: run a program many times with varied parameters, on all cores or on a cluster."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.command import Command, JsonOptions, argument, flag, option, settings_of
from delta3_pacdrive.cli.option_types import integer_within
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.cli.studies import run_study

if TYPE_CHECKING:
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


@dataclass
class Options(ManyRunsOptions):
    """Options of the command."""

    dry_run: bool = flag('only print the number of runs and the required time and disk space')
    run: int | None = option('only repeat run N', 'N', type=integer_within(1, 10_000_000))
    trace: str | None = option('with --run: write the signals to this file', 'FILE')
    output: str = option('folder for runs, table, figures and report', 'DIR', default='sweep')


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive.cli.progress import announce_compilation
    from delta3_pacdrive.errors import SweepError
    from delta3_pacdrive.recording import trace_file
    from delta3_pacdrive.studies.fleet.sweep import report, run
    from delta3_pacdrive.studies.framework.study import silent

    if (options.run is None) != (options.trace is None):
        raise SweepError('--run and --trace must be given together')
    if options.run is not None and (options.dry_run or options.workers or options.scheduler):
        raise SweepError('--run can be combined with --trace only')
    settings, folder = run_settings(options), Path(options.output).absolute()
    make = partial(run.Study, settings, folder, options.command_line)
    if options.run is None and not options.dry_run:
        return run_study(options, make, report.text, folder)
    if options.trace is not None:
        trace_file.require_writable_trace(options.trace)
    announce_compilation()
    study = make(silent)
    if options.run is None or options.trace is None:
        result = study.dry_run()
        return Output(result, _dry_run_text(result))
    trace = study.again(options.run)
    trace_file.save(trace, options.trace)
    result = {'ok': True, 'run': options.run, 'trace': options.trace, 'figures': trace.meta['figures']}
    return Output(result, [f'run {options.run}: {options.trace}'])


def _dry_run_text(result: dict[str, Any]) -> list[str]:
    return [
        f'{result["sweep"]}: {result["runs"]} runs, {result["runs_made"]} of them completed',
        f'{1e3 * result["seconds_a_run"]:.0f} ms each on one core, {result["core_seconds"]:.0f} s for all remaining',
        f'{result["disk_bytes"] / 1e6:.1f} MB of disk space',
    ]


main = Command(
    'sweep',
    'Run a program many times without ROS with varied parameters and program values, as specified in a file, on all '
    'cores or on a dask cluster. Completed runs are kept; the same command continues with the missing ones.',
    Options,
    run,
)
