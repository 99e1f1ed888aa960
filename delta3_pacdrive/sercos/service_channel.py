"""Service channel of SERCOS: access to the operation data of a drive, a word of 16 bits a cycle beside the cyclic data.

An access is a message of the master and an answer of the drive, both cut into numbered portions of 12 bits. Whoever has
a message sends its portions in turn, over and over, until the other side shows that it has all of them: the drive by
answering, the master by its next access or by silence. A word that is lost comes again with the next turn, a word that
comes twice says nothing new, and whatever time the words need on the bus only adds to the access. One direction must
keep its order, as telegrams do; whether bits are right is checked by the telegrams' checksums, not here.

    =====  ==================  =======================================================================================
    bits   name                meaning
    =====  ==================  =======================================================================================
    15     MHS, AHS            handshake: changes from access to access; the drive answers with that of the access
    14-12  number of portion   1 to 7; 0: no portion
    11-0   portion             12 bits of the message, the most significant portion is number 1
    =====  ==================  =======================================================================================

    ==================  ==============================================================================================
    word                meaning
    ==================  ==============================================================================================
    0x0000              idle; also what a dead partner and an empty place in a telegram read as: says nothing
    0x0001 to 0x0FFF    opening of the channel with a number; the drive forgets the access under way and echoes the word
    0x1000 to 0x7FFF    portions of accesses with handshake 0
    0x8000 to 0x8FFF    not used
    0x9000 to 0xFFFF    portions of accesses with handshake 1
    ==================  ==============================================================================================

    =======  ============================  ============  ==========  ========================================
    message  bits 83 to 64                 bits 63 to 0  portions    sent
    =======  ============================  ============  ==========  ========================================
    access   operation 2, IDN 16, zeros 2  value         7, else 2   writing, else without the value
    answer   error 16, zeros 4             value         7, else 2   after reading, else without the value
    =======  ============================  ============  ==========  ========================================

A value is an IEEE 754 number of 64 bits, integers too. The channel is opened before the first access and after one that
got no answer, so that no word of a forgotten access is ever taken for one of the next. If a word needs one cycle in
either direction, reading and writing take 10 cycles, a command 5, an opening 2 more; further latency adds to each.

SERCOS II has the same word and the same handshake bits, but a control word beside it and a step by step exchange of the
elements of a data block (IEC 61491); name, unit, minimum and maximum are known on both sides here
(drive/operation_data.py), and only the IDN (element 1) and the operation data (element 7) travel.
"""

import math
import re
import struct
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from operator import index

from delta3_pacdrive.errors import ParameterError, TelegramError, shown

IDLE = 0
WAITING_MAX = 64  # accesses
ANSWER_CYCLES_MAX = 100  # cycles an access may take; PacDrive: about 10 ms

_HANDSHAKE = 1 << 15
_NUMBER_SHIFT = 12
_PORTION_BITS = 12
_PORTION_MASK = (1 << _PORTION_BITS) - 1
_PORTIONS = 7
_WITHOUT_VALUE = 2  # portions
_WORD_MAX = 0xFFFF
_IDN_MAX = 0xFFFF

_VALUE_BITS = 64
_IDN_SHIFT, _OPERATION_SHIFT, _ERROR_SHIFT = 66, 82, 68

_IDN_TEXT = re.compile('([SP])-([0-7])-([0-9]{4})')
_MANUFACTURER = 1 << 15
_NUMBER_MAX = 4095


class Operation(IntEnum):
    """What an access does."""

    READ = 1
    WRITE = 2
    COMMAND = 3  # procedure command, executed at once


class ServiceError(IntEnum):
    """Error numbers of the service channel (SERCOS interface, service channel error messages)."""

    NONE = 0x0000
    NOT_OPEN = 0x0001
    NO_IDN = 0x1001
    READ_ONLY = 0x7004
    WRITE_PROTECTED = 0x7005
    TOO_SMALL = 0x7006
    TOO_LARGE = 0x7007
    INVALID = 0x7008
    COMMAND_NOT_EXECUTABLE = 0x7012
    NO_COMMAND = 0x7013
    NO_ANSWER = 0x8002  # Rexroth: failure in the service channel, the drive cannot be accessed


