"""Files of sweeps. The strict reader reports up to ten errors at once, with file, line and column.

name: tolerances                # optional
program: experiment1            # packaged, or a file in the same folder
parameters: rich                # optional: as for delta3 simulate
runs: 1000
sampling: latin_hypercube       # optional: random, latin_hypercube, sobol, saltelli (for Sobol indices), grid
seed: 1                         # optional
vary:
  motor.torque_constant_n_m_a: {normal: [0.78, 0.008]}          # mean, standard deviation
  dynamics.payload_mass_kg: {uniform: [0.0, 2.0]}               # lower, upper bound
  drive.velocity_gain_a_s_rad: {list: [0.3, 0.35, 0.4]}
  rich.sensor_seed: run                                         # number of the run
  rich.current_gain_error[0]: {normal: [0.0, 0.01]}             # one of several values
  program.moves[0].move_l.speed_m_s: {uniform: [0.5, 1.0]}      # any value of the program, including its faults
keep:                           # optional: all figures of a run
- tcp_error_max_m               # a figure
- {name: true_rms_m, signal: tcp_true, less: tcp_command, of: rms}      # a signal, or the difference of two
- {name: peak_a, signal: current_max, of: max, axis: 1, from_s: 0.1, to_s: 0.5}
limits: {tcp_error_max_m: 0.0003}       # optional: the share of runs within these limits is reported
function: own.py                # optional: its figures(trace) returns more results by name

A Python file contains the same as a dictionary ``SPEC``, and optionally the function.
"""

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive import parameters as core
from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.configuration.source_positions import place_in, place_of, place_of_key
from delta3_pacdrive.configuration.strict_reader import Errors, Section, nearest_of, refuse
from delta3_pacdrive.configuration.value_readers import line_of_text, number, one_of, whole_number_between
from delta3_pacdrive.errors import ProgramError, SweepError, shown
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.recording.tables import quantities
from delta3_pacdrive.studies.fleet.sweep.program_values import value_at
from delta3_pacdrive.studies.fleet.sweep.single_run import figure_names
from delta3_pacdrive.studies.fleet.sweep.study import (
    FUNCTION,
    PROGRAM,
    Kept,
    Law,
    Reduction,
    Sampling,
    Sweep,
    Variation,
)
from delta3_pacdrive.studies.framework.provenance import versions

RUNS_MAX, VARIED_MAX, KEPT_MAX, LIST_MAX = 10_000_000, 50, 100, 1000
NAME = re.compile(r'[A-Za-z_][A-Za-z0-9_]{0,59}')
KEYS = ('name', 'program', 'parameters', 'runs', 'sampling', 'seed', 'vary', 'keep', 'limits', 'function')
OF_KEPT = ('name', 'signal', 'less', 'of', 'axis', 'from_s', 'to_s')


def load(path: str | Path) -> Sweep:
    """Read the file of a sweep; raises SweepError, ParameterError and ProgramError."""
    path = Path(path)
    document, source = document_of(path, 'sweep')
    errors = Errors(str(path))
    found: list[Sweep] = []
    with errors.raised_as(SweepError), errors.noted(place_of(document)):
        fields = Section(document, 'the sweep', errors, KEYS, ('program', 'runs', 'vary'))
        runs = fields.read('runs', whole_number_between(1, RUNS_MAX), 1, prefix='')
        sampling = Sampling(fields.read('sampling', one_of(tuple(Sampling)), Sampling.RANDOM, prefix=''))
        sweep = sweep_of(fields=fields, path=path, errors=errors, source=source, runs=runs, sampling=sampling)
        found.append(replace(sweep, digest=digest_of(sweep)))
    return found[0]


def document_of(path: Path, what: str) -> tuple[Any, str]:
    """Return the document of a file, and the source of its function if it has one; raises SweepError."""
    if path.suffix != '.py':
        return yaml_file.read(path, what, SweepError), ''
    try:
        whole_file.require_regular(path)
        source = path.read_text(encoding='utf-8')
        names: dict[str, Any] = {'__name__': path.stem, '__file__': str(path)}
        exec(compile(source, str(path), 'exec'), names)  # noqa: S102 (the operator has named it)
    except OSError as error:
        raise SweepError(f'cannot read {path}: {error.strerror}') from error
    except Exception as error:
        raise SweepError(f'{path} cannot be run: {type(error).__name__}: {error}') from error
    if 'SPEC' not in names:
        raise SweepError(f'{path} does not define a dictionary SPEC')
    return names['SPEC'], source if callable(names.get(FUNCTION)) else ''


