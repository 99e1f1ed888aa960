"""Strict reader of line files; up to ten errors are reported at once, with file, line and column.

name: two robots at a belt      # optional
seed: 1                         # optional, of the parts
hours: 8                        # optional, of the shift
rule: optimal                   # optional: first come, nearest, balanced, optimal
horizon_s: 12                   # optional, of the optimal rule
parameters: model               # optional, as for delta3 simulate
limits: {speed_m_s: 4, acceleration_m_s2: 40, jerk_m_s3: 4000}      # optional, of the TCP
above_mm: 20                    # optional, height above a part at which the robot gets on and off the belt
grip_s: 0.04                    # optional
release_s: 0.02                 # optional
decision_s: 0.029               # optional, time of the robot's script for the decisions of a cycle
parts:
  bar: {mass_kg: 0.2, height_mm: 20, share: 0.7}        # share: optional, 1
belts:
  infeed: {speed_m_s: 0.5, rate_per_min: 150, noise: 0.3, spread_mm: 40}        # noise, spread: optional, 0
robots:                         # along their belts; middle_mm: middle of the belt in the frame of the robot
  robot1: {belt: infeed, at_mm: 800, middle_mm: [0, 100, -870], window_mm: [-250, 300], place_mm: [0, -200, -850]}
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

from delta3_pacdrive import parameters as core
from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.configuration.schema import RecordReader
from delta3_pacdrive.configuration.strict_reader import Errors, read_document
from delta3_pacdrive.errors import LineError
from delta3_pacdrive.studies.fleet.line.design import Line


def find(path: str | Path) -> Path:
    """Return ``path`` itself, or the packaged line for the name ``line`` without a file of this name."""
    path = Path(path)
    return path if path != Path('line') or path.is_file() else core.config_directory() / 'line.yaml'


def load(path: str | Path) -> Line:
    """Read the file of a line; raises LineError, or ParameterError for its parameters."""
    path = Path(path)
    return parse(yaml_file.read(path, 'line', LineError), path)


def parse(document: Any, path: Path) -> Line:
    """Read a document from the file ``path``; raises as ``load``."""

    def read(value: Any, errors: Errors) -> Line:
        belts = value.get('belts') if isinstance(value, dict) else None
        names = {name: name for name in belts} if isinstance(belts, dict) else {}
        return RecordReader(errors, {'belts': names}).record(Line, value, 'the line', prefix='')

    found = read_document(document, str(path), LineError, read)
    robots = tuple(sorted(found.robots, key=lambda robot: (robot.belt, robot.at_m)))
    return replace(found, name=found.name or path.stem, robots=robots)
