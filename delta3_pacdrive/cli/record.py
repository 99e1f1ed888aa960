"""``delta3 record``: record one or all running robots until an interrupt."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.cli.command import Command, NodeOptions, argument, flag, option
from delta3_pacdrive.cli.output import Output

WITHOUT_NAMESPACE = 'no-namespace'  # cannot be a namespace: hyphens are not allowed


@dataclass
class Options(NodeOptions):
    """Options of the command."""

    bag: str = argument('folder to create')
    all: bool = flag('record all running robots, or all below --namespace, each into a subfolder of BAG')
    parameters: str | None = option(
        'parameter file for the metadata, instead of the parameters that the robot publishes', 'FILE'
    )

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if self.all and self.parameters is not None:
            return f'--parameters is {self.parameters}, but with --all each robot publishes its parameters'
        return super().check()


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.bringup.scheduling import Schedule, set_scheduling
    from delta3_pacdrive.errors import RunError
    from delta3_pacdrive.ros.nodes.recorder import record
    from delta3_pacdrive.ros.wire import domain

    folder = Path(options.bag).absolute()
    if folder.exists():
        raise RunError(f'cannot record into {folder}: it exists already')
    robot = None if options.parameters is None else core.load(core.of_run(options.parameters))
    namespace = domain.namespace(options.namespace)
    bags = _bags_of_all(folder, namespace) if options.all else {namespace: folder}
    set_scheduling(Schedule.PREFERRED)  # avoids lost messages on a busy machine
    return Output(status=record(bags, robot))


def _bags_of_all(folder: Path, prefix: str) -> dict[str, Path]:
    """Create the folder; return the bag folder of each running robot by namespace. Raises RunError."""
    from delta3_pacdrive.errors import RunError
    from delta3_pacdrive.ros.clients.robots_client import find_all

    robots = find_all(prefix)
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise RunError(f'cannot record into {folder}: {error.strerror}') from None
    return {namespace: folder / _relative(namespace, prefix) for namespace in robots}


def _relative(namespace: str, prefix: str) -> str:
    """Return the folder name of a robot: its namespace below the prefix, with dots in place of slashes."""
    below = namespace.removeprefix(prefix.rstrip('/')).strip('/') or namespace.strip('/')
    return below.replace('/', '.') or WITHOUT_NAMESPACE


main = Command(
    'record',
    'Record all topics of one or all running robots into a new rosbag2 folder, until Ctrl-C.',
    Options,
    run,
)
