"""How a drive, or the plant, takes part in the bus: it joins, obeys one master at a time, and leaves.

Announcements of phases and what is missing come in as events; what has to be done about it goes out as actions, in
their order. ``TRANSITIONS`` is all of it: an event that has no row in a state changes nothing.
"""

from dataclasses import dataclass
from enum import Enum, auto

from delta3_pacdrive.sercos.telegrams import NO_SESSION
from delta3_pacdrive.sercos.words import Phase


class State(Enum):
    """What a slave is on the bus."""

    OUT = auto()  # it belongs to no session
    PREPARED = auto()  # it knows the session and answers greetings: CP1 to CP3
    CYCLIC = auto()  # it exchanges telegrams in bus cycles: CP4
    PARTING = auto()  # it still does, to come to its stop: the master has let go, or is lost


class Event(Enum):
    """What happens to a slave."""

    CALL = auto()  # CP0 is announced
    CALL_IN_MOTION = auto()  # the same to one that has to come to a stop first
    PREPARE = auto()  # CP1 to CP3 is announced, in another session than its own or anew
    BEGIN = auto()  # CP4 is announced in its session
    FOREIGN = auto()  # CP4 is announced in another session
    LOSS = auto()  # the master is lost
    REST = auto()  # the stop is over, or nobody is left to stop with


@dataclass(frozen=True)
class Answer:
    """The slave announces itself to a master that calls, or whose session it adopts."""

    session: bytes


@dataclass(frozen=True)
class Report:
    """The slave announces to a master in cyclic operation that it has started."""

    session: bytes


@dataclass(frozen=True)
class Adopt:
    """The slave belongs to a session from now on."""

    session: bytes


@dataclass(frozen=True)
class Join:
    """The slave begins cyclic operation at a bus time, in its own count of cycles or exchanges."""

    start: int


@dataclass(frozen=True)
class Part:
    """The slave begins its stop without the master, for a reason."""

    reason: str


@dataclass(frozen=True)
class Leave:
    """The slave ends what it did in a session, perhaps in cyclic operation."""

    session: bytes
    cyclic: bool


Action = Answer | Report | Adopt | Join | Part | Leave

TRANSITIONS: dict[tuple[State, Event], tuple[State, tuple[type[Action], ...]]] = {
    (State.OUT, Event.CALL): (State.OUT, (Answer,)),
    (State.OUT, Event.PREPARE): (State.PREPARED, (Adopt, Answer)),
    (State.OUT, Event.FOREIGN): (State.OUT, (Report,)),
    (State.PREPARED, Event.CALL): (State.OUT, (Leave, Answer)),
    (State.PREPARED, Event.PREPARE): (State.PREPARED, (Adopt, Answer)),
    (State.PREPARED, Event.BEGIN): (State.CYCLIC, (Join,)),
    (State.CYCLIC, Event.CALL): (State.OUT, (Leave, Answer)),
    (State.CYCLIC, Event.CALL_IN_MOTION): (State.PARTING, (Part,)),
    (State.CYCLIC, Event.PREPARE): (State.PREPARED, (Leave, Adopt, Answer)),
    (State.CYCLIC, Event.LOSS): (State.PARTING, (Part,)),
    (State.CYCLIC, Event.REST): (State.OUT, (Leave,)),
    (State.PARTING, Event.PREPARE): (State.PREPARED, (Leave, Adopt, Answer)),
    (State.PARTING, Event.REST): (State.OUT, (Leave,)),
}


class BusSlave:
    """One slave of the bus, a drive or the plant.

    Attributes
    ----------
    state
        What it is on the bus.
    session
        Session that it belongs to, ``NO_SESSION`` for none.
    cyclic
        Whether it exchanges telegrams in bus cycles.

    """

    def __init__(self) -> None:
        self.state = State.OUT
        self.session = NO_SESSION
        self.cyclic = False

    @property
    def parting(self) -> bool:
        """Whether it comes to its stop without the master."""
        return self.state is State.PARTING

    def announced(self, phase: Phase, session: bytes, start: int, moves: bool, alone: bool) -> list[Action]:
        """Take the announcement of a phase.

        Parameters
        ----------
        phase, session, start
            That a master announces; the bus time in this slave's own count.
        moves
            Whether this slave has to come to a stop before it may leave cyclic operation.
        alone
            Whether only one master announces phases. In cyclic operation a second one, or a stranger, is not obeyed;
            a new master announces itself again when the last one has gone.

        """
        if self.cyclic and not alone:
            return []
        if phase == Phase.CP0:
            event = Event.CALL_IN_MOTION if moves and self.cyclic else Event.CALL
        elif phase != Phase.CP4:
            if session == self.session and not self.cyclic:
                return []
            event = Event.PREPARE
        else:
            event = Event.BEGIN if session == self.session else Event.FOREIGN
        return self._take(event, session, start)

    def lose_master(self, reason: str) -> list[Action]:
        """Go on without the master, which is lost for a reason."""
        return self._take(Event.LOSS, reason=reason)

    def rest(self) -> list[Action]:
        """End the stop, or cyclic operation without anybody left."""
        return self._take(Event.REST)

    def _take(
        self,
        event: Event,
        session: bytes = NO_SESSION,
        start: int = 0,
        reason: str = 'the phase fell to CP0',
    ) -> list[Action]:
        """Let an event happen; return what it brings about."""
        if (self.state, event) not in TRANSITIONS:
            return []
        before = Leave(self.session, self.cyclic)
        self.state, acts = TRANSITIONS[self.state, event]
        self.cyclic = self.state in (State.CYCLIC, State.PARTING)
        if Leave in acts:
            self.session = NO_SESSION
        if Adopt in acts:
            self.session = session
        values: dict[type[Action], Action] = {
            Answer: Answer(session),
            Report: Report(session),
            Adopt: Adopt(session),
            Join: Join(start),
            Part: Part(reason),
            Leave: before,
        }
        return [values[act] for act in acts]
