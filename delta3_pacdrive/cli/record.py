"""``delta3 record``: record a running robot until interrupted."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.cli.command import Command, NodeOptions, argument, option


@dataclass
class Options(NodeOptions):
    """Options of the command."""

    bag: str = argument('folder to make')
    parameters: str | None = option(
        'parameter file of the robot, for the metadata, instead of what it tells', 'FILE'
    )


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.bringup.scheduling import Schedule, prefer
    from delta3_pacdrive.errors import RunError
    from delta3_pacdrive.ros.nodes.recorder import record

    folder = Path(options.bag).absolute()
    if folder.exists():
        raise RunError(f'cannot record into {folder}: it exists already')
    robot = None if options.parameters is None else core.load(core.of_run(options.parameters))
    prefer(Schedule.PREFERRED)  # what comes while others have the processor would be lost
    return record(folder, robot, '/' + options.namespace.strip('/'))


main = Command(
    'record', 'Record every topic of a running robot into a new rosbag2 folder, until Ctrl-C.', Options, run
)
