"""``delta3 learn``: iterative learning of feed-forward torques for a program."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.command import Command, JsonOptions, argument, option
from delta3_pacdrive.cli.option_types import integer_within, number_within
from delta3_pacdrive.cli.studies import run_study
from delta3_pacdrive.configuration.packaged import program_names

if TYPE_CHECKING:
    from delta3_pacdrive.studies.framework.study import OnProgress


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


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.studies.learning import report, run, study

    options.parameters = core.of_run(options.parameters, options.program)
    if options.plant is not None:
        options.plant = core.of_run(options.plant, options.program)
    settings = study.Settings(
        options.program, options.parameters, options.plant, options.repetitions, options.bandwidth
    )
    folder = Path(options.output).absolute()
    studies: list[run.Study] = []

    def work(show: 'OnProgress') -> dict[str, Any]:
        studies.append(run.Study(settings, folder, options.command_line, show))
        return studies[0].run()

    def unfinished() -> str:
        if not studies or not studies[0].kept:
            return 'interrupted before the first result; nothing was written'
        return f'interrupted: the torques of repetition {studies[0].kept} are in {studies[0].file}'

    return run_study(options, work, report.text, unfinished, folder)


main = Command(
    'learn',
    'Repeat a program in simulation and learn feed-forward torques from its errors (norm-optimal iterative learning '
    'control). Use the result with simulate/run --learned.',
    Options,
    run,
)
