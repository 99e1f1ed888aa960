"""``delta3 sweep``: many runs in which parameters and values of the program vary, on all cores or on a cluster."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from delta3_pacdrive.cli.command import Command, JsonOptions, argument, flag, option
from delta3_pacdrive.cli.option_types import integer_within
from delta3_pacdrive.cli.studies import conduct

if TYPE_CHECKING:
    from delta3_pacdrive.analysis.study import OnProgress


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    specification: str = argument('file of the sweep, YAML or Python')
    workers: int = option(
        'processes that make the runs; one for each core if not given',
        'N',
        default=0,
        type=integer_within(1, 1024),
    )
    scheduler: str | None = option(
        'address of a dask cluster that is up, instead of own processes', 'tcp://HOST:PORT'
    )
    dry_run: bool = flag('say how many runs there are, how long they take and how much disk they need')
    run: int | None = option('make one run again, and nothing else', 'N', type=integer_within(1, 10_000_000))
    trace: str | None = option('with --run: write its signals to this file', 'FILE')
    output: str = option('folder for the runs, and for table, figures and report', 'DIR', default='sweep')

    parameters = None  # they stand in its file


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive.analysis.study import silent
    from delta3_pacdrive.analysis.sweep import report, run, study
    from delta3_pacdrive.cli.progress import announce_compilation
    from delta3_pacdrive.errors import SweepError

    if options.workers and options.scheduler:
        raise SweepError(
            '--workers is for own processes, --scheduler for a cluster that has its own: give one of them'
        )
    if (options.run is None) != (options.trace is None):
        raise SweepError('--run makes a run again, --trace says where its signals go: give both')
    if options.run is not None and (options.dry_run or options.workers or options.scheduler):
        raise SweepError('--run makes one run, here: it goes with --trace alone')
    settings = study.Settings(Path(options.specification), options.workers, options.scheduler or '')
    folder = Path(options.output).absolute()
    studies: list[run.Study] = []

    def made(show: OnProgress) -> run.Study:
        studies.append(run.Study(settings, folder, options.command_line, show))
        return studies[0]

    if options.run is not None and options.trace is not None:
        from delta3_pacdrive.recording import trace_file

        trace_file.require_writable_trace(options.trace)
        announce_compilation()
        trace = made(silent).again(options.run)
        trace_file.save(trace, options.trace)
        told = {'ok': True, 'run': options.run, 'trace': options.trace, 'figures': trace.meta['figures']}
        print(json.dumps(told) if options.json else f'run {options.run}: {options.trace}')
        return 0
    if options.dry_run:
        announce_compilation()
        told = made(silent).dry_run()
        if options.json:
            print(json.dumps(told))
        else:
            print(f'{told["sweep"]}: {told["runs"]} runs, {told["runs_made"]} of them are there')
            print(
                f'{1e3 * told["seconds_a_run"]:.0f} ms each on one core, {told["core_seconds"]:.0f} s for all that lack'
            )
            print(f'{told["disk_bytes"] / 1e6:.1f} MB on the disk')
        return 0

    def unfinished() -> str:
        if not studies:
            return 'interrupted: nothing was made'
        return f'interrupted: {studies[0].kept} of {studies[0].sweep.runs} runs are in {folder}; the command goes on'

    return conduct(options, lambda show: made(show).run(), report.text, unfinished, folder)


main = Command(
    'sweep',
    'Run a program many times without ROS while parameters and values of the program vary, as a file says; on all '
    'cores, or on a dask cluster. What is done is kept, and the same command goes on with what is missing.',
    Options,
    run,
)
