"""Who takes part in the bus, as the master knows it from announcements.

An announcement says to which session it belongs: it answers a call of this master. One of another session, out of a
bag that is played back for example, is of somebody who is not there. In cyclic operation nobody is called any more; who
announces itself then has come later, or has left the bus.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from delta3_pacdrive.sercos.configuration_check import PARTICIPANTS, PLANT, Identity


class Occasion(StrEnum):
    """Why a participant announces itself."""

    CALLED = 'answers the call'
    STARTED = 'has started in cyclic operation'
    LEFT = 'has left the bus'


@dataclass(frozen=True)
class Announcement:
    """What a participant says of itself.

    Attributes
    ----------
    instance
        Identity of its process, other than that of any before.
    links
        Partners from which it has received something in the session.
    bus_cycle
        First bus cycle that it has not seen yet.
    inputs
        Names of the inputs that it answers for.
    belts
        What it tells of the belts that it answers for: JSON, as ``controller/belt_axes.py`` has it.

    """

    name: str
    instance: str
    session: str
    occasion: Occasion
    identity: Identity
    links: tuple[str, ...] = ()
    bus_cycle: int = 0
    inputs: tuple[str, ...] = ()
    belts: str = '[]'


class Participants:
    """Table of participants of one master.

    Parameters
    ----------
    names
        Of those who take part.

    Attributes
    ----------
    identities, links
        Of those that have answered the call of this session: identities, and the partners from which they have received
        something.
    bus_cycle
        First bus cycle that nobody has seen yet.
    inputs, belts
        Names of the inputs that the plant answers for, and what it tells of its belts.

    """

    def __init__(self, names: Sequence[str] = PARTICIPANTS) -> None:
        self._names = names
        self.identities: dict[str, Identity] = {}
        self.links: dict[str, tuple[str, ...]] = {}
        self.bus_cycle = 0
        self.inputs: tuple[str, ...] = ()
        self.belts = '[]'
        self._session = ''
        self._cyclic = False
        self._told: set[tuple[str, str, Occasion]] = set()

    def begin(self, session: str) -> None:
        """Call everybody anew."""
        self._session, self._cyclic = session, False
        self.identities, self.links = {}, {}
        self._told.clear()

    def close(self) -> None:
        """Begin cyclic operation."""
        self._cyclic = True

    def announced(self, announcement: Announcement) -> bool:
        """Take an announcement; whether its participant has come or gone in cyclic operation."""
        if announcement.session != self._session or announcement.name not in self._names:
            return False
        self.bus_cycle = max(self.bus_cycle, announcement.bus_cycle)
        if not self._cyclic:
            self.identities[announcement.name] = announcement.identity
            self.links[announcement.name] = announcement.links
            if announcement.name == PLANT:
                self.inputs, self.belts = announcement.inputs, announcement.belts
            return False
        key = (announcement.name, announcement.instance, announcement.occasion)
        if announcement.occasion == Occasion.CALLED or key in self._told:
            return False
        self._told.add(key)
        return True
