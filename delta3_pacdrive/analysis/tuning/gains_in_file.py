"""Gains in a parameter file: values are changed where they stand, comments stay; and the file as it was is kept.

Beside ``robot.yaml`` stand ``robot.yaml.before``, its bytes as they were, and ``robot.yaml.applied``, a digest of the
bytes that were left: a file that somebody has changed since is not taken back.
"""

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path

from delta3_pacdrive import parameters, whole_file
from delta3_pacdrive.analysis.provenance import os_errors_as
from delta3_pacdrive.configuration import parameter_file
from delta3_pacdrive.errors import ParameterError, TuningError

BEFORE, APPLIED = '.before', '.applied'
# the rows of the group drive: those that stand deeper, and comments between them
_GROUP = re.compile(
    r'^(?P<indent> +)drive:[ \t]*(#.*)?\n(?P<rows>((?P=indent) +.*\n?|[ \t]*(#.*)?\n)*)', re.MULTILINE
)


def beside(path: Path, ending: str) -> Path:
    """File that is kept beside another one."""
    return path.with_name(path.name + ending)


def apply(gains: Mapping[str, float], path: Path) -> None:
    """Change the group drive of a parameter file, and keep the file as it was.

    A file that still is as the last gains left it keeps what was before those.

    Raises
    ------
    TuningError
        It has no group drive that could be changed, or cannot be written, or is a robot that would be none any more;
        says why.
    ParameterError
        It is no parameter file.

    """
    tree = parameter_file.read(path)
    text = path.read_bytes().decode()
    changed = text
    for name, value in gains.items():
        changed = _with(changed, name, value, path)
    wanted = tree | {'drive': dict(tree.get('drive') or {}) | dict(gains)}
    with os_errors_as(f'cannot change {path}'):
        trial = beside(path, '.new')
        try:
            whole_file.write_text(changed, trial)
            if not _reads_as(wanted, trial):
                raise TuningError(
                    f'{path}: its group drive is written in a way that cannot be changed line by line'
                )
            _require_robot(path, trial)
        finally:
            trial.unlink(missing_ok=True)
        if not _is_as_applied(path):
            whole_file.write_text(text, beside(path, BEFORE))
        whole_file.write_text(_digest(changed.encode()), beside(path, APPLIED))
        whole_file.write_text(changed, path)


def undo(path: Path) -> None:
    """Bring a file back as it was before gains were applied; raises TuningError, which says why not."""
    before = beside(path, BEFORE)
    if not before.is_file():
        raise TuningError(f'there is nothing to be undone: no {before} is kept')
    with os_errors_as(f'cannot change {path}'):
        text = before.read_bytes()
        if path.read_bytes() != text and not _is_as_applied(path):
            raise TuningError(
                f'{path} was changed after gains were applied: nothing is undone; {before} has what was before'
            )
        whole_file.write_text(text.decode(), path)
        before.unlink()
        beside(path, APPLIED).unlink(missing_ok=True)


def _reads_as(wanted: parameter_file.Tree, path: Path) -> bool:
    try:
        return parameter_file.read(path) == wanted
    except ParameterError:
        return False


def _require_robot(path: Path, trial: Path) -> None:
    """Refuse a trial that is no robot any more, if the file that it is to replace is one; raises TuningError."""
    try:
        parameters.load(path)
    except ParameterError:
        return  # holds differences only
    try:
        parameters.load(trial)
    except ParameterError as error:
        told = str(error).replace(str(trial), str(path))
        raise TuningError(f'no robot can have these gains: {told}') from None


def _is_as_applied(path: Path) -> bool:
    applied = beside(path, APPLIED)
    if not applied.is_file() or not beside(path, BEFORE).is_file():
        return False
    return applied.read_text(encoding='utf-8') == _digest(path.read_bytes())


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest() + '\n'


def _with(text: str, name: str, value: float, path: Path) -> str:
    """Return the text of a file with one value of its group drive."""
    group = _GROUP.search(text)
    if group is None:
        raise TuningError(f'{path} has no group drive whose rows could be changed')
    rows = group['rows']
    row = re.search(rf'^( +{name}:[ \t]*)([^\s#]+)', rows, re.MULTILINE)
    if row is not None:
        # what stands behind stays in its column
        end = row.end() + len(re.match(r' *', rows[row.end() :])[0])  # type: ignore[index]
        room = end - row.start(2)
        told = f'{value!r}'.ljust(room) if rows[end : end + 1] == '#' else f'{value!r}'
        if rows[end : end + 1] == '#' and not told.endswith(' '):
            told += '  '
        rows = rows[: row.start(2)] + told + rows[end:]
    else:
        first = re.match(r' +', rows)
        rows = f'{first[0] if first else group["indent"] + "  "}{name}: {value!r}\n{rows}'
    return text[: group.start('rows')] + rows + text[group.end('rows') :]
