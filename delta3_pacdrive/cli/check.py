"""``delta3 check``: validate files, plan programs, and report all errors."""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.cli.command import PARAMETERS, Command, JsonOptions, argument, flag, option
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.configuration.packaged import program_names
from delta3_pacdrive.errors import Delta3Error, ParameterError, ProgramError

HEADER = ('/**', 'ros__parameters')  # the two header lines of a parameter file


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    file: list[str] = argument(
        f'program, parameter file, cell file or list of faults; packaged programs: {", ".join(program_names())}',
        nargs='+',
    )
    parameters: str | None = option(PARAMETERS, 'FILE')
    cell: str | None = option(
        'cell file, or cell for the packaged one: programs may use the names of its outputs',
        'FILE',
    )
    derive: str | None = option(
        'write a new parameter file with the inertias derived from the arms (feed-forward, observer, load of a single '
        'motor)',
        'NEW',
    )
    overwrite: bool = flag('let --derive replace an existing file', needs='--derive')

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if self.derive is not None and len(self.file) > 1:
            return f'--derive takes one parameter file, not {len(self.file)} files'
        return ''


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.cell import cell_file
    from delta3_pacdrive.planning.program.output_names import OWN

    robot = core.load(options.parameters)
    outputs = OWN if options.cell is None else cell_file.load(options.cell).output_names
    results = [_result(name, robot, outputs) for name in options.file]
    programs = [result for result in results if result.get('kind') == 'program']
    if options.parameters is not None and programs:
        programs[0]['warnings'] = _inertias(robot, options.parameters)[1]
    if options.derive is not None and results[0]['ok']:
        results[0] |= _derived(options.file[0], results[0]['kind'], Path(options.derive), options.overwrite)
    ok = all(result['ok'] for result in results)
    lines = [line for result in results for line in _text(result)]
    errors = [f'error: {error}' for result in results for error in result.get('errors', ())]
    return Output({'ok': ok, 'files': results}, lines, int(not ok), errors)


def _result(name: str, robot: Any, outputs: Any) -> dict[str, Any]:
    result: dict[str, Any] = {'ok': True, 'file': name}
    try:
        return result | _content(name, robot, outputs)
    except Delta3Error as error:
        return result | {'ok': False, 'errors': list(error.complaints)}


def _content(name: str, robot: Any, outputs: Any) -> dict[str, Any]:
    """Return the content of a file; its keys determine its kind."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.cell import cell_file
    from delta3_pacdrive.configuration import yaml_file
    from delta3_pacdrive.planning.program import file_reader as programs

    path = programs.find(name)
    if path == Path(name) and not path.exists():
        path, *more = core.parts(name)
        if more:
            return _parameters(core.load(name), name)
    document = yaml_file.read(path, 'file', ProgramError)
    keys = list(document) if isinstance(document, dict) else []
    if 'moves' not in keys and (isinstance(document, list) or keys in (['faults'],) or 'fault' in keys):
        return {'kind': 'faults', 'faults': _faults(document)}
    if any(isinstance(document[key], dict) and 'ros__parameters' in document[key] for key in keys):
        return _parameters(core.load(path), name)
    groups = [str(key) for key in keys if str(key).partition('.')[0] in (*core.groups(), *HEADER)]
    if groups:
        raise ParameterError(
            f'{path} holds {", ".join(groups)} without the header of a ROS parameter file: begin it with the lines '
            '"/**:" and "  ros__parameters:", and indent all groups below them'
        )
    if 'moves' not in keys and any(key in cell_file.SECTIONS for key in keys):
        return _cell(cell_file.parse(document, str(path)))
    return _planned(programs.parse(document, robot.motion, path.stem, str(path), outputs), robot)


def _parameters(robot: Any, name: str) -> dict[str, Any]:
    """Return the checksum of a parameter file, warnings on inertias that do not match its arms, and telegram times."""
    from delta3_pacdrive.parameters import SERCOS_2

    derived, warnings = _inertias(robot, name)
    result = {'kind': 'parameters', 'checksum': robot.checksum, 'derived': derived, 'warnings': warnings}
    if robot.bus.timing == SERCOS_2:
        result['telegrams'] = asdict(robot.bus_timing) | {'text': robot.bus_timing.text}
    return result


def _inertias(robot: Any, name: str) -> tuple[dict[str, float], list[str]]:
    """Return the inertias derived from the arms, and warnings on those that do not match."""
    from delta3_pacdrive.studies.estimation.derived_inertias import CLOSE, derived_inertias

    try:
        derived = derived_inertias(robot)
    except ParameterError as error:
        return {}, [str(error)]
    other = [one.text for one in derived if not one.fits]
    if other:
        other.append(
            f'delta3 check {name} --derive NEW.yaml writes the derived values; '
            f'deviations up to {100.0 * CLOSE:g} % are accepted'
        )
    return {one.name: one.derived for one in derived}, other


def _derived(name: str, kind: str, path: Path, overwrite: bool) -> dict[str, Any]:
    """Write a parameter file with the inertias derived from the arms; raises ParameterError."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.studies.estimation.derived_inertias import derived_inertias, write

    if kind != 'parameters':
        raise ParameterError(f'--derive requires a parameter file, but {name} is a {kind} file')
    if refusal := whole_file.file_refusal(path):
        raise ParameterError(f'cannot write {path}: {refusal}')
    if path.exists() and not overwrite:
        raise ParameterError(f'{path} exists already: --overwrite replaces it')
    return {'written': str(path), 'comments_kept': write(name, derived_inertias(core.load(name)), path)}


