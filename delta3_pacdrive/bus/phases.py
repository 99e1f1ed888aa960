"""Start-up of the bus: who is there, and whether everybody means the same (phases CP0 to CP3)."""

from collections.abc import Mapping
from dataclasses import dataclass, fields

from delta3_pacdrive.parameters import Parameters

DRIVES = ('axis1', 'axis2', 'axis3')
PLANT = 'plant'
PARTICIPANTS = (*DRIVES, PLANT)


@dataclass(frozen=True)
class Identity:
    """What every participant must agree on in CP2, as text."""

    cycle_time_s: str
    exchange_period_s: str
    increments_per_rev: str
    gear_ratio: str
    parameter_checksum: str

    @staticmethod
    def of(parameters: Parameters) -> 'Identity':
        """Return the identity of a participant with these parameters."""
        return Identity(
            repr(parameters.bus.cycle_time_s),
            repr(parameters.bus.exchange_period_s),
            repr(parameters.bus.increments_per_rev),
            repr(parameters.dynamics.gear_ratio),
            parameters.checksum,
        )


def missing(present: Mapping[str, object]) -> list[str]:
    """Participants that have not announced themselves."""
    return [name for name in PARTICIPANTS if name not in present]


def disagreements(master: Identity, participants: Mapping[str, Identity]) -> list[str]:
    """One sentence for each participant that differs from the master; names both values."""
    sentences = []
    for name, identity in participants.items():
        for f in fields(Identity):
            theirs, ours = getattr(identity, f.name), getattr(master, f.name)
            if theirs != ours:
                sentences.append(f'{name} has {f.name} {theirs}, but the master has {ours}')
                break
    return sentences