_OPERATIONS = frozenset(int(operation) for operation in Operation)
_ERRORS = frozenset(int(error) for error in ServiceError)

ERROR_TEXTS = {
    ServiceError.NONE: 'no error',
    ServiceError.NOT_OPEN: 'the service channel is not open in this communication phase',
    ServiceError.NO_IDN: 'the drive has no such IDN',
    ServiceError.READ_ONLY: 'the operation data cannot be changed',
    ServiceError.WRITE_PROTECTED: 'the operation data is write-protected in this communication phase',
    ServiceError.TOO_SMALL: 'the value is smaller than the minimum',
    ServiceError.TOO_LARGE: 'the value is greater than the maximum',
    ServiceError.INVALID: 'the value is invalid',
    ServiceError.COMMAND_NOT_EXECUTABLE: 'the procedure command cannot be executed at this time',
    ServiceError.NO_COMMAND: 'the IDN is no procedure command',
    ServiceError.NO_ANSWER: 'the drive does not answer in the service channel',
}


@dataclass(frozen=True)
class Access:
    """What the controller asks of a drive.

    Attributes
    ----------
    idn
        Identification number in 16 bits: S-0-0104 is 104, P-0-0012 is 0x8000 | 12.
    value
        To be written, in the unit of the IDN; only writing carries it.

    """

    idn: int
    operation: Operation
    value: float = 0.0


@dataclass(frozen=True)
class Answer:
    """What became of an access.

    Attributes
    ----------
    value
        That was read or written, in the unit of the IDN; not a number after an error.

    """

    idn: int
    error: ServiceError = ServiceError.NONE
    value: float = math.nan

    @property
    def sentence(self) -> str:
        """Diagnostic message 8503 of a failed access (Schneider: with IDN and error number); empty without an error."""
        return message_8503(self.idn, self.error, ERROR_TEXTS[self.error]) if self.error else ''


def message_8503(idn: int, error: ServiceError, text: str) -> str:
    """Diagnostic message 8503, service channel error, in words."""
    return f'8503: {format_idn(idn)}: {text} (error 0x{error:04x})'


def parse_idn(text: str) -> int:
    """Return the 16 bits of an identification number such as S-0-0104 or P-0-0012.

    Raises
    ------
    ParameterError
        The text is no identification number.

    """
    match = _IDN_TEXT.fullmatch(text)
    if match is None or int(match[3]) > _NUMBER_MAX:
        raise ParameterError(
            f'{shown(text)} is no IDN: expected S or P, a parameter set of 0 to 7 and a number up to 4095, '
            'such as S-0-0104'
        )
    return (_MANUFACTURER if match[1] == 'P' else 0) | int(match[2]) << _NUMBER_SHIFT | int(match[3])


def format_idn(idn: int) -> str:
    """Return the text of the 16 bits of an identification number."""
    kind = 'P' if idn & _MANUFACTURER else 'S'
    return f'{kind}-{idn >> _NUMBER_SHIFT & 7}-{idn & _NUMBER_MAX:04d}'


def _bits(value: float) -> int:
    return int.from_bytes(struct.pack('>d', value), 'big')


def _value(message: int) -> float:
    (value,) = struct.unpack('>d', (message & (1 << _VALUE_BITS) - 1).to_bytes(8, 'big'))
    return float(value)


class _Sender:
    """Sends the portions of one message in turn."""

    def __init__(self, message: int, portions: int, handshake: int) -> None:
        top = _PORTION_BITS * (_PORTIONS - 1)
        self._words = [
            handshake | n + 1 << _NUMBER_SHIFT | message >> top - _PORTION_BITS * n & _PORTION_MASK
            for n in range(portions)
        ]
        self._next = 0

    def word(self) -> int:
        word = self._words[self._next]
        self._next = (self._next + 1) % len(self._words)
        return word


