"""Apply gains to the drives of a running robot through their service channels, and undo it; all gains or none.

The previous values are saved to a file before the first write, so that an interrupted run can be undone. Falling gains
are written first, from the outer loop inwards, and rising gains last, from the inner loop outwards. Notch filters
change in between: the shape before the frequency, or after it if the filter is switched off. An enabled drive is
therefore never stiffer than before or after, and never has gains without the filter that they require.
"""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import Delta3Error, ProgramError, TuningError
from delta3_pacdrive.robot.drive.operation_data import OF_PARAMETER, TABLE
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.service_channel import format_idn
from delta3_pacdrive.studies.framework.provenance import os_errors_as

FILE = 'applied.json'
SAME = 1e-11  # relative tolerance: values are transferred with twelve digits
INWARDS = ('position_gain_rad_s_rad', 'velocity_integral_gain_a_rad', 'velocity_gain_a_s_rad')

Values = dict[str, dict[str, float]]  # by axis, and by name of the group drive


class _LeftError(TuningError):
    """A write failed, and some of the values already written could not be restored."""


class Channel(Protocol):
    """Access to operation data of the drives.

    Raises ProgramError if a drive rejects an access, another Delta3Error if the outcome is unknown.
    """

    def read(self, axis: str, idn: str) -> float:
        """Return a value."""

    def write(self, axis: str, idn: str, value: float) -> None:
        """Write a value."""


@dataclass(frozen=True)
class Record:
    """Gains that were applied to a robot, and the previous values."""

    namespace: str
    before: Values
    after: Values

    def save(self, folder: Path) -> None:
        """Save the record to a folder; raises ReportError."""
        with os_errors_as(f'cannot write to {folder}'):
            folder.mkdir(parents=True, exist_ok=True)
            whole_file.write_text(json.dumps({'robot': asdict(self)}, indent=2) + '\n', folder / FILE)


def idn_of(name: str) -> str:
    """Return the IDN of a parameter of the group ``drive``."""
    return format_idn(OF_PARAMETER[f'drive.{name}'])


def apply(gains: Mapping[str, float], channel: Channel, namespace: str, folder: Path) -> Record:
    """Write gains to all drives and save the previous values.

    Parameters
    ----------
    gains
        Values by name of the group ``drive``.
    channel
        Service channels of the drives.
    namespace
        Namespace of the robot.
    folder
        Folder of the record. A record of the same robot that still applies keeps its previous values.

    Raises
    ------
    TuningError
        The folder contains the record of another robot, or a drive rejects a value or does not reply. The message names
        the drive and says whether all drives have their previous values.
    ReportError
        The record cannot be written; no gains have been applied.

    """
    old = require_same_robot(namespace, folder)
    present = _present(gains, channel)
    after: Values = {axis: dict(gains) for axis in DRIVES}
    before = present
    if old is not None and _same(present, old.after):
        before = {axis: present[axis] | old.before[axis] for axis in DRIVES}
        after = {axis: old.after[axis] | after[axis] for axis in DRIVES}
    record = Record(namespace, before, after)
    record.save(folder)
    try:
        _write(present, {axis: dict(gains) for axis in DRIVES}, channel)
    except _LeftError:
        raise  # keep the record: undo needs it to restore the remaining values
    except TuningError:
        if old is None:
            (folder / FILE).unlink()
        else:
            old.save(folder)
        raise
    return record


def undo(channel: Channel, folder: Path) -> Record:
    """Write back the previous values; raises TuningError as ``apply`` does, or if no record exists."""
    record = _undoable(folder)
    present = {axis: _present(record.after[axis], channel, (axis,))[axis] for axis in DRIVES}
    for axis, values in present.items():
        for name, value in values.items():
            ours = record.before[axis][name], record.after[axis][name]
            if not any(math.isclose(value, one, rel_tol=SAME) for one in ours):
                raise TuningError(
                    f'{axis} has {idn_of(name)} {_name(name)} = {value:g} instead of the applied {ours[1]:g}: '
                    'the value was changed since, or this is another robot; nothing is undone'
                )
    _write(present, record.before, channel)
    (folder / FILE).unlink()
    return record


