"""Strict reader of cell files; reports up to ten errors, each with file, line and column.

name: one cup                   # optional
seed: 1                         # optional: of all random effects
drop_max_mm: 5                  # optional: a part released higher above its support falls
outputs:                        # optional: names of robot outputs, delays of the connected devices
  clamp: {output: output2, delays: {on_s: 0.05, off_s: 0.03}}
cup:                            # optional
  output: gripper               # or a name in outputs, whose delays are then those of the valve
  diameter_mm: 40
  vacuum_pa: 60000
  open_share: 0.1               # optional: share of the vacuum without a part
  build_up_s: 0.008             # optional: time constants
  decay_s: 0.005
  height_tolerance_mm: 1.5      # optional: vertical distance from cup to top of a part
  lateral_tolerance_mm: 5       # optional
  offset_mm: [0, 0, 0]          # optional: from the TCP to the cup
  valve: {on_s: 0.005, off_s: 0.005}
  switch: {input: vacuum, on_pa: 40000, off_pa: 30000, delays: {on_s: 0.001, off_s: 0.001, bounce_s: 0}}
parts:
  carton: {mass_kg: 0.2, size_mm: [80, 60, 20], friction: 0.5}
supplies:
  infeed: {part: carton, at_mm: [-150, 0, -870], angle_deg: 0, count: 10, refill_s: 0.1}
boxes:
  outfeed: {at_mm: [150, 0, -870], columns: 1, rows: 1, pitch_mm: [0, 0], clears_s: 0.1}
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

import math
from collections.abc import Callable, Mapping
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

from delta3_pacdrive.cell.belt_file import read_belt
from delta3_pacdrive.cell.cell import (
    FALLEN_FAR_M,
    KINDS,
    Box,
    Cell,
    CellFault,
    CellOutput,
    Change,
    Cup,
    Delays,
    Input,
    PartType,
    Sensor,
    Supply,
    VacuumSwitch,
)
from delta3_pacdrive.cell.cell_values import (
    NAMES_MAX,
    PARTS_MAX,
    PLACES_MAX,
    REACH_M,
    TIME_MAX_S,
    VACUUM_MAX_PA,
    delay_s,
    distance_m,
    length_m,
    listed,
    no_parts,
    pitch_m,
    place_m,
    size_m,
    time_s,
)
from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.configuration.source_positions import place_in, place_of, place_of_key
from delta3_pacdrive.configuration.strict_reader import Errors, Section, nearest_of, refuse
from delta3_pacdrive.configuration.value_readers import (
    flag,
    line_of_text,
    number_between,
    one_of,
    whole_number_between,
)
from delta3_pacdrive.errors import CellError, shown
from delta3_pacdrive.parameters import config_directory
from delta3_pacdrive.planning.paths.move import OUTPUTS
from delta3_pacdrive.recording.signals import CELL_BELTS, CELL_INPUTS
from delta3_pacdrive.robot.sercos.words import PAYLOAD_MAX_KG

_NAME = line_of_text(60)
_Value = TypeVar('_Value')


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
    errors = Errors(getattr(document, 'source', file))
    cells: list[Cell] = []
    with errors.raised_as(CellError), errors.noted(place_of(document)):
        cells.append(_cell(document, errors))
    return cells[0]


_SECTIONS = ('parts', 'supplies', 'boxes', 'belts', 'inputs', 'outputs')
SECTIONS = ('cup', *_SECTIONS)  # identify a cell file


def _cell(document: Any, errors: Errors) -> Cell:
    fields = Section(document, 'cell', errors, ('name', 'seed', 'drop_max_m', 'cup', 'faults', *_SECTIONS))
    names = {key: _names_of(document, key) for key in _SECTIONS}

    def named(key: str, read: Callable[..., _Value]) -> dict[str, _Value]:
        return fields.read(key, partial(_named, read, errors), {}, prefix='')

    outputs = named('outputs', _output)
    _require_single(outputs, document, errors)
    cup = fields.read('cup', partial(_cup, outputs, errors), prefix='')
    inputs = named('inputs', partial(_input, outputs))
    if cup is not None and cup.switch is not None and cup.switch.input in inputs:
        with errors.noted(place_in(document, 'cup')):
            refuse(f'cup.switch.input is {shown(cup.switch.input)}, which is already in inputs')
    every_input = (*inputs, *([cup.switch.input] if cup is not None and cup.switch is not None else ()))
    if len(every_input) > CELL_INPUTS:
        with errors.noted(place_in(document, 'inputs')):
            refuse(f'the cell has {len(every_input)} inputs, but must have at most {CELL_INPUTS}')
    belts = named('belts', partial(read_belt, names['parts']))
    if len(belts) > CELL_BELTS:
        with errors.noted(place_in(document, 'belts')):
            refuse(f'the cell has {len(belts)} belts, but must have at most {CELL_BELTS}')
    return Cell(
        name=fields.read('name', _NAME, 'cell', prefix=''),
        seed=fields.read('seed', whole_number_between(0, 2**32 - 1), 1, prefix=''),
        drop_max_m=fields.read('drop_max_m', distance_m, FALLEN_FAR_M, prefix=''),
        cup=cup,
        inputs=inputs,
        outputs=outputs,
        parts=named('parts', _part),
        supplies=named('supplies', partial(_supply, names['parts'])),
        boxes=named('boxes', _box),
        belts=belts,
        faults=fields.read(
            'faults', partial(_faults, errors, {'inputs': every_input, 'belts': tuple(belts)}), (), prefix=''
        ),
    )


def _names_of(document: Any, key: str) -> tuple[str, ...]:
    found = document.get(key)
    return tuple(name for name in found if isinstance(name, str)) if isinstance(found, dict) else ()


def _named(read: Callable[..., _Value], errors: Errors, value: Any, where: str) -> dict[str, _Value]:
    """Read a mapping of names, each value with ``read``."""
    if not isinstance(value, dict):
        refuse(f'{where} must be a mapping of names, not {shown(value)}')
    if len(value) > NAMES_MAX:
        refuse(f'{where} holds {len(value)} names, but must hold at most {NAMES_MAX}')
    found = {}
    for name, one in value.items():
        with errors.noted(place_of_key(value, name)):
            if not _NAME(name, f'a name in {where}'):
                refuse(f'a name in {where} is empty')
        with errors.noted(place_in(value, name)):
            found[str(name)] = read(errors, str(name), one, f'{where}.{name}')
    return found


def _delays(errors: Errors, value: Any, where: str) -> Delays:
    fields = Section(value, where, errors, ('on_s', 'off_s', 'bounce_s'))
    return Delays(*(fields.read(key, delay_s, 0.0) for key in ('on_s', 'off_s', 'bounce_s')))


def _output(errors: Errors, name: str, value: Any, where: str) -> CellOutput:
    if name in OUTPUTS:
        refuse(f'{where}: {shown(name)} is the name of an output of the robot: use another name')
    fields = Section(value, where, errors, ('output', 'delays'), ('output',))
    return CellOutput(
        fields.read('output', one_of(OUTPUTS), ''), fields.read('delays', partial(_delays, errors), Delays())
    )


def _require_single(outputs: Mapping[str, CellOutput], document: Any, errors: Errors) -> None:
    """Reject two names for one output of the robot."""
    names: dict[str, str] = {}
    for name, one in outputs.items():
        if one.output in names:
            with errors.noted(place_in(document['outputs'], name)):
                refuse(
                    f'outputs.{name}.output is {one.output}, which already has the name {names[one.output]}'
                )
        names.setdefault(one.output, name)


def _named_output(outputs: Mapping[str, CellOutput], value: Any, where: str) -> str:
    """Read an output by its name in the cell or on the robot; return the robot's name."""
    name = one_of((*OUTPUTS, *outputs))(value, where)
    return outputs[name].output if name in outputs else name


