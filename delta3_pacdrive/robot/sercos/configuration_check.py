"""Checks during start-up of the bus (CP0 to CP3): presence of all participants, equal parameters."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

from delta3_pacdrive.errors import Delta3Error
from delta3_pacdrive.parameters import ROTARY_AXES_MAX, Parameters, flatten, numbered

DRIVES = ('axis1', 'axis2', 'axis3')
# of the optional rotary axes
ROTARY_DRIVES = tuple(f'axis{len(DRIVES) + number}' for number in range(1, ROTARY_AXES_MAX + 1))
ALL_DRIVES = (*DRIVES, *ROTARY_DRIVES)
PLANT = 'plant'
PARTICIPANTS = (*DRIVES, PLANT)  # of a robot without a rotary axis


def lack_of(axis: str) -> str:
    """Return that a robot has no such rotary axis, with the parameter that is false."""
    group = numbered('rotary', ROTARY_DRIVES.index(axis))
    return f'the robot has no {axis} for a rotary axis ({group}.present is false)'


def require_axis(axis: str, axes: Sequence[str], error: type[Delta3Error], where: str = '') -> None:
    """Raise an ``error``, with the place ``where``, for a rotary axis that is not among the ``axes`` of the robot."""
    if axis in ROTARY_DRIVES and axis not in axes:
        raise error(f'{where}{lack_of(axis)}')


@dataclass(frozen=True)
class Identity:
    """Settings on which all participants must agree in CP2, as text."""

    cycle_time_s: str
    exchange_period_s: str
    increments_per_rev: str
    gear_ratio: str
    parameter_checksum: str
    parameters: str  # all of them (JSON), to name those that cause different checksums

    @staticmethod
    def of(parameters: Parameters) -> 'Identity':
        """Return the identity of a participant with the given parameters."""
        return Identity(
            cycle_time_s=repr(parameters.bus.cycle_time_s),
            exchange_period_s=repr(parameters.bus.exchange_period_s),
            increments_per_rev=repr(parameters.bus.increments_per_rev),
            gear_ratio=repr(parameters.dynamics.gear_ratio),
            parameter_checksum=parameters.checksum,
            parameters=json.dumps(flatten(parameters)),
        )


def missing(present: Mapping[str, object], participants: Sequence[str] = PARTICIPANTS) -> list[str]:
    """Return the participants that have not announced themselves."""
    return [name for name in participants if name not in present]


def disagreements(master: Identity, participants: Mapping[str, Identity]) -> list[str]:
    """Return one sentence per participant that differs from the master, with both values."""
    sentences = []
    for name, identity in participants.items():
        for f in fields(Identity):
            theirs, ours = getattr(identity, f.name), getattr(master, f.name)
            if theirs != ours:
                sentence = f'{name} has {f.name} {theirs}, but the master has {ours}'
                if f.name == 'parameter_checksum':
                    sentence += _first_difference(identity.parameters, master.parameters)
                sentences.append(sentence)
                break
    return sentences


def _first_difference(theirs: str, ours: str) -> str:
    """Name the first different parameter; empty if a text is malformed."""
    try:
        remote, own = dict(json.loads(theirs)), dict(json.loads(ours))
    except (ValueError, TypeError, RecursionError):
        return ''
    different = [name for name in own | remote if remote.get(name) != own.get(name)]
    if not different:
        return ''
    more = f', and {len(different) - 1} more' if len(different) > 1 else ''
    name = different[0]
    return f' ({name} is {remote.get(name)} there, {own.get(name)} here{more})'
