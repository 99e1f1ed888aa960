"""Apply gains to a parameter file, keeping its layout and comments, and undo it.

``robot.yaml.before`` keeps the original bytes, ``robot.yaml.applied`` a digest of the bytes after applying. A file that
was changed since is not restored.
"""

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive import parameters
from delta3_pacdrive.configuration import parameter_file
from delta3_pacdrive.errors import ParameterError, TuningError
from delta3_pacdrive.studies.framework.provenance import os_errors_as

BEFORE, APPLIED = '.before', '.applied'
# rows of the group drive: all rows with deeper indentation, and comments between them
_GROUP = re.compile(
    r'^(?P<indent> +)drive:[ \t]*(#.*)?\n(?P<rows>((?P=indent) +.*\n?|[ \t]*(#.*)?\n)*)', re.MULTILINE
)


def sibling(path: Path, ending: str) -> Path:
    """Return the path of a file next to another one, with ``ending`` appended to its name."""
    return path.with_name(path.name + ending)


def apply(gains: Mapping[str, float], path: Path) -> None:
    """Change the group ``drive`` of a parameter file and keep the original.

    If the file is unchanged since gains were last applied, the backup from before that is kept.

    Raises
    ------
    TuningError
        The file has no group ``drive`` that can be edited, cannot be written, or would no longer be valid.
    ParameterError
        It is not a parameter file.

    """
    tree = parameter_file.read(path)
    text = path.read_bytes().decode()
    changed = text
    for name, value in gains.items():
        changed = _with(changed, name, value, path)
    wanted = tree | {'drive': dict(tree.get('drive') or {}) | dict(gains)}
    with os_errors_as(f'cannot change {path}'):
        trial = sibling(path, '.new')
        try:
            whole_file.write_text(changed, trial)
            if not _reads_as(wanted, trial):
                raise TuningError(
                    f'{path}: the layout of its group drive does not allow editing line by line'
                )
            _require_robot(path, trial)
        finally:
            trial.unlink(missing_ok=True)
        if not _is_as_applied(path):
            whole_file.write_text(text, sibling(path, BEFORE))
        whole_file.write_text(_digest(changed.encode()), sibling(path, APPLIED))
        whole_file.write_text(changed, path)


def undo(path: Path) -> None:
    """Restore a file from before gains were applied; raises TuningError."""
    before = sibling(path, BEFORE)
    if not before.is_file():
        raise TuningError(f'nothing to undo: {before} does not exist')
    with os_errors_as(f'cannot change {path}'):
        text = before.read_bytes()
        if path.read_bytes() != text and not _is_as_applied(path):
            raise TuningError(
                f'{path} was changed after gains were applied: nothing is undone; {before} is the original'
            )
        whole_file.write_text(text.decode(), path)
        before.unlink()
        sibling(path, APPLIED).unlink(missing_ok=True)


def _reads_as(wanted: parameter_file.Tree, path: Path) -> bool:
    try:
        return parameter_file.read(path) == wanted
    except ParameterError:
        return False


def _require_robot(path: Path, trial: Path) -> None:
    """Reject a trial that is not a valid robot if the file that it replaces is one; raises TuningError."""
    try:
        parameters.load(path)
    except ParameterError:
        return  # file of differences
    try:
        parameters.load(trial)
    except ParameterError as error:
        reason = str(error).replace(str(trial), str(path))
        raise TuningError(f'a robot cannot have these gains: {reason}') from None


def _is_as_applied(path: Path) -> bool:
    applied = sibling(path, APPLIED)
    if not applied.is_file() or not sibling(path, BEFORE).is_file():
        return False
    return applied.read_text(encoding='utf-8') == _digest(path.read_bytes())


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest() + '\n'


def _with(text: str, name: str, value: float, path: Path) -> str:
    """Return the text of a file with one value of its group ``drive`` set."""
    group = _GROUP.search(text)
    if group is None:
        raise TuningError(f'{path} has no group drive with rows that can be changed')
    rows = group['rows']
    row = re.search(rf'^( +{name}:[ \t]*)([^\s#]+)', rows, re.MULTILINE)
    if row is not None:
        # keep the column of a comment after the value
        end = row.end() + len(re.match(r' *', rows[row.end() :])[0])  # type: ignore[index]
        shown = repr(value)
        if rows[end : end + 1] == '#':
            shown = shown.ljust(end - row.start(2))
            if not shown.endswith(' '):
                shown += '  '
        rows = rows[: row.start(2)] + shown + rows[end:]
    else:
        first = re.match(r' +', rows)
        rows = f'{first[0] if first else group["indent"] + "  "}{name}: {value!r}\n{rows}'
    return text[: group.start('rows')] + rows + text[group.end('rows') :]
