"""``delta3 record``: record a running robot until interrupted."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from delta3_pacdrive.cli.output import guarded, parser_for


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = parser_for(
        'record', 'Record every topic of a running robot into a new rosbag2 folder, until Ctrl-C.'
    )
    parser.add_argument('bag', help='folder to make')
    parser.add_argument('--namespace', default='/', help='ROS namespace of the robot')
    parser.add_argument('--parameters', metavar='FILE', help='parameter file of the robot, for the metadata')
    options = parser.parse_args(arguments)
    return guarded(lambda: _record(options))


def _record(options: argparse.Namespace) -> int:
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.errors import RunError
    from delta3_pacdrive.ros.nodes.recorder import record

    folder = Path(options.bag).absolute()
    if folder.exists():
        raise RunError(f'cannot record into {folder}: it exists already')
    return record(folder, core.load(options.parameters), '/' + options.namespace.strip('/'))


if __name__ == '__main__':
    sys.exit(main())
