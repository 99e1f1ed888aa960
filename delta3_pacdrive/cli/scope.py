"""``delta3 scope``: oscilloscope in the drives of a running robot."""

import sys
from dataclasses import dataclass

from delta3_pacdrive.cli.command import Command, JsonOptions, NodeOptions, argument, option
from delta3_pacdrive.cli.option_types import number_within
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.cli.scope_options import Records, ScopeOptions, record_file

ACTIONS = {'list': 'list the channels with their units'}
LIST = 'list'


@dataclass
class Options(NodeOptions, JsonOptions, ScopeOptions):
    """Options of the command."""

    channels: list[str] = argument(
        'up to eight channels such as axis1.current_reference axis2.phase_current_1, or "list"',
        nargs='+',
        metavar='CHANNEL',
    )
    output: str = option(
        'file of the record: .parquet, .csv or .npz', 'FILE', default='scope.csv', type=record_file
    )
    timeout: float = option(
        'timeout for the robot and for a trigger [s]',
        'S',
        default=60.0,
        type=number_within(0.1, 1e6, 's'),
    )

    def names(self) -> list[str]:
        """Return the channels; arguments may also be comma-separated lists."""
        return [part for text in self.channels for part in text.split(',') if part]

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if LIST in self.channels and len(self.channels) > 1:
            return 'list cannot be combined with channels'
        return super().check()


def run(options: Options) -> Output:
    """Run the command; return its result."""
    return _list() if options.channels == [LIST] else _record(options)


def _list() -> Output:
    from delta3_pacdrive.robot.drive.channels import CHANNELS

    rows = [{'channel': row.name, 'unit': row.unit, 'what': row.what} for row in CHANNELS.values()]
    return Output(rows, [f'{row["channel"]:<27} {row["unit"]:<11} {row["what"]}' for row in rows])


def _record(options: Options) -> Output:
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.studies.framework.provenance import Provenance

    setting = options.setting(options.names(), core.load())
    origin = Provenance.of(options.command_line)
    records = Records(options, options.output, origin)
    from delta3_pacdrive.ros.clients.robot_client import operating
    from delta3_pacdrive.ros.clients.scope_client import ScopeClient

    with operating(options.namespace) as operator:
        client = ScopeClient(operator, setting, records.take)
        acquisition = client.record(options.timeout, lambda text: print(text, file=sys.stderr, flush=True))
    result = {'ok': True, 'scope': records.written, 'lost_samples': acquisition.lost}
    return Output(result | {'provenance': origin.lines()}, records.sentences())


main = Command(
    'scope',
    'Record channels of the drives of a running robot at up to 16 kHz around a trigger. Needs no control of the robot; '
    'a drive serves one oscilloscope at a time.',
    Options,
    run,
    ACTIONS,
    mixed=True,
)
