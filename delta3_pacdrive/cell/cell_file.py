"""Strict reader of cell files; reports up to ten errors, each with file, line and column.

name: one cup                   # optional
seed: 1                         # optional: seed of all random effects
drop_max_mm: 5                  # optional: a part released higher above its support falls
outputs:                        # optional: names of robot outputs, delays of the connected devices
  clamp: {output: output2, delays: {on_s: 0.05, off_s: 0.03}}
cup:                            # optional
  output: gripper               # or a name in outputs, whose delays are then those of the valve
  diameter_mm: 40
  vacuum_pa: 60000
  open_share: 0.1               # optional: fraction of vacuum_pa that the cup reaches without a part
  build_up_s: 0.008             # optional: time constants
  decay_s: 0.005
  height_tolerance_mm: 1.5      # optional: largest vertical distance from cup to top of a part
  lateral_tolerance_mm: 5       # optional: largest horizontal distance
  offset_mm: [0, 0, 0]          # optional: from the TCP to the cup
  valve: {on_s: 0.005, off_s: 0.005}
  switch: {input: vacuum, on_pa: 40000, off_pa: 30000, delays: {on_s: 0.001, off_s: 0.001, bounce_s: 0}}
parts:
  carton: {mass_kg: 0.2, size_mm: [80, 60, 20], friction: 0.5}
supplies:
  infeed: {part: carton, at_mm: [-150, 0, -870], angle_deg: 0, count: 10, refill_s: 0.1}
boxes:
  outfeed: {at_mm: [150, 0, -870], columns: 1, rows: 1, pitch_mm: [0, 0], clears_s: 0.1}  # until a part is removed
belts:                            # at most 4
  line:
    origin_mm: [-300, 100, -870]  # middle of the surface at the start of the belt
    direction_deg: 0
    length_mm: 800
    encoder: {bits: 14, circumference_mm: 200}
    speed: [{after_s: 0, speed_m_s: 0.5, acceleration_m_s2: 2}]
    jitter: {speed_m_s: 0.005, frequency_hz: 8}               # optional
    slip: 0.001                                               # optional: fraction of the travel
    stream: {part: carton, count: 20, spacing_mm: 150, spread_mm: [5, 10], spread_deg: 20}    # optional
    barrier: {at_mm: 100, delay_s: 0.0005}                    # optional: latches the encoder
    camera: {at_mm: 150, length_mm: 200, every_mm: 150, latency_s: 0.03, noise_mm: 0.1, noise_deg: 0.5,
             missed_share: 0.01, doubled_share: 0.02}         # optional
inputs:
  part_there: {sensor: {at_mm: [-150, 0, -870], radius_mm: 10}, delays: {on_s: 0.002}}
  start: {changes: [{after_s: 0.5, value: true}]}
  clamped: {follows: clamp}
faults:
- {fault: vacuum_failure, after_s: 0.3, for_s: 0.1}
- {fault: input_stuck, input: start, value: false, after_s: 0}
- {fault: encoder_jump, belt: line, jump_mm: 30, after_s: 0.4}
- {fault: camera_dead, belt: line, after_s: 1, for_s: 0.5}

Lengths may be given in mm and angles in deg, according to the key. Times count from program start.
"""

from collections.abc import Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from delta3_pacdrive.cell.cell import KINDS, Cell, CellFault, Delays
from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.configuration.schema import RecordReader
from delta3_pacdrive.configuration.source_positions import place_in
from delta3_pacdrive.configuration.strict_reader import Errors, Section, chosen_kind, read_document, refuse
from delta3_pacdrive.configuration.value_readers import flag, number_between, one_of
from delta3_pacdrive.errors import CellError, shown
from delta3_pacdrive.parameters import config_directory
from delta3_pacdrive.planning.paths.move import OUTPUTS

JUMP_MAX_M = 10.0  # of a belt encoder
SECTIONS = ('cup', 'parts', 'supplies', 'boxes', 'belts', 'inputs', 'outputs')  # identify a cell file


def load(path: str | Path) -> Cell:
    """Read a cell file; the bare name ``cell`` selects the packaged one unless such a file exists.

    Raises
    ------
    CellError
        The file cannot be read or breaks rules; lists up to ten places with the rules.

    """
    path = find(path)
    return parse(yaml_file.read(path, 'cell file', CellError), str(path))


def cell_of(source: Cell | str | PathLike[str] | Mapping[str, Any] | None) -> Cell | None:
    """Return the cell of a file, a parsed document or a ``Cell``; None for None. Raises CellError."""
    if source is None or isinstance(source, Cell):
        return source
    if isinstance(source, str | PathLike):
        return load(Path(source))
    if isinstance(source, Mapping):
        return parse(source)
    raise CellError(
        f'cell is {shown(source)}, but must be a file, the mapping that such a file holds, or a Cell'
    )


def find(path: str | Path) -> Path:
    """Return ``path`` if it exists, else the packaged cell for the name ``cell``."""
    path = Path(path)
    return path if path != Path('cell') or path.exists() else config_directory() / 'cell.yaml'


def parse(document: Any, file: str = '') -> Cell:
    """Build a cell from a parsed document; raises CellError, as ``load`` does."""
    return read_document(document, file, CellError, _cell)


def _cell(document: Any, errors: Errors) -> Cell:
    def fault(value: Any, where: str) -> CellFault:
        return _fault(reader, value, where)

    reader = RecordReader(errors, _names_of(document), {CellFault: fault})
    cell = reader.record(Cell, document, 'cell', prefix='')
    if cell.cup is None:
        return cell
    delays = next((one.delays for one in cell.outputs.values() if one.output == cell.cup.output), Delays())
    if 'valve' not in document['cup']:
        return replace(cell, cup=replace(cell.cup, valve=delays))
    if delays != Delays():
        with errors.noted(place_in(document['cup'], 'valve')):
            refuse(
                f'cup.valve: output {cell.cup.output} already has delays in outputs: give only one of them'
            )
    return cell


def _names_of(document: Any) -> dict[str, dict[str, Any]]:
    """Return the names in each section that other sections use, also those of invalid records."""

    def named(key: str) -> dict[Any, Any]:
        found = document.get(key) if isinstance(document, dict) else None
        return (
            {name: one for name, one in found.items() if isinstance(name, str)}
            if isinstance(found, dict)
            else {}
        )

    names = {key: {name: name for name in named(key)} for key in ('parts', 'inputs', 'belts')}
    switch = named('cup').get('switch')
    if isinstance(switch, dict) and isinstance(switch.get('input'), str):
        names['inputs'][switch['input']] = switch['input']
    outputs = {name: one.get('output') for name, one in named('outputs').items() if isinstance(one, dict)}
    return names | {'outputs': {name: name for name in OUTPUTS} | outputs}


def _fault(reader: RecordReader, value: Any, where: str) -> CellFault:
    """Read a fault, whose kind determines its keys."""
    kind = chosen_kind(value, where, 'fault', KINDS)
    section, key = KINDS[kind]
    target = section.removesuffix('s')
    required = [name for name in ('fault', target, key) if name]
    fields = Section(value, where, reader.errors, (*required, 'after_s', 'for_s'), required)
    read = flag if key == 'value' else number_between(-JUMP_MAX_M, JUMP_MAX_M)
    return CellFault(
        kind,
        fields.read(target, one_of(tuple(reader.names[section])), '') if target else '',
        float(fields.read(key, read, 0.0)) if key else 0.0,
        **reader.values(CellFault, fields),
    )
