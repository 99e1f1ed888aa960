"""Participants of the bus as known to the master from their announcements.

An announcement carries the session that it answers. Those of other sessions, for example from a bag being played back,
are ignored. In cyclic operation the master sends no calls: an announcement then means that a participant has started
or left the bus.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from delta3_pacdrive.robot.sercos.configuration_check import PARTICIPANTS, PLANT, Identity


class Occasion(StrEnum):
    """Reason of an announcement."""

    CALLED = 'answers the call'
    STARTED = 'has started in cyclic operation'
    LEFT = 'has left the bus'


@dataclass(frozen=True)
class Announcement:
    """Announcement of a participant."""

    name: str
    instance: str  # unique identity of its process
    session: str
    occasion: Occasion
    identity: Identity
    links: tuple[str, ...] = ()  # partners from which it has received data in this session
    bus_cycle: int = 0  # first bus cycle that it has not processed
    inputs: tuple[str, ...] = ()  # names of the inputs that it provides
    belts: str = '[]'  # description of its belts: JSON, as in ``belts/image.py``


class Participants:
    """Participants of one master.

    Attributes
    ----------
    identities, links
        Identities and received partners of the participants that have answered in this session.
    bus_cycle
        First bus cycle that no participant has processed.
    inputs, belts
        Input names and belt description of the plant.

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
        self._handled: set[tuple[str, str, Occasion]] = set()

    def begin(self, session: str) -> None:
        """Start a new session."""
        self._session, self._cyclic = session, False
        self.identities, self.links = {}, {}
        self._handled.clear()

    def close(self) -> None:
        """Start cyclic operation."""
        self._cyclic = True

    def announced(self, announcement: Announcement) -> bool:
        """Process an announcement; return whether its participant has started or left in cyclic operation."""
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
        if announcement.occasion == Occasion.CALLED or key in self._handled:
            return False
        self._handled.add(key)
        return True