def sweep_of(
    fields: Section, path: Path, errors: Errors, source: str, runs: int, sampling: Sampling
) -> Sweep:
    """Read a sweep from its fields, except for its digest, ``runs`` and ``sampling``.

    Other files are searched in the folder of ``path``. ``source`` is the source of the function, if the file contains
    it.
    """
    name = fields.read('program', line_of_text(1000), '', prefix='')
    program_path = program_file.find(_in_folder(path.parent, name))
    parameters = fields.read('parameters', line_of_text(1000), None, prefix='')
    if parameters is not None:
        parameters = '+'.join(_in_folder(path.parent, one) for one in parameters.split('+'))
    robot = core.load(core.of_run(parameters, program_path))
    program = yaml_file.read(program_path, 'program file', ProgramError) if name else {}
    known = core.flatten(robot)
    vary = fields.read(
        'vary', partial(_variations, errors=errors, known=known, program=program), (), prefix=''
    )
    if not source and 'function' in fields:
        source = fields.read('function', partial(_source, folder=path.parent), '', prefix='')
    elif 'function' in fields:
        fields.read(
            'function', lambda *_: refuse(f'function: {path.name} already defines {FUNCTION}'), prefix=''
        )
    keep = fields.read('keep', partial(_kept, errors=errors), (), prefix='')
    names = [one.name for one in keep] or figure_names()
    limits = fields.read(
        'limits', partial(_limits, errors=errors, names=None if source else names), {}, prefix=''
    )
    return Sweep(
        name=fields.read('name', line_of_text(60), path.stem, prefix=''),
        program=program,
        program_name=program_path.stem,
        parameters=core.flat_document(robot),
        runs=runs,
        sampling=sampling,
        seed=fields.read('seed', whole_number_between(0, 2**31 - 1), 1, prefix=''),
        vary=vary,
        keep=keep,
        limits=limits,
        function=source,
    )


