"""Messages between planner, transformation task and operators other than cyclic telegrams.

Each message that can move the robot carries the bus session and a number of its sender, so that repeated messages, for
example from a recording, are recognized as outdated.
"""

import json
from dataclasses import dataclass
from typing import Self, TypeVar

from delta3_pacdrive.configuration.json_message import JsonMessage, checked
from delta3_pacdrive.errors import Code, Reason, RobotFault, TelegramError, shown
from delta3_pacdrive.planning.program.adaptation import Adaptation

TEXT_MAX = 100  # characters of a name
SENDERS_MAX = 64  # senders with a stored newest number

Value = TypeVar('Value')


@dataclass(frozen=True, kw_only=True)
class _Refusing(JsonMessage):
    """A message that can contain a rejection, with the fields of its fault as in ``RobotFault.facts``."""

    fault_code: str = ''
    fault_number: int = 0
    fault_source: str = ''
    fault_cycle: int = 0

    def _reason(self, code: str, sentence: str) -> Reason:
        return Reason(Code.of(code), sentence, RobotFault.of(vars(self), sentence))


@dataclass(frozen=True)
class Status(_Refusing):
    """Status of the transformation task for the planner, ``motion/status``; only the newest counts."""

    session: str  # of the bus
    previous: str  # session before of the same master, empty in its first one
    serial: int  # number of the message in this session
    planner: str  # identity of the active planner, empty without one
    state: str  # of the motion: idle, moving, steered, stopping, stopped, error
    phase: str  # of the bus
    refusal: str  # why an order would be rejected now, empty if it would be accepted
    refusal_code: str
    located: int  # number of times the robot was located, 0 if not yet
    tcp_m: tuple[float, float, float]  # when located
    control: int  # number of changes of control
    operator: str  # identity of the operator in control, empty without one
    operator_name: str
    losses: int  # number of times control was taken over or timed out
    order: int  # number of the newest accepted order of this planner, 0 without one
    checked: int  # messages of the present plan that have been checked
    cycle: int  # next bus cycle
    # angle of each rotary axis when located, if present
    turn_rad: float | None = None
    turn_rad_2: float | None = None

    @property
    def turns_rad(self) -> tuple[float, ...]:
        """Angles of the rotary axes when located."""
        return tuple(angle for angle in (self.turn_rad, self.turn_rad_2) if angle is not None)

    @property
    def reason(self) -> Reason | None:
        """Why an order would be rejected now, None if it would be accepted."""
        return self._reason(self.refusal_code, self.refusal) if self.refusal else None


@dataclass(frozen=True)
class Verdict(JsonMessage):
    """Outcome of an order or of a change of motion profile, ``motion/verdict``."""

    session: str
    planner: str
    number: int
    accepted: bool
    code: str
    sentence: str


@dataclass(frozen=True)
class Request(JsonMessage):
    """A request of an operator."""

    receiver: (
        str  # identity of the planner or session of the bus, so that requests in a recording are ignored
    )
    operator: str  # identity, empty for a client without one
    number: int  # among the requests of this operator; repeated in the reply
    control: int  # changes of control known to the operator; the receiver waits until it knows as many
    action: str
    text: str = ''  # argument of the action: a program, a percentage, a name
    caps: tuple[float, float, float] = (
        0.0,
        0.0,
        0.0,
    )  # speed, acceleration and jerk limits [SI], 0: no limit
    first: int = 0  # first statement of the program to execute
    approach_m_s: float = 0.0  # speed of the approach to the start of the program, 0: no approach

    @classmethod
    def from_fields(cls, values: object) -> Self:
        """Build the request from values by key; raises TelegramError."""
        request = super().from_fields(values)
        if len(request.operator) > TEXT_MAX:
            raise TelegramError(
                f'operator of a request has {len(request.operator)} characters, the limit is {TEXT_MAX}'
            )
        if min(*request.caps, request.approach_m_s) < 0.0:
            raise TelegramError('caps and approach_m_s of a request must be numbers from 0 on')
        return request

    @property
    def adaptation(self) -> Adaptation:
        """Requested changes to the program."""
        return Adaptation(self.caps, self.first, self.approach_m_s)

    @property
    def identity(self) -> str:
        """Unique identity of the request in ``unit_robot/requests``."""
        return f'{self.operator or self.receiver}-{self.number}'


@dataclass(frozen=True)
class RequestReport(JsonMessage):
    """Progress of a request for moves, ``unit_robot/requests``."""

    id: str  # Request.identity
    state: str  # planning, queued, running, done, refused, or aborted
    statements: int
    remaining: int  # statements not yet executed; of a repeated program those of one round
    code: str  # of the rejection or abort, empty otherwise
    sentence: str


@dataclass(frozen=True)
class Reply(_Refusing):
    """Reply to a request; while ``done`` is False the request is in progress, as described by ``sentence``."""

    operator: str
    number: int
    done: bool
    accepted: bool
    code: str
    sentence: str
    control: int = 0

    @property
    def reason(self) -> Reason | None:
        """Why the request was rejected, None if it was accepted."""
        return None if self.accepted else self._reason(self.code, self.sentence)