def _cup(outputs: Mapping[str, CellOutput], errors: Errors, value: Any, where: str) -> Cup:
    keys = ('diameter_m', 'vacuum_pa', 'output')
    optional = ('open_share', 'build_up_s', 'decay_s', 'height_tolerance_m', 'lateral_tolerance_m')
    fields = Section(value, where, errors, (*keys, *optional, 'offset_m', 'valve', 'switch'), keys)
    own = Cup('', 0.0, 0.0)
    vacuum = fields.read('vacuum_pa', number_between(100.0, VACUUM_MAX_PA), VACUUM_MAX_PA)
    output = fields.read('output', partial(_named_output, outputs), '')
    delays = next((one.delays for one in outputs.values() if one.output == output), Delays())
    if 'valve' in fields and delays != Delays():
        with errors.noted(place_in(value, 'valve')):
            refuse(f'{where}.valve: output {output} already has delays in outputs: give only one of them')
    return Cup(
        output=output,
        diameter_m=fields.read('diameter_m', number_between(1e-3, 1.0), 1e-3),
        vacuum_pa=vacuum,
        valve=fields.read('valve', partial(_delays, errors), delays),
        open_share=fields.read('open_share', number_between(0.0, 1.0), own.open_share),
        build_up_s=fields.read('build_up_s', delay_s, own.build_up_s),
        decay_s=fields.read('decay_s', delay_s, own.decay_s),
        height_tolerance_m=fields.read('height_tolerance_m', distance_m, own.height_tolerance_m),
        lateral_tolerance_m=fields.read('lateral_tolerance_m', distance_m, own.lateral_tolerance_m),
        offset_m=fields.read('offset_m', place_m, own.offset_m),
        switch=fields.read('switch', partial(_switch, errors, vacuum)),
    )


def _switch(errors: Errors, vacuum_pa: float, value: Any, where: str) -> VacuumSwitch:
    keys = ('input', 'on_pa', 'off_pa')
    fields = Section(value, where, errors, (*keys, 'delays'), keys)
    on = fields.read('on_pa', number_between(0.0, vacuum_pa), vacuum_pa)
    return VacuumSwitch(
        fields.read('input', _NAME, ''),
        on,
        fields.read('off_pa', number_between(0.0, on), 0.0),
        fields.read('delays', partial(_delays, errors), Delays()),
    )


