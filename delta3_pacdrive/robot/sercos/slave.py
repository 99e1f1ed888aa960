"""State machine of a bus slave, drive or plant: joins, follows one master at a time, and leaves.

Announced phases and losses are events; the machine returns actions in order. Events without a row of ``TRANSITIONS``
in a state have no effect.
"""

from dataclasses import dataclass
from enum import Enum, auto

from delta3_pacdrive.robot.sercos.telegrams import NO_SESSION
from delta3_pacdrive.robot.sercos.words import Phase


class State(Enum):
    """States of a slave."""

    OUT = auto()  # without a session
    PREPARED = auto()  # knows the session and answers greetings: CP1 to CP3
    CYCLIC = auto()  # exchanges telegrams in bus cycles: CP4
    PARTING = auto()  # still exchanges telegrams during its stop: the master has fallen to CP0 or is lost


class Event(Enum):
    """Events of a slave."""

    CALL = auto()  # CP0 is announced
    CALL_IN_MOTION = auto()  # CP0 is announced, but this slave must stop first
    PREPARE = auto()  # CP1 to CP3 is announced, in a new session or repeatedly
    BEGIN = auto()  # CP4 is announced in its session
    FOREIGN = auto()  # CP4 is announced in another session
    LOSS = auto()  # the master is lost
    REST = auto()  # the stop has ended, or all partners have gone


@dataclass(frozen=True)
class Answer:
    """Announce the slave to a master that calls, or whose session it adopts."""

    session: bytes


@dataclass(frozen=True)
class Report:
    """Announce to a master in cyclic operation that the slave has started."""

    session: bytes


@dataclass(frozen=True)
class Adopt:
    """Adopt a session."""

    session: bytes


@dataclass(frozen=True)
class Join:
    """Start cyclic operation at a bus time, counted in the slave's cycles or exchanges."""

    start: int


@dataclass(frozen=True)
class Part:
    """Start a stop without the master."""

    reason: str


@dataclass(frozen=True)
class Leave:
    """End the activities of a session, possibly in cyclic operation."""

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
    """State machine of one slave, drive or plant."""

    def __init__(self) -> None:
        self.state = State.OUT
        self.session = NO_SESSION
        self.cyclic = False

    @property
    def parting(self) -> bool:
        """Whether the slave is stopping without the master."""
        return self.state is State.PARTING

    def announced(self, phase: Phase, session: bytes, start: int, moves: bool, alone: bool) -> list[Action]:
        """Process the announcement of a phase.

        Parameters
        ----------
        phase, session, start
            Announced values; the bus time in this slave's own count.
        moves
            Whether this slave must stop before leaving cyclic operation.
        alone
            Whether only one master announces phases. A second master is ignored in cyclic operation; a new master
            repeats its announcement after the last one has gone.

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
        """Handle the loss of the master."""
        return self._take(Event.LOSS, reason=reason)

    def rest(self) -> list[Action]:
        """End the stop, or cyclic operation without partners."""
        return self._take(Event.REST)

    def _take(
        self,
        event: Event,
        session: bytes = NO_SESSION,
        start: int = 0,
        reason: str = 'the phase fell to CP0',
    ) -> list[Action]:
        """Execute the transition of an event, if there is one; return its actions."""
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
