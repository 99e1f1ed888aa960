"""``delta3 commission``: acceptance protocol of a running robot."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from delta3_pacdrive.cli.command import PARAMETERS, Command, JsonOptions, NodeOptions, argument, flag, option
from delta3_pacdrive.cli.option_types import number_within
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.cli.studies import run_study

ACTIONS = {'report': 'check the robot and write the acceptance protocol'}


@dataclass
class Options(NodeOptions, JsonOptions):
    """Options of the command."""

    action: str = argument('one of the actions below', choices=ACTIONS, metavar='ACTION')
    parameters: str | None = option(f'expected in the drives; {PARAMETERS}', 'FILE')
    program: str = option(
        'packaged program for the following error and the currents', 'PROGRAM', default='packaging'
    )
    phase_margin: float = option(
        'least phase margin', 'DEG', default=30.0, type=number_within(1.0, 90.0, 'deg')
    )
    gain_margin: float = option('least gain margin', 'DB', default=6.0, type=number_within(0.1, 40.0, 'dB'))
    tcp_error: float = option(
        'largest TCP error in the program [mm]', 'MM', default=1.0, type=number_within(1e-3, 100.0, 'mm')
    )
    take_over: bool = flag('take control even if another operator has it')
    output: str = option('folder for protocol, table and figures', 'FOLDER', default='acceptance')


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.studies.drives.commissioning import acceptance

    settings = acceptance.Settings(
        core.load(options.parameters),
        options.parameters,
        options.program,
        options.phase_margin,
        options.gain_margin,
        tcp_error_m=1e-3 * options.tcp_error,
    )
    folder = Path(options.output)
    failed: list[str] = []

    def run_all(study: Any) -> dict[str, Any]:
        document: dict[str, Any] = study.run()
        failed.extend(one['name'] for one in document['checks'] if not one['passed'])
        return document

    output = run_study(
        options,
        lambda show: acceptance.Study(settings, folder, options.command_line, show, partial(_robot, options)),
        acceptance.text,
        folder,
        run=run_all,
    )
    return replace(output, status=1) if failed else output


@contextmanager
def _robot(options: Options) -> Iterator[Any]:
    from delta3_pacdrive.ros.clients.commissioning_client import CommissioningRobot
    from delta3_pacdrive.ros.clients.robot_client import operating

    with operating(options.namespace) as operator:
        robot = CommissioningRobot(operator)
        with robot.exclusive('delta3 commission', options.take_over):
            yield robot


main = Command(
    'commission',
    'Check a running robot at its pose: parameters, margins, mechanics, a test program, brakes, encoders, temperatures '
    'and the bus. Write every value with its limit to a protocol; the exit status is 1 if a check fails.',
    Options,
    run,
    ACTIONS,
)
