"""``delta3 learn``: iterative learning of feed-forward torques for a program."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.cli.command import Command, JsonOptions, argument, option, settings_of
from delta3_pacdrive.cli.option_types import integer_within, number_within
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.cli.studies import run_study
from delta3_pacdrive.configuration.packaged import program_names


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    program: str = argument(
        f'program file, or a packaged program: {", ".join(program_names())}', default='packaging'
    )
    parameters: str | None = option(
        'parameter file with feed-forward of the model torque, such as model',
        'FILE',
    )
    plant: str | None = option(
        'parameter file of the simulated robot, if it differs from the one that the controller assumes',
        'FILE',
        formerly='--machine',
    )
    repetitions: int = option('maximum number of repetitions', 'N', default=10, type=integer_within(1, 100))
    bandwidth: float = option(
        'bandwidth of learning [Hz]', 'HZ', default=80.0, type=number_within(1.0, 1e4, 'Hz')
    )
    output: str = option('folder for torques, table, figures and report', 'DIR', default='learned')


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.studies.learning import report, run, study

    options.parameters = core.of_run(options.parameters, options.program)
    if options.plant is not None:
        options.plant = core.of_run(options.plant, options.program)
    settings = settings_of(study.Settings, options, machine=options.plant, bandwidth_hz=options.bandwidth)
    folder = Path(options.output).absolute()
    return run_study(
        options, lambda show: run.Study(settings, folder, options.command_line, show), report.text, folder
    )


main = Command(
    'learn',
    'Repeat a program in simulation and learn feed-forward torques from its errors (norm-optimal iterative learning '
    'control). Use the result with simulate/run --learned.',
    Options,
    run,
)