def require_same_robot(namespace: str, folder: Path) -> Record | None:
    """Return the record of a folder, or None; raises TuningError if it belongs to another robot."""
    old = _kept(folder)
    if old is not None and old.namespace != namespace:
        raise TuningError(
            f'the gains of {old.namespace} are still applied from {folder}: --undo first, or another --output'
        )
    return old


def namespace_in(folder: Path) -> str:
    """Return the namespace of the robot whose gains a folder records; raises TuningError."""
    return _undoable(folder).namespace


def _undoable(folder: Path) -> Record:
    record = _kept(folder)
    if record is None:
        raise TuningError(f'nothing to undo: no gains of {folder} are applied')
    return record


def _present(gains: Mapping[str, float], channel: Channel, axes: tuple[str, ...] = tuple(DRIVES)) -> Values:
    return {axis: {name: channel.read(axis, idn_of(name)) for name in gains} for axis in axes}


def _same(one: Values, other: Values) -> bool:
    return all(
        name in other.get(axis, {}) and math.isclose(value, other[axis][name], rel_tol=SAME)
        for axis, values in one.items()
        for name, value in values.items()
    )


def _write(present: Values, wanted: Values, channel: Channel) -> None:
    """Write values to all drives; if one fails, restore the previous values. Raises TuningError."""
    written: list[tuple[str, str, float]] = []
    for axis in DRIVES:
        for name in _in_order(present[axis], wanted[axis]):
            before, value = present[axis][name], wanted[axis][name]
            try:
                channel.write(axis, idn_of(name), value)
            except Delta3Error as error:
                if not isinstance(error, ProgramError):
                    written.append((axis, name, before))  # the drive may have accepted it
                left = _restore(written, channel)
                if left:
                    raise _LeftError(
                        f'{error}; these values could not be restored, but --undo may do so later: {", ".join(left)}'
                    ) from error
                raise TuningError(f'{error}; all drives have their previous values') from error
            written.append((axis, name, before))


def _in_order(present: Mapping[str, float], wanted: Mapping[str, float]) -> list[str]:
    """Return the names of changed values in an order in which no intermediate set is worse than the first or last."""
    changed = [name for name, value in wanted.items() if not math.isclose(present[name], value, rel_tol=SAME)]
    return sorted(changed, key=lambda name: _rank(name, present, wanted))


def _rank(name: str, present: Mapping[str, float], wanted: Mapping[str, float]) -> tuple[int, int]:
    """Return the position of a value in the writing order: stage, and rank within the stage."""
    filtered = re.match(r'notch_\d_', name)
    if filtered is None:
        index = INWARDS.index(name) if name in INWARDS else 0
        return (0, index) if wanted[name] < present[name] else (4, -index)
    frequency = f'{filtered[0]}frequency_hz'
    if name == frequency:
        return 2, 0
    return (3 if wanted.get(frequency) == 0.0 else 1), 0


def _restore(written: list[tuple[str, str, float]], channel: Channel) -> list[str]:
    """Write back previous values; return those that could not be written."""
    left = []
    for axis, name, before in reversed(written):
        try:
            channel.write(axis, idn_of(name), before)
        except Delta3Error:
            left.append(f'{axis} {idn_of(name)} (was {before:g})')
    return left


def _name(name: str) -> str:
    return TABLE[OF_PARAMETER[f'drive.{name}']].name


def _kept(folder: Path) -> Record | None:
    """Return the record of a folder, or None without a file; raises TuningError if it is damaged."""
    path = folder / FILE
    try:
        text = path.read_text(encoding='utf-8')
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise TuningError(f'cannot read {path}: {error}') from None
    try:
        content: Any = json.loads(text)['robot']
        before, after = (
            {
                axis: {str(name): float(value) for name, value in content[side][axis].items()}
                for axis in DRIVES
            }
            for side in ('before', 'after')
        )
        known = all(f'drive.{name}' in OF_PARAMETER for axis in DRIVES for name in after[axis])
        if not known or any(before[axis].keys() != after[axis].keys() for axis in DRIVES):
            raise ValueError
        return Record(str(content['namespace']), before, after)
    except (ValueError, KeyError, TypeError, AttributeError):
        raise TuningError(f'{path} is not a record of applied gains') from None