def _part(errors: Errors, name: str, value: Any, where: str) -> PartType:
    keys = ('mass_kg', 'size_m', 'friction')
    fields = Section(value, where, errors, keys, keys)
    return PartType(
        name,
        fields.read('mass_kg', number_between(1e-3, PAYLOAD_MAX_KG), 1.0),
        fields.read('size_m', size_m),
        fields.read('friction', number_between(0.01, 10.0), 1.0),
    )


def _supply(parts: tuple[str, ...], errors: Errors, name: str, value: Any, where: str) -> Supply:
    keys = ('part', 'at_m')
    fields = Section(value, where, errors, (*keys, 'angle_rad', 'count', 'refill_s'), keys)
    return Supply(
        name=name,
        part=fields.read('part', one_of(parts) if parts else no_parts, ''),
        at_m=fields.read('at_m', place_m),
        angle_rad=fields.read('angle_rad', number_between(-math.tau, math.tau), 0.0),
        count=fields.read('count', whole_number_between(1, PARTS_MAX), 1),
        refill_s=fields.read('refill_s', time_s, 0.0),
    )


def _box(errors: Errors, name: str, value: Any, where: str) -> Box:
    fields = Section(value, where, errors, ('at_m', 'columns', 'rows', 'pitch_m', 'clears_s'), ('at_m',))
    count = whole_number_between(1, PLACES_MAX)
    columns, rows = fields.read('columns', count, 1), fields.read('rows', count, 1)
    pitch = fields.read('pitch_m', pitch_m, (0.0, 0.0))
    for key, many, one in (('columns', columns, pitch[0]), ('rows', rows, pitch[1])):
        if many > 1 and one == 0.0:
            with errors.noted(place_in(value, key)):
                refuse(f'{where}.{key} is {many}, but pitch_m of that direction is 0')
    return Box(
        name=name,
        at_m=fields.read('at_m', place_m),
        columns=columns,
        rows=rows,
        pitch_m=pitch,
        clears_s=fields.read('clears_s', time_s, math.inf),
    )


def _input(outputs: Mapping[str, CellOutput], errors: Errors, name: str, value: Any, where: str) -> Input:
    sources = ('changes', 'sensor', 'follows')
    fields = Section(value, where, errors, ('delays', *sources))
    given = [key for key in sources if key in fields]
    if len(given) > 1:
        refuse(f'{where} holds {" and ".join(given)}: give one of them')
    return Input(
        name,
        fields.read('delays', partial(_delays, errors), Delays()),
        fields.read('changes', partial(_changes, errors), ()),
        fields.read('sensor', partial(_sensor, errors)),
        fields.read('follows', partial(_named_output, outputs), ''),
    )


def _sensor(errors: Errors, value: Any, where: str) -> Sensor:
    keys = ('at_m', 'radius_m')
    fields = Section(value, where, errors, keys, keys)
    return Sensor(fields.read('at_m', place_m), fields.read('radius_m', length_m, 1.0))


def _changes(errors: Errors, value: Any, where: str) -> tuple[Change, ...]:
    found: list[Change] = []
    for one, own, place in listed(value, where):
        with errors.noted(place):
            fields = Section(one, own, errors, ('after_s', 'value'), ('after_s', 'value'))
            after = fields.read('after_s', time_s, found[-1].after_s if found else 0.0)
            if found and after < found[-1].after_s:
                refuse(f'{own}.after_s is {after:g}, but the change before it is at {found[-1].after_s:g}')
            found.append(Change(after, fields.read('value', flag, False)))
    return tuple(found)


def _faults(
    errors: Errors, names: Mapping[str, tuple[str, ...]], value: Any, where: str
) -> tuple[CellFault, ...]:
    found = []
    for one, own, place in listed(value, where):
        with errors.noted(place):
            found.append(_fault(errors, names, one, own))
    return tuple(found)


def _fault(errors: Errors, names: Mapping[str, tuple[str, ...]], value: Any, where: str) -> CellFault:
    if not isinstance(value, dict):
        refuse(f'{where} must be a mapping, not {shown(value)}')
    kind = value.get('fault')
    if not isinstance(kind, str) or kind not in KINDS:
        refuse(
            f'{where}.fault is {shown(kind)}, but must be one of {", ".join(KINDS)}{nearest_of(kind, KINDS)}',
            place_in(value, 'fault') if 'fault' in value else None,
        )
    section, key = KINDS[kind]
    target = section.removesuffix('s')
    required = [name for name in ('fault', target, key) if name]
    fields = Section(value, where, errors, (*required, 'after_s', 'for_s'), required)
    read = flag if key == 'value' else number_between(-REACH_M, REACH_M)
    return CellFault(
        kind,
        fields.read(target, one_of(names[section]), '') if target else '',
        float(fields.read(key, read, 0.0)) if key else 0.0,
        fields.read('after_s', time_s, 0.0),
        fields.read('for_s', number_between(1e-3, TIME_MAX_S), math.inf),
    )