def digest_of(sweep: Sweep) -> str:
    """Return a digest of everything on which the results depend, including the version of the package."""
    content = {name: value for name, value in vars(sweep).items() if name not in ('name', 'limits', 'digest')}
    content['vary'] = [[one.key, one.law, list(one.values)] for one in sweep.vary]
    content['keep'] = [list(vars(one).values()) for one in sweep.keep]
    text = json.dumps([versions(), content], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _in_folder(folder: Path, name: str) -> str:
    """Return a file in a folder if it exists, otherwise the name itself: a packaged file, or a path."""
    return str(folder / name) if name and (folder / name).is_file() else name


def _source(value: Any, where: str, folder: Path) -> str:
    """Read the file of a function."""
    path = folder / line_of_text(1000)(value, where)
    try:
        whole_file.require_regular(path)
        return path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        refuse(f'{where}: cannot read {path}: {error}')


def _variations(
    value: Any, where: str, errors: Errors, known: Mapping[str, Any], program: Any
) -> tuple[Variation, ...]:
    if not isinstance(value, dict) or not value:
        refuse(f'{where} must name the varied quantities, not {shown(value)}')
    if len(value) > VARIED_MAX:
        refuse(f'{where} names {len(value)} quantities, the limit is {VARIED_MAX}')
    found = []
    for key, law in value.items():
        with errors.noted(place_of_key(value, key)):
            _require_known(key, known, program)
            with errors.noted(place_in(value, key)):
                found.append(_variation(key, law, errors))
    return tuple(found)


def _require_known(key: Any, known: Mapping[str, Any], program: Any) -> None:
    if not isinstance(key, str):
        refuse(f'{shown(key)} is not the name of a parameter')
    if key.startswith(PROGRAM):
        try:
            value_at(program, key.removeprefix(PROGRAM))
        except KeyError as error:
            refuse(f'{key}: the program has no {error.args[0]}')
        return
    name, bracket, number_ = key.partition('[')
    if name not in known:
        refuse(f'unknown parameter {shown(key)}{nearest_of(name, known)}')
    if bracket:
        values = known[name]
        place = number_.removesuffix(']')
        if not isinstance(values, tuple) or not place.isdecimal() or int(place) >= len(values):
            refuse(
                f'{key}: {name} has {len(values) if isinstance(values, tuple) else 1} values, counted from 0'
            )


def _variation(key: str, value: Any, errors: Errors) -> Variation:
    if value == Law.RUN:
        return Variation(key, Law.RUN)
    fields = Section(value, key, errors, (Law.LIST, Law.UNIFORM, Law.NORMAL))
    given = [law for law in (Law.LIST, Law.UNIFORM, Law.NORMAL) if law in fields]
    if len(given) != 1:
        refuse(f'{key} must be run, or one of list, uniform, normal, not {shown(value)}')
    (law,) = given

    def read(value: Any, where: str) -> tuple[Any, ...]:
        if not isinstance(value, list) or not value:
            refuse(f'{where} must be a list, not {shown(value)}')
        if law is Law.LIST:
            if len(value) > LIST_MAX:
                refuse(f'{where} has {len(value)} values, the limit is {LIST_MAX}')
            return tuple(value)
        if len(value) != 2:
            refuse(f'{where} must be two numbers, not {shown(value)}')
        first, second = (number(one, where) for one in value)
        if law is Law.UNIFORM and not first < second:
            refuse(f'{where} is {shown(value)}, but the first number must be the smaller one')
        if law is Law.NORMAL and not 0.0 <= second < float('inf'):
            refuse(f'{where} is {shown(value)}, but the second number is a standard deviation')
        return first, second

    return Variation(key, law, fields.read(law, read, ()))


def _kept(value: Any, where: str, errors: Errors) -> tuple[Kept, ...]:
    if not isinstance(value, list) or not value:
        refuse(f'{where} must be a list, not {shown(value)}')
    if len(value) > KEPT_MAX:
        refuse(f'{where} has {len(value)} entries, the limit is {KEPT_MAX}')
    found: list[Kept] = []
    for n, entry in enumerate(value):
        with errors.noted(place_in(value, n)):
            one = _one_kept(entry, f'{where}[{n}]', errors)
            if one.name in (other.name for other in found):
                refuse(f'{where}[{n}]: the name {one.name} is used twice')
            found.append(one)
    return tuple(found)


def _one_kept(entry: Any, where: str, errors: Errors) -> Kept:
    if isinstance(entry, str):
        return Kept(one_of(figure_names())(entry, where))
    fields = Section(entry, where, errors, OF_KEPT, ('name', 'signal'))
    return Kept(
        name=fields.read('name', name_of_number, ''),
        signal=fields.read('signal', _signal, ''),
        less=fields.read('less', _signal, ''),
        reduction=Reduction(fields.read('of', one_of(tuple(Reduction)), Reduction.MAX)),
        axis=fields.read('axis', whole_number_between(0, 16), 0),
        from_s=fields.read('from_s', number, 0.0),
        to_s=fields.read('to_s', number, float('inf')),
    )


def name_of_number(value: Any, where: str) -> str:
    """Read the name of a result."""
    if not isinstance(value, str) or not NAME.fullmatch(value):
        refuse(f'{where} must be a name of letters, digits and _, not {shown(value)}')
    return value


def _signal(value: Any, where: str) -> str:
    if not isinstance(value, str) or quantities.unit_of(value) is None:
        refuse(f'{where} is {shown(value)}, but must be a signal: see delta3 export trace --help')
    return value


def _limits(value: Any, where: str, errors: Errors, names: list[str] | None) -> dict[str, float]:
    if not isinstance(value, dict):
        refuse(f'{where} must be a mapping, not {shown(value)}')
    found = {}
    for name, limit in value.items():
        with errors.noted(place_in(value, name)):
            known = name_of_number(name, where) if names is None else one_of(names)(name, f'{where}: a name')
            found[known] = number(limit, f'{where}.{name}')
    return found
