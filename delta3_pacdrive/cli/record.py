"""``delta3 record``: record one running robot, or all of them, until interrupted."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.cli.command import Command, NodeOptions, argument, flag, option

WITHOUT_NAMESPACE = 'no-namespace'  # no namespace has a hyphen


@dataclass
class Options(NodeOptions):
    """Options of the command."""

    bag: str = argument('folder to make')
    all: bool = flag(
        'record all robots that are up, or all below --namespace, each into a folder of its own in BAG'
    )
    parameters: str | None = option(
        'parameter file of the robot, for the metadata, instead of what it tells', 'FILE'
    )

    def check(self) -> str:
        """Return why options do not fit one another; empty if they do."""
        if self.all and self.parameters is not None:
            return f'--parameters is {self.parameters}, but with --all each robot tells its own'
        return super().check()


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.bringup.scheduling import Schedule, prefer
    from delta3_pacdrive.errors import RunError
    from delta3_pacdrive.ros import domain
    from delta3_pacdrive.ros.nodes.recorder import record

    folder = Path(options.bag).absolute()
    if folder.exists():
        raise RunError(f'cannot record into {folder}: it exists already')
    robot = None if options.parameters is None else core.load(core.of_run(options.parameters))
    namespace = domain.namespace(options.namespace)
    bags = _bags_of_all(folder, namespace) if options.all else {namespace: folder}
    prefer(Schedule.PREFERRED)  # what comes while others have the processor would be lost
    return record(bags, robot)


def _bags_of_all(folder: Path, prefix: str) -> dict[str, Path]:
    """Make a folder with room for a bag of each robot that is up; return where by namespace. Raises RunError."""
    from delta3_pacdrive.errors import RunError
    from delta3_pacdrive.ros.robots_client import find_all

    robots = find_all(prefix)
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise RunError(f'cannot record into {folder}: {error.strerror}') from None
    return {namespace: folder / _relative(namespace, prefix) for namespace in robots}


def _relative(namespace: str, prefix: str) -> str:
    """Return the name of a robot's folder: its namespace from the prefix on, with dots, which none has, for slashes."""
    below = namespace.removeprefix(prefix.rstrip('/')).strip('/') or namespace.strip('/')
    return below.replace('/', '.') or WITHOUT_NAMESPACE


main = Command(
    'record',
    'Record every topic of a running robot, or of all, into a new rosbag2 folder, until Ctrl-C.',
    Options,
    run,
)
