"""The master of the bus: it phases the bus up from CP0 to CP4, lets it fall, and phases it up again.

Looks, announcements and answers come in as events; what has to be done goes out as actions, in their order. A phase is
left when nothing is left that it waits for; ``TRANSITIONS`` says where to, and what is done there.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto

from delta3_pacdrive.errors import Code, FaultCode, Reason, RobotFault
from delta3_pacdrive.sercos.configuration_check import (
    DRIVES,
    PLANT,
    Identity,
    disagreements,
    missing,
)
from delta3_pacdrive.sercos.losses import NO_ANSWER
from delta3_pacdrive.sercos.participants import Announcement, Participants
from delta3_pacdrive.sercos.telegrams import new_session
from delta3_pacdrive.sercos.watchdog import ANSWER_SILENT_S, BUS_SILENT_S
from delta3_pacdrive.sercos.words import Phase

PATIENCE = 50  # looks in vain after which a guess at the reason is told
CALL_EVERY = 10  # looks, after which the phase is announced once more
AHEAD = 2  # cycles by which others answer later ones than a drive that is lost


class Event(Enum):
    """What happens to the bus."""

    PRESENT = auto()  # everybody has answered the call, and nobody is there twice
    ANSWERED = auto()  # all drives have answered a greeting
    # all rest on the same parameters, they receive from one another, and the place of the robot is known
    AGREED = auto()
    READY = auto()  # nothing speaks against cyclic operation
    FALL = auto()  # cyclic operation cannot go on


@dataclass(frozen=True)
class Announce:
    """The phase is announced, with the bus time at which cyclic operation begins; whether it is entered now."""

    phase: Phase
    session: bytes
    cycle: int
    entered: bool


@dataclass(frozen=True)
class Greet:
    """A greeting goes to all drives: an MDT outside of cyclic operation."""

    phase: Phase
    session: bytes


@dataclass(frozen=True)
class Stand:
    """The robot stands ready for a program, from a bus cycle on."""

    cycle: int


@dataclass(frozen=True)
class Begin:
    """Cyclic operation begins with a bus cycle."""

    cycle: int


@dataclass(frozen=True)
class GiveUp:
    """Everything that needs cyclic operation is given up, which a fault has ended; a new session begins."""

    fault: RobotFault
    session: bytes


@dataclass(frozen=True)
class Note:
    """A fault is noted."""

    fault: RobotFault


@dataclass(frozen=True)
class StopRobot:
    """The robot stops for a fault that leaves the bus working."""

    fault: RobotFault


@dataclass(frozen=True)
class Drop:
    """The bus goes on without a drive."""

    index: int
    fault: RobotFault


@dataclass(frozen=True)
class Wait:
    """What the present phase waits for has changed."""

    reason: Reason


Action = Announce | Greet | Stand | Begin | GiveUp | Note | StopRobot | Drop | Wait

TRANSITIONS: dict[tuple[Phase, Event], tuple[Phase, tuple[type[Action], ...]]] = {
    (Phase.CP0, Event.PRESENT): (Phase.CP1, (Announce,)),
    (Phase.CP1, Event.ANSWERED): (Phase.CP2, (Announce,)),
    (Phase.CP2, Event.AGREED): (Phase.CP3, (Announce, Stand)),
    (Phase.CP3, Event.READY): (Phase.CP4, (Begin, Announce)),
    (Phase.CP4, Event.FALL): (Phase.CP0, (GiveUp, Announce)),
}
ONWARD = {
    Phase.CP0: Event.PRESENT,
    Phase.CP1: Event.ANSWERED,
    Phase.CP2: Event.AGREED,
    Phase.CP3: Event.READY,
}


class BusMaster:
    """One master of the bus.

    Parameters
    ----------
    identity
        What the master rests on; everybody has to rest on the same.
    locate
        Takes over where the motor shafts [rad] stand; returns why that is no place of the robot.
    draw
        Returns a new session.
    drives
        Names of the drives on its bus.

    Attributes
    ----------
    names
        Of those who take part.
    phase, session
        Of the bus.
    cyclic
        Whether the bus is in cyclic operation.
    waiting
        What the present phase waits for, if it waits.
    missing
        Names of the participants that it waits for.

    """

    def __init__(
        self,
        identity: Identity,
        locate: Callable[[Sequence[float]], Reason | None],
        draw: Callable[[], bytes] = new_session,
        drives: Sequence[str] = DRIVES,
    ) -> None:
        self._identity, self._locate, self._draw = identity, locate, draw
        self._drives, self.names = drives, (*drives, PLANT)
        self._participants = Participants(self.names)
        self.phase = Phase.CP0
        self.cyclic = False
        self.waiting: Reason | None = None
        self.missing: tuple[str, ...] = ()
        self._call()

    def _call(self) -> None:
        """Call everybody anew: whoever answered before has to do so again."""
        self.session = self._draw()
        self._participants.begin(self.session.decode())
        self._resting: dict[int, float] = {}  # shaft positions [rad] that the drives have answered with
        self._looks = self._looks_in_vain = 0

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs that the plant answers for."""
        return self._participants.inputs

    @property
    def belts(self) -> str:
        """What the plant tells of its belts."""
        return self._participants.belts

    def closed(self) -> Reason | None:
        """Say why nothing that needs cyclic operation can be done, None if it can."""
        return None if self.cyclic else Reason(Code.BUS, f'the bus is in {self.phase.name}')

    def channel_closed(self) -> Reason | None:
        """Say why the service channels are closed, None from CP3 on."""
        return None if self.phase >= Phase.CP3 else self.closed()

    # start-up ---------------------------------------------------------------------------------------------------------

    def look(self, next_cycle: int, doubled: Reason | None, ready: bool) -> list[Action]:
        """Look at the start-up, which goes on if it can.

        Parameters
        ----------
        next_cycle
            First bus cycle that has not been started yet.
        doubled
            Who writes what only one may write, if somebody does.
        ready
            Whether cyclic operation may begin.

        """
        actions: list[Action] = []
        self.missing = ()
        if self._looks % CALL_EVERY == 0:
            # a participant does not obey while the last master may still be there
            actions.append(Announce(self.phase, self.session, next_cycle, entered=False))
        self._looks += 1
        if self.cyclic:
            return actions
        disagreement = self._disagreement()
        if self.phase != Phase.CP0 and disagreement is None:
            actions.append(Greet(self.phase, self.session))
        if disagreement is not None:
            return [*actions, Note(disagreement)]
        waiting = self._obstacle(doubled)
        if waiting != self.waiting:
            self.waiting = waiting
            if waiting is not None:
                actions.append(Wait(waiting))
        if waiting is not None:
            self._looks_in_vain += 1
        elif self.phase == Phase.CP2 and (nowhere := self._locate(self._shafts())):
            actions.append(Note(RobotFault(FaultCode.PLACE, nowhere.sentence)))
        elif ready or self.phase != Phase.CP3:
            actions += self._take(ONWARD[self.phase], next_cycle)
        return actions

    def _shafts(self) -> list[float]:
        """Return where the motor shafts stand [rad], in the order of the drives."""
        return [self._resting[n] for n in range(len(self._drives))]

    def _disagreement(self) -> RobotFault | None:
        """Say who rests on something else than the master, which matters from CP2 on."""
        if self.phase < Phase.CP2:
            return None
        present = {name: self._participants.identities[name] for name in self.names}
        sentences = disagreements(self._identity, present)
        return RobotFault(FaultCode.PARAMETERS, '; '.join(sentences)) if sentences else None

    def _obstacle(self, doubled: Reason | None) -> Reason | None:
        """Say what the present phase waits for."""
        if self.phase == Phase.CP0:
            if doubled is not None:
                return Reason(Code.BUS, f'waiting until one of them ends: {doubled}')
            self.missing = tuple(missing(self._participants.identities, self.names))
            return Reason(Code.BUS, f'waiting for {", ".join(self.missing)}') if self.missing else None
        if self.phase == Phase.CP1:
            self.missing = silent = tuple(
                axis for index, axis in enumerate(self._drives) if index not in self._resting
            )
            # a drive answers with the shaft position that the plant tells it
            doubtful = len(silent) == len(self._drives) and self._looks_in_vain > PATIENCE
            doubt = ': is the plant running?' if doubtful else ''
            return (
                Reason(Code.BUS, f'waiting for an answer of {", ".join(silent)}{doubt}') if silent else None
            )
        if self.phase == Phase.CP2:
            linked = self._participants.links[PLANT]
            self.missing = unlinked = tuple(axis for axis in self._drives if axis not in linked)
            return (
                Reason(Code.BUS, f'waiting for the plant to hear {", ".join(unlinked)}') if unlinked else None
            )
        return None

    def positioned(self, index: int, position: float) -> None:
        """Take the answer of a drive to a greeting: where its motor shaft stands [rad]."""
        if not self.cyclic:
            self._resting[index] = position

    def announced(self, announcement: Announcement, next_cycle: int, answered: int) -> list[Action]:
        """Take the announcement of a participant, up to whose coming some bus cycles have been answered."""
        if not self._participants.announced(announcement):
            return []
        name = announcement.name
        sentence = f'{name} was started again, or has left the bus, in bus cycle {answered}'
        fault = RobotFault(FaultCode.PARTICIPANT_LEFT, sentence, name, cycle=answered)
        return self.fall(fault, next_cycle) if name == PLANT else [StopRobot(fault)]

    # cyclic operation -------------------------------------------------------------------------------------------------

    def fall(self, fault: RobotFault, next_cycle: int) -> list[Action]:
        """Let the phase fall to CP0, from where the bus comes up again as soon as everybody is there."""
        return self._take(Event.FALL, next_cycle, fault) if self.cyclic else [Note(fault)]

    def missed(
        self,
        silent: Sequence[int],
        silence_s: float,
        ahead: int,
        next_cycle: int,
        answered: int,
        of_plant: str = 'the inputs',
    ) -> list[Action]:
        """Look after drives that do not answer.

        Parameters
        ----------
        silent
            Drives whose answers of the cycle ``answered`` are awaited; none: it is the plant.
        of_plant
            What is awaited of the plant then.
        silence_s
            How long no cycle has been complete [s].
        ahead
            By how many cycles the foremost drive has answered more.
        next_cycle, answered
            First bus cycles that are not started, and not complete.

        """
        names = ', '.join(self._drives[index] for index in silent) or of_plant
        sentence = f'no AT of {names} for {silence_s:.1f} s in bus cycle {answered} ({NO_ANSWER})'
        fault = RobotFault(FaultCode.ANSWER_LOST, sentence, names, NO_ANSWER, answered)
        if silence_s > ANSWER_SILENT_S and ahead > AHEAD and silent:
            return [Drop(index, fault) for index in silent]
        if silence_s > BUS_SILENT_S:
            # where nobody can go on, or nobody may, the plant is as good a guess as the drives
            guess, source = f'{sentence}: is the plant running?', ', '.join((names, PLANT))
            return self.fall(replace(fault, sentence=guess, source=source), next_cycle)
        return []

    def _take(self, event: Event, next_cycle: int, fault: RobotFault | None = None) -> list[Action]:
        """Let an event happen, which has a row in the present phase; return what it brings about."""
        self.phase, acts = TRANSITIONS[self.phase, event]
        self.cyclic = self.phase == Phase.CP4
        self._looks_in_vain = 0
        # bus time never goes back
        first = next_cycle if event is Event.FALL else max(next_cycle, self._participants.bus_cycle)
        if event is Event.FALL:
            self._call()
        if event is Event.READY:
            self._participants.close()
        start = first if event is Event.READY else next_cycle
        values: dict[type[Action], Action] = {
            Announce: Announce(self.phase, self.session, start, entered=True),
            Stand: Stand(first),
            Begin: Begin(first),
        }
        if fault is not None:
            values[GiveUp] = GiveUp(fault, self.session)
        return [values[act] for act in acts]
