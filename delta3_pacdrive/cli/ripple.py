"""``delta3 ripple``: what bus cycle and fine interpolation make of the motor currents; a look inside a bus cycle."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.cli.command import PARAMETERS, Command, JsonOptions, argument, option
from delta3_pacdrive.cli.option_types import number_within
from delta3_pacdrive.cli.studies import run_study
from delta3_pacdrive.configuration.packaged import program_names

CYCLE_TIMES_MS = {'1': 1e-3, '2': 2e-3, '4': 4e-3}
INTERPOLATIONS = ('linear', 'cubic')


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    program: str = argument(
        f'program file, or a packaged program: {", ".join(program_names())}', default='experiment1'
    )
    cycle_time: list[str] | None = option(
        'cycle time of the bus [ms]; may be repeated; all of them if none is given',
        'MS',
        choices=CYCLE_TIMES_MS,
        action='append',
    )
    interpolation: list[str] | None = option(
        'fine interpolation of the drives; may be repeated; both if none is given',
        'NAME',
        choices=INTERPOLATIONS,
        action='append',
    )
    axis: int = option('motor that is shown', 'N', default=1, type=int, choices=(1, 2, 3))
    at: float | None = option(
        'show the bus cycle at this time from the start of the program; that of the largest current if not given',
        'S',
        type=number_within(0.0, 1e6, 's'),
    )
    parameters: str | None = option(PARAMETERS, 'FILE')
    output: str = option('folder for table, figures and report', 'DIR', default='ripple')


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive.analysis.ripple import report, run, study

    times = dict.fromkeys(options.cycle_time or CYCLE_TIMES_MS)
    settings = study.Settings(
        options.program,
        options.parameters,
        tuple(CYCLE_TIMES_MS[text] for text in times),
        tuple(dict.fromkeys(options.interpolation or INTERPOLATIONS)),
        options.axis,
        options.at,
    )
    folder = Path(options.output).absolute()
    return run_study(
        options,
        lambda show: run.Study(settings, folder, options.command_line, show).run(),
        report.text,
        writes=folder,
    )


main = Command(
    'ripple',
    'Run a program with an oscilloscope in every drive, for each cycle time of the bus and each fine interpolation: '
    'peak and rms of the currents as the AT tell them and of all samples, jerk, TCP error, and what happens inside a '
    'bus cycle.',
    Options,
    run,
)
