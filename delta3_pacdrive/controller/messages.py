"""What planner, transformation task and operators say to each other besides cyclic telegrams, as values.

Everything that can move the robot says to which session of the bus it belongs and which of its sender's orders or
requests it is, so that what is received a second time, out of a recording for example, is known to be old.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, Self, TypeVar, get_args, get_type_hints

from delta3_pacdrive.errors import Code, Reason, RobotFault, TelegramError, shown
from delta3_pacdrive.motion.adaptation import Adaptation

TEXT_MAX = 100  # characters of a name
SENDERS_MAX = 64  # who are remembered
COUNT_MAX = 2**53  # beyond it numbers in JSON are not exact

Value = TypeVar('Value')


@dataclass(frozen=True)
class _Message:
    """A message that is written as a JSON object: its fields of their types, without those that are None."""

    def to_json(self) -> str:
        """Return the text of the message."""
        return json.dumps({name: value for name, value in asdict(self).items() if value is not None})

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Read back what ``to_json`` wrote; raises TelegramError."""
        try:
            values = json.loads(text)
        except (ValueError, RecursionError):
            raise TelegramError(f'{shown(text)} is no {cls.__name__.lower()}') from None
        kinds = get_type_hints(cls)
        needed = [f.name for f in fields(cls) if f.default is not None]
        told = set(values) if isinstance(values, Mapping) else set()
        names = [f.name for f in fields(cls) if f.name in needed or f.name in told]
        if told != set(names):
            raise TelegramError(f'a {cls.__name__.lower()} must have the keys {", ".join(needed)}')
        for name in names:
            _require(values[name], kinds[name], f'{name} of a {cls.__name__.lower()}')
        return cls(**{name: _tupled(values[name]) for name in names})


