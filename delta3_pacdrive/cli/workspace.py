"""``delta3 workspace``: map the capability of the robot over the workspace, as slices and as a volume."""

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.command import PARAMETERS, Command, JsonOptions, flag, option
from delta3_pacdrive.cli.option_types import file_ending, finite_number, number_within
from delta3_pacdrive.cli.output import Output, with_provenance
from delta3_pacdrive.cli.studies import written

if TYPE_CHECKING:
    from delta3_pacdrive.studies.places.workspace.study import Results

REACH_M = 10.0
SLICES_MAX = 9


def _plane(text: str) -> tuple[int, float]:
    axis, equals, value = text.partition('=')
    try:
        place = float(value)
    except ValueError:
        place = math.nan
    if axis not in ('x', 'y', 'z') or not equals or not abs(place) <= REACH_M:
        raise argparse.ArgumentTypeError(f'{text!r} is not a plane, expected for example z=-0.8 (m)')
    return 'xyz'.index(axis), place


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    resolution: float = option(
        'grid spacing of the volume [mm]; at most 20 million poses',
        'MM',
        default=7.0,
        type=number_within(0.5, 500.0, 'mm'),
    )
    planes: list[tuple[int, float]] | None = option(
        'plane to draw [m], such as z=-0.8 or y=0.1; repeatable (default: top, bottom and the plane '
        'of arm 1)',
        'AXIS=M',
        names=('--slice',),
        needs='--output',
        type=_plane,
        action='append',
    )
    payload: float | None = option('payload instead of that of the parameters [kg]', 'KG', type=finite_number)
    acceleration: float | None = option(
        'acceleration for the maps of maximum payload and forces [m/s2] (default: that of moves)',
        'M_S2',
        type=number_within(0.0, 1e4, 'm/s2'),
    )
    forces: bool = flag('also map the forces in rods and ball joints')
    parameters: str | None = option(PARAMETERS, 'FILE')
    output: str | None = option('folder for maps and tables', 'FOLDER')
    volume: str | None = option(
        'write the volume to this .npz or .csv file', 'FILE', type=file_ending('.npz', '.csv')
    )

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if len(self.planes or ()) > SLICES_MAX:
            return f'at most {SLICES_MAX} slices are possible'
        return ''


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.cli.progress import Progress, announce_compilation
    from delta3_pacdrive.studies.framework.provenance import Provenance
    from delta3_pacdrive.studies.framework.report_folder import require_writable_folder
    from delta3_pacdrive.studies.places.workspace import evaluation, figures, report
    from delta3_pacdrive.studies.places.workspace.study import Settings, Slice

    robot = core.load(options.parameters)
    if options.payload is not None:
        robot = robot.replace(dynamics__payload_mass_kg=options.payload)
    planes = tuple(Slice(axis, place) for axis, place in options.planes or ())
    slices = () if options.output is None else planes or evaluation.default_slices(robot)
    settings = Settings(1e-3 * options.resolution, slices, options.acceleration, options.forces)
    evaluation.require_few_poses(settings, robot)
    require_writable_folder(options.output)
    if options.volume is not None:
        report.require_writable_volume(Path(options.volume))
    announce_compilation()
    with Progress(quiet=options.json) as progress:
        progress.show('loading')
        evaluation.warm_up(robot)
        evaluation.require_reached(planes, robot)
        found = evaluation.study(settings, robot, progress.show)
        lines = report.text(found, settings, robot)
        origin = Provenance.of(options.command_line, robot, options.parameters)
        drawings, tables = figures.by_name(found, slices, robot), [report.extremes_table(found)]
        files = written(options, 'Workspace', lines, drawings, tables, of=origin)
        if options.volume is not None:
            files.append(str(_volume(Path(options.volume), found, origin)))
    result = report.document(found, settings, robot)
    if files:
        result['files'] = files
    return Output(with_provenance(result, options, robot), [*lines, *files])


def _volume(path: Path, found: 'Results', origin: Any) -> Path:
    from delta3_pacdrive.studies.framework.provenance import write_table
    from delta3_pacdrive.studies.places.workspace import report

    if path.suffix.lower() == '.npz':
        return report.save_volume(found.volume, path, origin.lines())
    columns = report.volume_columns(found.volume)
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    return write_table(path, list(columns), rows, origin)


main = Command(
    'workspace',
    'Evaluate a million poses of the workspace in seconds: condition and singularities, speed and acceleration in '
    'every direction, payload, and accuracy per encoder increment. Reports minimum and maximum values with their '
    'positions, draws maps of slices, and writes the whole volume to a file.',
    Options,
    run,
)
