"""``delta3 scope``: the oscilloscope of the drives."""

import json
from dataclasses import dataclass

from delta3_pacdrive.cli.command import Command, JsonOptions, argument

ACTIONS = {'list': 'the channels of a drive, each with its unit'}


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    action: str = argument('list', choices=tuple(ACTIONS), metavar='ACTION')


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive.drive.channels import CHANNELS

    rows = [{'channel': row.name, 'unit': row.unit, 'what': row.what} for row in CHANNELS.values()]
    if options.json:
        print(json.dumps(rows))
        return 0
    for row in rows:
        print(f'{row["channel"]:<27} {row["unit"]:<11} {row["what"]}')
    return 0


main = Command('scope', 'The oscilloscope of the drives.', Options, run, ACTIONS)