@dataclass(frozen=True)
class QueueReport(JsonMessage):
    """Queue of a planner, ``unit_robot/queue``."""

    identity: str  # of the planner
    moves: int
    duration_s: float  # 0 until the moves are planned
    override: float  # 1 = as planned
    working: str  # description of the planning job, empty without one
    refusal: str = ''  # of the newest request, empty if it was accepted
    refusal_code: str = ''


def refuse_malformed(text: str, sentence: str) -> Reply | None:
    """Return the rejection of a malformed request; None if its operator and number cannot be read."""
    try:
        values = json.loads(text)
        operator, number = values['operator'], values['number']
        checked(operator, str, 'operator')
        checked(number, int, 'number')
    except (ValueError, RecursionError, TypeError, KeyError, TelegramError):
        return None
    return _rejection(operator, number, Code.CONTENT, sentence) if len(operator) <= TEXT_MAX else None


def refuse_recording(request: Request) -> Reply:
    """Return the rejection of a request to another receiver."""
    sentence = (
        f'the request was made to {shown(request.receiver)}, which is no longer active; is it a recording?'
    )
    return _rejection(request.operator, request.number, Code.FOREIGN, sentence)


def _rejection(operator: str, number: int, code: Code, sentence: str) -> Reply:
    return Reply(operator, number, done=True, accepted=False, code=str(code), sentence=sentence)


@dataclass(frozen=True)
class Origin:
    """Label of a row on ``motion/plan`` or ``motion/change``."""

    kind: str  # ORDER, EXACT, SMOOTHED, REPLACEMENT, EXTEND, FAULT, REVOKE, PROFILE, OVERRIDE, or the kind of a move
    planner: str  # identity of the sender
    session: str  # of the bus
    number: int  # of the order or change, counted by the planner

    def label(self) -> str:
        """Return the text of the label."""
        return f'{self.kind} {self.planner} {self.session} {self.number}'

    @staticmethod
    def from_label(label: str) -> 'Origin':
        """Parse the output of ``label``; raises TelegramError."""
        words = label.split(' ') if len(label) <= TEXT_MAX else []
        if len(words) != 4 or not words[3].isdecimal() or len(words[3]) > 15:
            raise TelegramError(f'{shown(label)} is not a label "KIND planner session number"')
        return Origin(words[0], words[1], words[2], int(words[3]))


ORDER, EXTEND, FAULT, REVOKE, PROFILE = 'ORDER', 'EXTEND', 'FAULT', 'REVOKE', 'COURSE'
EXACT = 'EXACT'  # an order that starts in its bus cycle or is rejected
SMOOTHED = 'SMOOTHED'  # an order of a plan that may jump: the robot follows it within its limits
REPLACEMENT = 'REPLACEMENT'  # such an order that begins in its bus cycle instead of the running plan
ORDERS = (ORDER, EXACT, SMOOTHED, REPLACEMENT)
LAST = (*ORDERS, EXTEND)  # rows that end a plan
OVERRIDE = 'OVERRIDE'  # override of the planner, for a steered robot
ACCEPTED = ''  # code of an acceptance
# requests of operators to the transformation task
TAKE, TAKE_OVER, RELEASE = 'take control', 'take control over', 'release control'
ENABLE, DISABLE, RESET = 'enable', 'disable', 'reset'
STEER, END_STEERING = 'steer', 'end steering'
HOLD, ABORT, EMERGENCY_STOP = 'hold', 'abort', 'emergency stop'
# stops by the names of their services; available to everyone, regardless of control
STOPS = {action.replace(' ', '_'): action for action in (HOLD, ABORT, EMERGENCY_STOP, DISABLE)}


def verdict_of(origin: Origin, code: Code | str, sentence: str) -> Verdict:
    """Return the verdict on an order; an empty code means acceptance."""
    return Verdict(
        origin.session, origin.planner, origin.number, accepted=not code, code=str(code), sentence=sentence
    )


class Recent(dict[str, Value]):
    """Values by sender, limited in number; the sender updated least recently is removed first."""

    def __init__(self, senders_max: int) -> None:
        super().__init__()
        self._senders_max = senders_max

    def note(self, sender: str, value: Value) -> None:
        """Store the newest value of a sender."""
        self.pop(sender, None)
        self[sender] = value
        if len(self) > self._senders_max:
            del self[next(iter(self))]


class Numbering:
    """Numbered messages of senders; each number counts once and must increase."""

    def __init__(self, senders_max: int = SENDERS_MAX) -> None:
        self._newest: Recent[int] = Recent(senders_max)

    def is_new(self, sender: str, number: int) -> bool:
        """Record a number; return False if this or a later one was received before."""
        newest = self._newest.get(sender, -1)
        self._newest.note(sender, max(newest, number))
        return number > newest
