"""``delta3 sweep``: many runs in which parameters and values of the program vary, on all cores or on a cluster."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from delta3_pacdrive.cli.command import Command, flag, option
from delta3_pacdrive.cli.many_runs import ManyRunsOptions, run_many, settings_of
from delta3_pacdrive.cli.option_types import integer_within


@dataclass
class Options(ManyRunsOptions):
    """Options of the command."""

    dry_run: bool = flag('say how many runs there are, how long they take and how much disk they need')
    run: int | None = option('make one run again, and nothing else', 'N', type=integer_within(1, 10_000_000))
    trace: str | None = option('with --run: write its signals to this file', 'FILE')
    output: str = option('folder for the runs, and for table, figures and report', 'DIR', default='sweep')


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive.analysis.study import silent
    from delta3_pacdrive.analysis.sweep import report, run
    from delta3_pacdrive.cli.progress import announce_compilation
    from delta3_pacdrive.errors import SweepError

    if (options.run is None) != (options.trace is None):
        raise SweepError('--run makes a run again, --trace says where its signals go: give both')
    if options.run is not None and (options.dry_run or options.workers or options.scheduler):
        raise SweepError('--run makes one run, here: it goes with --trace alone')
    if options.run is None and not options.dry_run:
        return run_many(options, run.Study, report.text)
    settings, folder = settings_of(options), Path(options.output).absolute()
    if options.trace is not None:
        from delta3_pacdrive.recording import trace_file

        trace_file.require_writable_trace(options.trace)
    announce_compilation()
    study = run.Study(settings, folder, options.command_line, silent)
    if options.run is not None and options.trace is not None:
        trace = study.again(options.run)
        trace_file.save(trace, options.trace)
        told = {'ok': True, 'run': options.run, 'trace': options.trace, 'figures': trace.meta['figures']}
        print(json.dumps(told) if options.json else f'run {options.run}: {options.trace}')
    else:
        told = study.dry_run()
        print(json.dumps(told) if options.json else '\n'.join(_dry(told)))
    return 0


def _dry(told: dict[str, Any]) -> list[str]:
    """Return what a dry run tells, as lines for people."""
    return [
        f'{told["sweep"]}: {told["runs"]} runs, {told["runs_made"]} of them are there',
        f'{1e3 * told["seconds_a_run"]:.0f} ms each on one core, {told["core_seconds"]:.0f} s for all that lack',
        f'{told["disk_bytes"] / 1e6:.1f} MB on the disk',
    ]


main = Command(
    'sweep',
    'Run a program many times without ROS while parameters and values of the program vary, as a file says; on all '
    'cores, or on a dask cluster. What is done is kept, and the same command goes on with what is missing.',
    Options,
    run,
)
