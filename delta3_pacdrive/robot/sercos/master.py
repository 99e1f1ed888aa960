"""State machine of the bus master: phase-up from CP0 to CP4, fall-back on faults, and renewed phase-up.

Polls, announcements and ATs are events; the machine returns actions in order. A phase ends when all its conditions are
met; ``TRANSITIONS`` lists successors and actions.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto

from delta3_pacdrive.errors import Code, FaultCode, Reason, RobotFault
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES, PLANT, Identity, disagreements, missing
from delta3_pacdrive.robot.sercos.losses import NO_ANSWER
from delta3_pacdrive.robot.sercos.participants import Announcement, Participants
from delta3_pacdrive.robot.sercos.telegrams import new_session
from delta3_pacdrive.robot.sercos.watchdog import ANSWER_SILENT_S, BUS_SILENT_S
from delta3_pacdrive.robot.sercos.words import Phase

PATIENCE = 50  # unsuccessful polls before the message suggests a cause
CALL_EVERY = 10  # polls between repeated announcements of the phase
AHEAD = 2  # cycles by which the other drives are ahead of a drive considered lost


class Event(Enum):
    """Events of the bus."""

    PRESENT = auto()  # all participants have announced themselves, each once
    ANSWERED = auto()  # all drives have answered a greeting
    # parameters agree, participants receive from one another, and the robot pose is known
    AGREED = auto()
    READY = auto()  # cyclic operation may begin
    FALL = auto()  # cyclic operation cannot continue


@dataclass(frozen=True)
class Announce:
    """Announce the phase with the bus time at which cyclic operation begins, and whether the phase is entered now."""

    phase: Phase
    session: bytes
    cycle: int
    entered: bool


@dataclass(frozen=True)
class Greet:
    """Send a greeting to all drives: an MDT outside cyclic operation."""

    phase: Phase
    session: bytes


@dataclass(frozen=True)
class Check:
    """Execute the transition check of a drive for the phase after this one, a procedure command."""

    index: int
    phase: Phase


@dataclass(frozen=True)
class RobotReady:
    """The robot is ready for a program from a bus cycle on."""

    cycle: int


@dataclass(frozen=True)
class Begin:
    """Start cyclic operation at a bus cycle."""

    cycle: int


@dataclass(frozen=True)
class AbortCyclic:
    """Abort everything that requires cyclic operation, because of a fault, and start a new session."""

    fault: RobotFault
    session: bytes


@dataclass(frozen=True)
class Note:
    """Record a fault."""

    fault: RobotFault


@dataclass(frozen=True)
class StopRobot:
    """Stop the robot for a fault that leaves the bus in operation."""

    fault: RobotFault


@dataclass(frozen=True)
class Drop:
    """Continue cyclic operation without a drive."""

    index: int
    fault: RobotFault


@dataclass(frozen=True)
class Wait:
    """Publish a changed reason for waiting in the current phase."""

    reason: Reason


Action = Announce | Greet | Check | RobotReady | Begin | AbortCyclic | Note | StopRobot | Drop | Wait

TRANSITIONS: dict[tuple[Phase, Event], tuple[Phase, tuple[type[Action], ...]]] = {
    (Phase.CP0, Event.PRESENT): (Phase.CP1, (Announce,)),
    (Phase.CP1, Event.ANSWERED): (Phase.CP2, (Announce,)),
    (Phase.CP2, Event.AGREED): (Phase.CP3, (Announce, RobotReady)),
    (Phase.CP3, Event.READY): (Phase.CP4, (Begin, Announce)),
    (Phase.CP4, Event.FALL): (Phase.CP0, (AbortCyclic, Announce)),
}
ONWARD = {
    Phase.CP0: Event.PRESENT,
    Phase.CP1: Event.ANSWERED,
    Phase.CP2: Event.AGREED,
    Phase.CP3: Event.READY,
}


class BusMaster:
    """State machine of the bus master.

    Parameters
    ----------
    identity
        Settings of the master; all participants must agree with them.
    locate
        Takes the motor shaft positions [rad]; returns the reason if they are not a valid robot pose.
    checks
        Whether CP2 and CP3 end with a successful transition check of each drive (S-0-0127, S-0-0128).

    Attributes
    ----------
    waiting
        Reason for waiting in the current phase, if any.
    missing
        Participants that the current phase is waiting for.

    """

    def __init__(
        self,
        identity: Identity,
        locate: Callable[[Sequence[float]], Reason | None],
        draw: Callable[[], bytes] = new_session,
        drives: Sequence[str] = DRIVES,
        checks: bool = False,
    ) -> None:
        self._identity, self._locate, self._draw, self._checks = identity, locate, draw, checks
        self._drives, self.names = drives, (*drives, PLANT)
        self._participants = Participants(self.names)
        self.phase = Phase.CP0
        self.cyclic = False
        self.waiting: Reason | None = None
        self.missing: tuple[str, ...] = ()
        self._call()

    def _call(self) -> None:
        """Start a new session, in which all participants must announce themselves again."""
        self.session = self._draw()
        self._participants.begin(self.session.decode())
        self._resting: dict[int, float] = {}  # shaft positions [rad] from answers to greetings
        self._looks = self._looks_in_vain = 0
        self._asked: set[tuple[Phase, int]] = (
            set()
        )  # transition checks in progress or done, by phase and drive
        self._checked: set[tuple[Phase, int]] = set()

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs announced by the plant."""
        return self._participants.inputs

    @property
    def belts(self) -> str:
        """Belt description announced by the plant (JSON)."""
        return self._participants.belts

    def closed(self) -> Reason | None:
        """Return the reason why cyclic operation is unavailable, None if it is active."""
        return None if self.cyclic else Reason(Code.BUS, f'the bus is in {self.phase.name}')

    def channel_closed(self) -> Reason | None:
        """Return the reason why the service channels are closed, None from CP3 on."""
        return None if self.phase >= Phase.CP3 else self.closed()

    # start-up ---------------------------------------------------------------------------------------------------------

    def poll(self, next_cycle: int, doubled: Reason | None, ready: bool) -> list[Action]:
        """Advance the start-up if the conditions of the phase are met.

        Parameters
        ----------
        next_cycle
            First bus cycle that has not been started.
        doubled
            Reason naming duplicate writers of a topic, if any.
        ready
            Whether cyclic operation may begin.

        """
        actions: list[Action] = []
        self.missing = ()
        if self._looks % CALL_EVERY == 0:
            # repeated, because a participant ignores a new master while the last one may still be running
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
        if (
            waiting is None
            and self._checks
            and (self.phase is Phase.CP2 or (ready and self.phase is Phase.CP3))
        ):
            waiting = self._unchecked(actions)
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
        """Return the motor shaft positions [rad] in the order of the drives."""
        return [self._resting[n] for n in range(len(self._drives))]

    def _disagreement(self) -> RobotFault | None:
        """Return a fault if participants have other settings than the master, from CP2 on."""
        if self.phase < Phase.CP2:
            return None
        present = {name: self._participants.identities[name] for name in self.names}
        sentences = disagreements(self._identity, present)
        return RobotFault(FaultCode.PARAMETERS, '; '.join(sentences)) if sentences else None

    def _obstacle(self, doubled: Reason | None) -> Reason | None:
        """Return what the current phase is waiting for."""
        if self.phase == Phase.CP0:
            if doubled is not None:
                return Reason(Code.BUS, f'waiting until one of them ends: {doubled}')
            self.missing = tuple(missing(self._participants.identities, self.names))
            return Reason(Code.BUS, f'waiting for {", ".join(self.missing)}') if self.missing else None
        if self.phase == Phase.CP1:
            self.missing = silent = tuple(
                axis for index, axis in enumerate(self._drives) if index not in self._resting
            )
            # drives answer with shaft positions from the plant
            doubtful = len(silent) == len(self._drives) and self._looks_in_vain > PATIENCE
            doubt = ': is the plant running?' if doubtful else ''
            return (
                Reason(Code.BUS, f'waiting for an answer of {", ".join(silent)}{doubt}') if silent else None
            )
        if self.phase == Phase.CP2:
            linked = self._participants.links[PLANT]
            self.missing = unlinked = tuple(axis for axis in self._drives if axis not in linked)
            return (
                Reason(Code.BUS, f'waiting for the plant to receive from {", ".join(unlinked)}')
                if unlinked
                else None
            )
        return None

    def _unchecked(self, actions: list[Action]) -> Reason | None:
        """Return that drives have not passed the transition check of this phase; add those to ask to the actions."""
        unchecked = [n for n in range(len(self._drives)) if (self.phase, n) not in self._checked]
        if not unchecked:
            return None
        for index in unchecked:
            if (self.phase, index) not in self._asked:
                self._asked.add((self.phase, index))
                actions.append(Check(index, self.phase))
        names = ', '.join(self._drives[index] for index in unchecked)
        return Reason(Code.BUS, f'waiting for the transition check of {names}')

    def transition_checked(self, index: int, phase: Phase, refusal: str) -> list[Action]:
        """Process the result of a transition check of a phase; a check with a ``refusal`` is repeated."""
        if phase is not self.phase:
            return []
        if refusal:
            self._asked.discard((phase, index))
            return [Note(RobotFault(FaultCode.PARAMETERS, f'{self._drives[index]}: {refusal}'))]
        self._checked.add((phase, index))
        return []

    def positioned(self, index: int, position: float) -> None:
        """Store the shaft position [rad] from a drive's answer to a greeting."""
        if not self.cyclic:
            self._resting[index] = position

    def announced(self, announcement: Announcement, next_cycle: int, answered: int) -> list[Action]:
        """Process an announcement; bus cycles before ``answered`` are complete."""
        if not self._participants.announced(announcement):
            return []
        name = announcement.name
        sentence = f'{name} restarted or left the bus in bus cycle {answered}'
        fault = RobotFault(FaultCode.PARTICIPANT_LEFT, sentence, name, cycle=answered)
        return self.fall(fault, next_cycle) if name == PLANT else [StopRobot(fault)]

    # cyclic operation -------------------------------------------------------------------------------------------------

    def fall(self, fault: RobotFault, next_cycle: int) -> list[Action]:
        """Fall back to CP0; the bus phases up again when all participants are present."""
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
        """React to drives or a plant that do not respond.

        Parameters
        ----------
        silent
            Drives whose ATs of the cycle ``answered`` are outstanding; empty: the plant's data are.
        of_plant
            Name of the plant's outstanding data.
        silence_s
            Time since the last complete cycle [s].
        ahead
            Lead of the foremost drive [cycles].
        next_cycle, answered
            First bus cycles that are not started, and not complete.

        """
        names = ', '.join(self._drives[index] for index in silent) or of_plant
        sentence = f'no AT of {names} for {silence_s:.1f} s in bus cycle {answered} ({NO_ANSWER})'
        fault = RobotFault(FaultCode.ANSWER_LOST, sentence, names, NO_ANSWER, answered)
        if silence_s > ANSWER_SILENT_S and ahead > AHEAD and silent:
            return [Drop(index, fault) for index in silent]
        if silence_s > BUS_SILENT_S:
            # if all are missing, the plant is as likely a cause as the drives
            guess, source = f'{sentence}: is the plant running?', ', '.join((names, PLANT))
            return self.fall(replace(fault, sentence=guess, source=source), next_cycle)
        return []

    def _take(self, event: Event, next_cycle: int, fault: RobotFault | None = None) -> list[Action]:
        """Execute the transition of an event in the current phase; return its actions."""
        self.phase, acts = TRANSITIONS[self.phase, event]
        self.cyclic = self.phase == Phase.CP4
        self._looks_in_vain = 0
        # bus time never decreases
        first = next_cycle if event is Event.FALL else max(next_cycle, self._participants.bus_cycle)
        if event is Event.FALL:
            self._call()
        if event is Event.READY:
            self._participants.close()
        start = first if event is Event.READY else next_cycle
        values: dict[type[Action], Action] = {
            Announce: Announce(self.phase, self.session, start, entered=True),
            RobotReady: RobotReady(first),
            Begin: Begin(first),
        }
        if fault is not None:
            values[AbortCyclic] = AbortCyclic(fault, self.session)
        return [values[act] for act in acts]
