"""``delta3 report``: write one HTML file with the 3-D view, signals, moves, figures and provenance of runs."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.cli.command import Command, option
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.cli.run_options import RunOptions


@dataclass
class Options(RunOptions):
    """Options of the command."""

    output: str = option('output file; an existing one is replaced', 'FILE.html', default='report.html')
    scope: str | None = option(
        'add these oscilloscope records of the (first) run, written by delta3 scope or simulate --scope',
        'FILE[,FILE...]',
    )

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if len(self.inputs) > 1:
            from delta3_pacdrive.studies.report_page.page import RUNS_MAX

            if len(self.inputs) > RUNS_MAX:
                return f'a report takes at most {RUNS_MAX} runs, not {len(self.inputs)}'
        return super().check()


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive.recording import record_file
    from delta3_pacdrive.robot.motor import thermal_warnings
    from delta3_pacdrive.studies.framework.provenance import Provenance
    from delta3_pacdrive.studies.report_page import page
    from delta3_pacdrive.studies.runs.inputs import with_digests
    from delta3_pacdrive.studies.runs.run_comparison import driven_currents

    path = Path(options.output)
    page.require_writable_page(path)
    files = options.scope.split(',') if options.scope else []
    records = [record_file.read(name) for name in files]
    runs = options.runs()
    inputs = [*(one.origin for one in runs), *with_digests(files)]
    origin = Provenance.of(options.command_line, runs[0].robot, runs[0].parameter_source, inputs)
    page.write(path, runs, origin, options.align, records)
    warnings = {
        one.name: thermal_warnings(currents[1], one.robot.motor.nominal_current_a)
        for one in runs
        if (currents := driven_currents(one)) is not None
    }
    result = {'ok': True, 'files': [str(path)], 'bytes': path.stat().st_size, 'warnings': warnings}
    lines = [f'warning: {name}: {sentence}' for name, found in warnings.items() for sentence in found]
    return Output(result | {'provenance': origin.lines()}, [str(path), *lines])


main = Command(
    'report',
    'Write one HTML file with one or several runs side by side: 3-D view, plots, moves, figures. It opens offline.',
    Options,
    run,
)
