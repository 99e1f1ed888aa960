"""``delta3 ripple``: effect of bus cycle time and fine interpolation on the motor currents."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.cli.command import PARAMETERS, Command, JsonOptions, argument, option, settings_of
from delta3_pacdrive.cli.option_types import number_within
from delta3_pacdrive.cli.output import Output
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
        'cycle time of the bus [ms]; repeatable (default: all)',
        'MS',
        choices=CYCLE_TIMES_MS,
        action='append',
    )
    interpolation: list[str] | None = option(
        'fine interpolation of the drives; repeatable (default: both)',
        'NAME',
        choices=INTERPOLATIONS,
        action='append',
    )
    axis: int = option('motor to show', 'N', default=1, type=int, choices=(1, 2, 3))
    at: float | None = option(
        'show the bus cycle at this time from the start of the program [s] (default: that of the largest current)',
        'S',
        type=number_within(0.0, 1e6, 's'),
    )
    parameters: str | None = option(PARAMETERS, 'FILE')
    output: str = option('folder for table, figures and report', 'DIR', default='ripple')


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive.studies.drives.ripple import report, run, study

    times = dict.fromkeys(options.cycle_time or CYCLE_TIMES_MS)
    settings = settings_of(
        study.Settings,
        options,
        cycle_times_s=tuple(CYCLE_TIMES_MS[text] for text in times),
        interpolations=tuple(dict.fromkeys(options.interpolation or INTERPOLATIONS)),
        at_s=options.at,
    )
    folder = Path(options.output).absolute()
    return run_study(
        options, lambda show: run.Study(settings, folder, options.command_line, show), report.text, folder
    )


main = Command(
    'ripple',
    'Run a program with an oscilloscope in every drive for each bus cycle time and fine interpolation: peak and rms of '
    'the currents in the AT and of all samples, jerk, TCP error, and the signals within one bus cycle.',
    Options,
    run,
)
