"""Proposed gains as a parameter file of differences from the file of a robot."""

import math
from pathlib import Path

from delta3_pacdrive.configuration import parameter_file
from delta3_pacdrive.configuration.strict_reader import Errors
from delta3_pacdrive.errors import ParameterError, TuningError
from delta3_pacdrive.parameters.records import Drive
from delta3_pacdrive.robot.drive.operation_data import OF_PARAMETER
from delta3_pacdrive.studies.drives.tuning.candidates import Gains
from delta3_pacdrive.studies.framework.provenance import Provenance, os_errors_as

FILE = 'gains.yaml'


def write(gains: Gains, kept: str, path: Path, provenance: Provenance) -> None:
    """Write proposed gains to a parameter file; ``kept`` states their margins. Raises ReportError."""
    head = [
        f'Gains that keep {kept}.',
        f'Use with --parameters ROBOT+{path.name}; for nodes, with --params-file after the file of the robot.',
        *(f'{name}: {text}' for name, text in provenance.lines().items()),
    ]
    with os_errors_as(f'cannot write {path}'):
        parameter_file.write({'drive': gains.values()}, path, head)


def read(folder: Path) -> dict[str, float]:
    """Read the gains that ``tune --propose`` has written to a folder; raises TuningError."""
    path = folder / FILE
    if not path.is_file():
        raise TuningError(f'no gains to apply: {path} does not exist; tune --propose writes it')
    try:
        tree = parameter_file.read(path)
        given = {str(name): value for name, value in tree['drive'].items()}
    except (ParameterError, KeyError, AttributeError):
        given = {}
    if not given:
        raise TuningError(f'{path} contains no gains of --propose')
    if unknown := [name for name in given if f'drive.{name}' not in OF_PARAMETER]:
        raise TuningError(f'{path} contains {unknown[0]}, which is not a parameter of a drive')
    if infinite := [name for name, value in given.items() if value in (math.inf, -math.inf)]:
        raise TuningError(f'{path}: drive.{infinite[0]} must be finite, not {given[infinite[0]]}')
    errors = Errors(str(path))
    with errors.raised_as(TuningError):
        return {
            name: float(value)
            for name, value in parameter_file.checked_some(given, 'drive', Drive, errors).items()
        }