def _tupled(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _require(value: Any, kind: Any, what: str) -> None:
    """Refuse a value of another type than its field's; raises TelegramError."""
    numbers = get_args(kind)
    if type(None) in numbers:
        kind, numbers = numbers[0], ()
    if numbers:
        if not isinstance(value, list) or len(value) != len(numbers):
            raise TelegramError(f'{what} must be a list of {len(numbers)} numbers, not {shown(value)}')
        for number in value:
            _require(number, float, what)
        return
    accepted = (int, float) if kind is float else str if issubclass(kind, str) else kind
    if not isinstance(value, accepted) or (isinstance(value, bool) and kind is not bool):
        raise TelegramError(f'{what} is {shown(value)}, but must be of type {kind.__name__}')
    if isinstance(value, (int, float)) and not abs(value) < COUNT_MAX:
        raise TelegramError(f'{what} is {shown(value)}, which is out of range')


@dataclass(frozen=True, kw_only=True)
class _Refusing(_Message):
    """A message that may refuse tells the fault that it refuses because of, as ``RobotFault.facts`` does."""

    fault_code: str = ''
    fault_number: int = 0
    fault_source: str = ''
    fault_cycle: int = 0

    def _reason(self, code: str, sentence: str) -> Reason:
        return Reason(Code.of(code), sentence, RobotFault.of(vars(self), sentence))


@dataclass(frozen=True)
class Status(_Refusing):
    """What the transformation task tells the planner, ``motion/status``; the newest counts.

    Attributes
    ----------
    session
        Of the bus.
    previous
        The session before, of the same master; empty in its first one.
    serial
        Number of the message in this session.
    planner
        Identity of the planner that the task listens to, empty while it hears none.
    state
        Of the motion: idle, moving, stopping, stopped, error.
    phase
        Of the bus.
    refusal
        Why no order would be taken now, as a sentence, and its code; empty if one would.
    located, tcp_m
        How often it was said where the robot stands ready for a program, and where that is; 0: not yet.
    control, operator
        How often control has changed hands, and who has it (his identity, empty: nobody).
    operator_name
        His name for people.
    losses
        How often somebody has lost control: taken over by another one, or silent.
    order
        Number of the newest order of this planner that was accepted; 0: none.
    checked
        Messages of the present plan that have been checked.
    cycle
        Next bus cycle.
    turn_rad
        Where its tool stands then, of a robot with a rotary axis.

    """

    session: str
    previous: str
    serial: int
    planner: str
    state: str
    phase: str
    refusal: str
    refusal_code: str
    located: int
    tcp_m: tuple[float, float, float]
    control: int
    operator: str
    operator_name: str
    losses: int
    order: int
    checked: int
    cycle: int
    turn_rad: float | None = None

    @property
    def reason(self) -> Reason | None:
        """Why no order would be taken now, None if one would."""
        return self._reason(self.refusal_code, self.refusal) if self.refusal else None


@dataclass(frozen=True)
class Verdict(_Message):
    """What became of an order or a change of motion profile of a planner, ``motion/verdict``."""

    session: str
    planner: str
    number: int
    accepted: bool
    code: str
    sentence: str


@dataclass(frozen=True)
class Request(_Message):
    """What an operator asks for.

    Attributes
    ----------
    receiver
        Who is meant: identity of the planner, or session of the bus; so that a recording asks for nothing.
    operator
        Identity of who asks, empty for a client that has none.
    number
        Of the request, among those of this operator; the reply carries the same.
    control
        Changes of control that the operator knows of; who is asked waits until he knows of as many.
    action
        What is to be done.
    text
        What belongs to it: a program, a percentage, a name; may be empty.
    caps
        Largest speed [m/s], acceleration [m/s^2] and jerk [m/s^3] of a program, whatever it says itself; 0: no cap.
    first
        Statement with which a program begins; those before are left out.
    approach_m_s
        How fast the robot goes to the start of a program before it; 0: it has to stand there.

    """

    receiver: str
    operator: str
    number: int
    control: int
    action: str
    text: str = ''
    caps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    first: int = 0
    approach_m_s: float = 0.0

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Read back what ``to_json`` wrote; raises TelegramError."""
        request = super().from_json(text)
        if len(request.operator) > TEXT_MAX:
            raise TelegramError(
                f'operator of a request has {len(request.operator)} characters, the limit is {TEXT_MAX}'
            )
        if min(*request.caps, request.approach_m_s) < 0.0:
            raise TelegramError('caps and approach_m_s of a request must be numbers from 0 on')
        return request

    @property
    def adaptation(self) -> Adaptation:
        """What is asked for otherwise than a program says."""
        return Adaptation(self.caps, self.first, self.approach_m_s)

    @property
    def identity(self) -> str:
        """What the request is known by in ``unit_robot/requests``; no other request has it."""
        return f'{self.operator or self.receiver}-{self.number}'


@dataclass(frozen=True)
class RequestReport(_Message):
    """What has become of a request for moves, ``unit_robot/requests``.

    Attributes
    ----------
    id
        Of the request.
    state
        planning, queued, running, done, refused, or aborted.
    statements, remaining
        Number of its statements, and of those that are still to be driven; of a repeated program those of a round.
    code, sentence
        Why it was refused or aborted; empty else.

    """

    id: str
    state: str
    statements: int
    remaining: int
    code: str
    sentence: str


@dataclass(frozen=True)
class Reply(_Refusing):
    """What became of a request; ``done`` is False while it is still being worked on, and the sentence says how far."""

    operator: str
    number: int
    done: bool
    accepted: bool
    code: str
    sentence: str
    control: int = 0

    @property
    def reason(self) -> Reason | None:
        """Why the request was refused, None if it was not."""
        return None if self.accepted else self._reason(self.code, self.sentence)


@dataclass(frozen=True)
class QueueReport(_Message):
    """What is in the queue of a planner, ``unit_robot/queue``.

    Attributes
    ----------
    identity
        Of the planner.
    moves, duration_s
        Number of moves, and how long they take, 0 while they are not planned.
    override
        Override, 1 = as planned.
    working
        What is being planned, empty if nothing is.
    refusal, refusal_code
        Why the newest request was refused, as a sentence, and its code; empty if it was not.

    """

    identity: str
    moves: int
    duration_s: float
    override: float
    working: str
    refusal: str = ''
    refusal_code: str = ''


def refuse_malformed(text: str, sentence: str) -> Reply | None:
    """Return the refusal of a text that is not a request; None if its operator and number cannot be read."""
    try:
        values = json.loads(text)
        operator, number = values['operator'], values['number']
        _require(operator, str, 'operator')
        _require(number, int, 'number')
    except (ValueError, RecursionError, TypeError, KeyError, TelegramError):
        return None
    return (
        Reply(operator, number, True, False, str(Code.CONTENT), sentence)
        if len(operator) <= TEXT_MAX
        else None
    )


def refuse_recording(request: Request) -> Reply:
    """Return the refusal of a request that was meant for somebody else."""
    sentence = (
        f'the request was made to {shown(request.receiver)}, which is not here any more; is it a recording?'
    )
    return Reply(request.operator, request.number, True, False, str(Code.FOREIGN), sentence)


@dataclass(frozen=True)
class Origin:
    """Where a row of numbers on ``motion/plan`` or ``motion/change`` comes from: its label.

    Attributes
    ----------
    kind
        What the row is: ``ORDER``, ``EXACT``, ``EXTEND``, ``FAULT``, ``REVOKE``, ``PROFILE``, or the kind of a move.
    planner
        Identity of its sender.
    session
        Of the bus that it is meant for.
    number
        Of the order or change that it belongs to, counted by the planner.

    """

    kind: str
    planner: str
    session: str
    number: int

    def label(self) -> str:
        """Return the text of the label."""
        return f'{self.kind} {self.planner} {self.session} {self.number}'

    @staticmethod
    def from_label(label: str) -> 'Origin':
        """Read back what ``label`` wrote; raises TelegramError."""
        words = label.split(' ') if len(label) <= TEXT_MAX else []
        if len(words) != 4 or not words[3].isdecimal() or len(words[3]) > 15:
            raise TelegramError(f'{shown(label)} is no label "KIND planner session number"')
        return Origin(words[0], words[1], words[2], int(words[3]))


ORDER, EXTEND, FAULT, REVOKE, PROFILE = 'ORDER', 'EXTEND', 'FAULT', 'REVOKE', 'COURSE'
EXACT = 'EXACT'  # an order that begins in its bus cycle, or not at all
ORDERS = (ORDER, EXACT)
LAST = (*ORDERS, EXTEND)  # rows that end a plan
ACCEPTED = ''  # code of what is not refused
# what operators ask of the transformation task
TAKE, TAKE_OVER, RELEASE = 'take control', 'take control over', 'release control'
ENABLE, DISABLE, RESET = 'enable', 'disable', 'reset'
HOLD, ABORT, EMERGENCY_STOP = 'hold', 'abort', 'emergency stop'
# by the names of their services: free for all, whoever has control
STOPS = {action.replace(' ', '_'): action for action in (HOLD, ABORT, EMERGENCY_STOP, DISABLE)}


def verdict_of(origin: Origin, code: Code | str, sentence: str) -> Verdict:
    """Return the verdict on an order; an empty code accepts it."""
    return Verdict(origin.session, origin.planner, origin.number, not code, str(code), sentence)


class Recent(dict[str, Value]):
    """What is known of senders, of so many of them; the one noted least recently is forgotten first."""

    def __init__(self, senders_max: int) -> None:
        super().__init__()
        self._senders_max = senders_max

    def note(self, sender: str, value: Value) -> None:
        """Take note of the newest about a sender."""
        self.pop(sender, None)
        self[sender] = value
        if len(self) > self._senders_max:
            del self[next(iter(self))]


class Numbering:
    """Numbered messages of senders, each of which counts once, and only upwards."""

    def __init__(self, senders_max: int = SENDERS_MAX) -> None:
        self._newest: Recent[int] = Recent(senders_max)

    def is_new(self, sender: str, number: int) -> bool:
        """Take note of a number; False if this one or a later one was received before."""
        newest = self._newest.get(sender, -1)
        self._newest.note(sender, max(newest, number))
        return number > newest
