"""``delta3 export``: the robot as a model for other tools."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.cli.command import Command, argument, option
from delta3_pacdrive.cli.command import Options as CommonOptions

FORMATS = {
    'urdf': 'a tree with passive joints, for robot_state_publisher, RViz, Foxglove ...',
    'mjcf': 'a closed chain that moves like the plant, for MuJoCo',
}


@dataclass
class Options(CommonOptions):
    """Options of the command."""

    format: str = argument('urdf or mjcf', choices=tuple(FORMATS), metavar='FORMAT')
    output: str | None = option('write it there instead of to the terminal', 'FILE')
    parameters: str | None = option(
        'parameter file instead of the packaged one, or rich: the built robot', 'FILE'
    )


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive import parameters
    from delta3_pacdrive.analysis.provenance import write_text
    from delta3_pacdrive.scene.mjcf import mjcf
    from delta3_pacdrive.scene.urdf import urdf

    robot = parameters.load(options.parameters)
    text = {'urdf': urdf, 'mjcf': mjcf}[options.format](robot)
    if options.output is None:
        print(text, end='')
    else:
        write_text(text, Path(options.output))
    return 0


main = Command(
    'export',
    'The robot as a model for other tools, from its parameters: lengths, masses, limits, shapes.',
    Options,
    run,
    FORMATS,
)