class _Receiver:
    """Puts the portions of one message together, in whatever order and how often they come."""

    def __init__(self) -> None:
        self._portions: list[int | None] = [None] * _PORTIONS

    def add(self, word: int) -> None:
        self._portions[(word >> _NUMBER_SHIFT & 7) - 1] = word & _PORTION_MASK

    def message(self, portions: int) -> int | None:
        """The message of 84 bits once its first ``portions`` are there; the others count as zero."""
        message = 0
        for portion in self._portions[:portions]:
            if portion is None:
                return None
            message = message << _PORTION_BITS | portion
        return message << _PORTION_BITS * (_PORTIONS - portions)


def _is_portion(word: int) -> bool:
    return word >> _NUMBER_SHIFT & 7 != 0


class ServiceMaster:
    """The controller's end of one drive's service channel: one access at a time, the others wait.

    Call ``to_send`` once in each cycle and ``received`` once for each AT, in order. Answers come in the order of the
    requests, one for each.

    Parameters
    ----------
    cycles_max
        Most cycles that an access may take, opening of the channel included.

    """

    def __init__(self, cycles_max: int = ANSWER_CYCLES_MAX, waiting_max: int = WAITING_MAX) -> None:
        self._cycles_max = cycles_max
        self._waiting_max = waiting_max
        self._waiting: deque[Access] = deque()
        self._answers: deque[Answer] = deque()
        self._access: Access | None = None
        self._cycles = 0
        self._open = False
        self._opening = 0  # number of the last opening
        self._handshake = 0
        self._sender: _Sender | None = None
        self._receiver = _Receiver()

    @property
    def outstanding(self) -> int:
        """Accesses whose answers have not been handed out yet."""
        return len(self._waiting) + len(self._answers) + (self._access is not None)

    def request(self, access: Access) -> None:
        """Queue an access.

        Raises
        ------
        TelegramError
            The queue is full, or the access cannot be put into words.

        """
        access = _checked(access)
        if self.outstanding >= self._waiting_max:
            raise TelegramError(
                f'{format_idn(access.idn)} refused: {self.outstanding} accesses wait in the service channel already'
            )
        self._waiting.append(access)

    def close(self) -> None:
        """End all accesses with the error "not open": the bus went back below CP2."""
        ended = [self._access, *self._waiting] if self._access else [*self._waiting]
        self._answers.extend(Answer(access.idn, ServiceError.NOT_OPEN) for access in ended)
        self._waiting.clear()
        self._access = None
        self._open = False

    def to_send(self) -> int:
        """Return the word for the MDT of this cycle."""
        if self._access is not None:
            self._cycles += 1
            if self._cycles > self._cycles_max:
                self._finish(Answer(self._access.idn, ServiceError.NO_ANSWER))
                self._open = False
        if self._access is None:
            if not self._waiting:
                return IDLE
            self._begin(self._waiting.popleft())
        if self._sender is None:
            return self._opening
        return self._sender.word()

    def received(self, word: int | None) -> Answer | None:
        """Take the word of the next AT, None for an AT that was lost; return an answer that is complete."""
        if word is not None and self._access is not None and 0 <= word <= _WORD_MAX:
            self._take(word, self._access)
        return self._answers.popleft() if self._answers else None

    def _begin(self, access: Access) -> None:
        self._access = access
        self._cycles = 1
        if self._open:
            self._send(access)
            return
        if self._sender is not None or self._opening == 0:
            # the drive may still echo the last opening
            self._opening = self._opening % _PORTION_MASK + 1
            self._sender = None

    def _send(self, access: Access) -> None:
        self._handshake ^= _HANDSHAKE
        message = access.operation << _OPERATION_SHIFT | access.idn << _IDN_SHIFT
        portions = _WITHOUT_VALUE
        if access.operation == Operation.WRITE:
            message |= _bits(access.value)
            portions = _PORTIONS
        self._sender = _Sender(message, portions, self._handshake)
        self._receiver = _Receiver()

    def _take(self, word: int, access: Access) -> None:
        if self._sender is None:
            if word == self._opening:
                self._open = True
                self._send(access)
        elif _is_portion(word) and word & _HANDSHAKE == self._handshake:
            self._receiver.add(word)
            self._look(access)

    def _look(self, access: Access) -> None:
        """Finish the access if its answer is complete."""
        message = self._receiver.message(_WITHOUT_VALUE)
        if message is None:
            return
        error, rest = message >> _ERROR_SHIFT, message >> _VALUE_BITS & 0xF
        if rest or error not in _ERRORS:
            self._receiver = _Receiver()
        elif error:
            self._finish(Answer(access.idn, ServiceError(error)))
        elif access.operation == Operation.READ:
            message = self._receiver.message(_PORTIONS)
            if message is not None:
                self._finish(Answer(access.idn, value=_value(message)))
        else:
            self._finish(Answer(access.idn, value=access.value))

    def _finish(self, answer: Answer) -> None:
        self._answers.append(answer)
        self._access = None