def _cell(cell: Any) -> dict[str, Any]:
    return {
        'kind': 'cell',
        'cell': cell.name,
        'inputs': list(cell.input_names),
        'outputs': {name: one.output for name, one in cell.outputs.items()},
        'belts': list(cell.belts),
        'parts': list(cell.parts),
    }


def _faults(document: Any) -> list[str]:
    from delta3_pacdrive.configuration.source_positions import numbered
    from delta3_pacdrive.configuration.strict_reader import Errors
    from delta3_pacdrive.robot.faults.fault import read_fault

    source = document.source
    if isinstance(document, dict):
        document = document.get('faults', [document])
    errors = Errors(source)
    found = []
    with errors.raised_as(ProgramError):
        if not isinstance(document, list):
            raise ProgramError(f'{source}: faults must be a list')
        for item, where, place in numbered(document, 'faults'):
            with errors.noted(place):
                found.append(read_fault(item, where, errors))
    return [_fault_text(fault) for fault in found]


def _fault_text(fault: Any) -> str:
    end = f' for {fault.for_s:g} s' if math.isfinite(fault.for_s) else ''
    return f'{fault.text} after {fault.after_s:g} s{end}'


def _planned(program: Any, robot: Any) -> dict[str, Any]:
    from delta3_pacdrive.planning import program_planner
    from delta3_pacdrive.studies.framework.columns import to_dict
    from delta3_pacdrive.studies.places.planning.evaluation import statement_rows

    start = robot.motion.home_m if program.start_m is None else program.start_m
    planned = program_planner.plan(program, start, robot)
    # all rounds are equal except for the approach of the first one: list the moves once
    numbers = planned.plan.tables.order[: planned.first_round].tolist()
    moves = []
    for number in numbers:
        move, rows = planned.plan.moves[number], statement_rows(planned, number, robot)
        moves.append({'kind': move.kind.name.lower(), 'length_m': move.length_m, 'time_s': move.duration_s})
        if rows:
            moves[-1]['by_statement'] = to_dict(rows)
    return {
        'kind': 'program',
        'program': planned.name,
        'moves': moves,
        'repeat': planned.repeat,
        'time_s': planned.plan.duration_s,
        'override_max': planned.override_max,
        'rms_current_a': list(planned.rms_current_a),
        'rms_current_used': max(planned.rms_current_a) / robot.motor.nominal_current_a,
        'notices': list(planned.notices),
        'faults': [_fault_text(fault) for fault in program.faults],
    }


def _text(result: dict[str, Any]) -> Iterator[str]:
    """Yield the result of a file as lines of text."""
    from delta3_pacdrive.control.motion_state import percent_allowed
    from delta3_pacdrive.planning.paths.move import MoveKind
    from delta3_pacdrive.planning.plan_times import WITHOUT_LENGTH
    from delta3_pacdrive.studies.places.planning.report import limit_text_of, part_text

    if not result['ok']:
        return
    yield f'{result["file"]}: good, {result["kind"]}'
    for number, move in enumerate(result.get('moves', ())):
        has_length = MoveKind[move['kind'].upper()] not in WITHOUT_LENGTH
        length = f'{move["length_m"] * 1e3:9.3f} mm' if has_length else ''
        yield f'{number + 1:>6}  {move["kind"]:<8} {length:>12}  {move["time_s"]:8.3f} s'
        statements = move.get('by_statement', ())
        width = max((len(one['statement']) for one in statements), default=0)
        for one in statements:
            limit = part_text(one['length_m'], limit_text_of(one['limited_by']))
            yield (
                f'{"":>8}{one["statement"]:<{width}} {one["length_m"] * 1e3:9.3f} mm  {one["time_s"]:8.3f} s  '
                f'{one["speed_min_m_s"]:.3f} to {one["speed_max_m_s"]:.3f} m/s  {limit}'
            )
    if 'time_s' in result:
        rounds = f' in {result["repeat"]} rounds' if result['repeat'] > 1 else ''
        yield (
            f' whole  {result["time_s"]:.3f} s{rounds}, override up to {percent_allowed(result["override_max"])} %'
        )
    for name, key in (('note', 'notices'), ('warning', 'warnings'), ('fault', 'faults')):
        for text in result.get(key, ()):
            yield f'{name:>6}  {text}'
    for key in ('inputs', 'outputs', 'belts', 'parts') if result['kind'] == 'cell' else ():
        yield f'{key:>9}  {", ".join(result[key]) or "none"}'
    if 'checksum' in result:
        yield f'        checksum {result["checksum"]}'
    if 'telegrams' in result:
        yield f'       telegrams {result["telegrams"]["text"]}'
    if 'written' in result:
        how = '' if result['comments_kept'] else ', complete and without comments'
        yield f'         written {result["written"]}{how}'


main = Command(
    'check',
    'Validate files and plan programs; list the moves, notices and up to ten errors of each.',
    Options,
    run,
)