class ServiceSlave:
    """The drive's end of the service channel.

    Call ``received`` with the word of each MDT that comes and ``to_send`` for each AT.

    Parameters
    ----------
    access
        Called once for each access that is complete; its answer goes back. It must not raise.

    """

    def __init__(self, access: Callable[[Access], Answer]) -> None:
        self._handle = access
        self._word = IDLE  # last of the master
        self._handshake: int | None = None  # of the access under way or answered
        self._receiver = _Receiver()
        self._sender: _Sender | None = None

    def received(self, word: int) -> None:
        """Take the word of an MDT."""
        if not 0 <= word <= _WORD_MAX:
            return
        if _is_portion(word):
            self._word = word
            self._take(word)
        elif word <= _PORTION_MASK:
            self._word = word
            if word != IDLE:
                self._handshake = None  # whatever comes next begins a new access

    def to_send(self) -> int:
        """Return the word for the next AT."""
        if not _is_portion(self._word):
            return self._word  # echo of an opening, or silence after silence
        return self._sender.word() if self._sender is not None else IDLE

    def _take(self, word: int) -> None:
        handshake = word & _HANDSHAKE
        if handshake != self._handshake:
            self._handshake = handshake
            self._receiver = _Receiver()
            self._sender = None
        if self._sender is not None:
            return
        self._receiver.add(word)
        message = self._receiver.message(_WITHOUT_VALUE)
        if message is None:
            return
        operation, idn = message >> _OPERATION_SHIFT, message >> _IDN_SHIFT & _IDN_MAX
        if operation not in _OPERATIONS or message >> _VALUE_BITS & 3:
            self._receiver = _Receiver()
        elif operation != Operation.WRITE:
            self._answer(Access(idn, Operation(operation)))
        else:
            message = self._receiver.message(_PORTIONS)
            if message is not None:
                self._answer(Access(idn, Operation.WRITE, _value(message)))

    def _answer(self, access: Access) -> None:
        answer = self._handle(access)
        message = answer.error << _ERROR_SHIFT
        portions = _WITHOUT_VALUE
        if access.operation == Operation.READ and not answer.error:
            message |= _bits(answer.value)
            portions = _PORTIONS
        self._sender = _Sender(message, portions, self._handshake or 0)


def _checked(access: Access) -> Access:
    """Return an access with the types that it declares."""
    try:
        idn, operation, value = index(access.idn), Operation(access.operation), float(access.value)
    except (AttributeError, TypeError, ValueError, OverflowError):
        raise TelegramError(
            f'{shown(access)} is no access: expected IDN, operation and a number of 64 bits'
        ) from None
    if not 0 <= idn <= _IDN_MAX:
        raise TelegramError(f'{shown(idn)} is no IDN of 16 bits')
    return Access(idn, operation, value)
