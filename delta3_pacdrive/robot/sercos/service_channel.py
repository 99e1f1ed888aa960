"""Service channel of SERCOS: access to the operation data of a drive, one 16-bit word per cycle in each direction.

An access is a message of the master and a reply of the drive, both split into numbered portions of 12 bits. The sender
repeats the portions of a message cyclically until the other side has confirmed all of them: the drive by replying, the
master by its next access or by idle words. A lost word is repeated in the next round, a duplicate has no effect, and
latency only prolongs the access. Words must keep their order in each direction, as telegrams do; bit errors are
detected by the checksums of the telegrams, not here.

    =====  ==================  =======================================================================================
    bits   name                meaning
    =====  ==================  =======================================================================================
    15     MHS, AHS            handshake: toggles with each access; the drive replies with the handshake of the access
    14-12  number of portion   1 to 7; 0: no portion
    11-0   portion             12 bits of the message, the most significant portion is number 1
    =====  ==================  =======================================================================================

    ==================  ==============================================================================================
    word                meaning
    ==================  ==============================================================================================
    0x0000              idle; ignored, as words of a stopped partner and empty fields of a telegram are zero
    0x0001 to 0x0FFF    opening of the channel with a number; the drive clears a pending access and echoes the word
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

A value is an IEEE 754 number of 64 bits, also for integers. The channel is opened before the first access and after one
without a reply, so that no word of a cancelled access is mistaken for the next. If a word needs one cycle in
either direction, reading and writing take 10 cycles, a command 5, an opening 2 more; further latency adds to each.

SERCOS II uses the same word and handshake bits, with an additional control word and a stepwise exchange of the
elements of a data block (IEC 61491). Here both sides know name, unit, minimum and maximum
(robot/drive/operation_data.py); only the IDN (element 1) and the operation data (element 7) are transmitted.
"""

import math
import re
import struct
from dataclasses import dataclass
from enum import IntEnum

from delta3_pacdrive.errors import ParameterError, shown

IDLE = 0

HANDSHAKE = 1 << 15
_NUMBER_SHIFT = 12
_PORTION_BITS = 12
PORTION_MASK = (1 << _PORTION_BITS) - 1
_PORTIONS = 7
_WITHOUT_VALUE = 2  # portions
WORD_MAX = 0xFFFF
IDN_MAX = 0xFFFF

_VALUE_BITS = 64
_IDN_SHIFT, _OPERATION_SHIFT, _ERROR_SHIFT = 66, 82, 68

_IDN_TEXT = re.compile('([SP])-([0-7])-([0-9]{4})')
_MANUFACTURER = 1 << 15
_NUMBER_MAX = 4095


class Operation(IntEnum):
    """Kind of access."""

    READ = 1
    WRITE = 2
    COMMAND = 3  # procedure command, executed immediately


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
    ServiceError.NO_COMMAND: 'the IDN is not a procedure command',
    ServiceError.NO_ANSWER: 'the drive does not answer in the service channel',
}


@dataclass(frozen=True)
class Access:
    """Access of the controller to an operation datum of a drive."""

    idn: int  # identification number in 16 bits: S-0-0104 is 104, P-0-0012 is 0x8000 | 12
    operation: Operation
    value: float = 0.0  # value to write, in the unit of the IDN


@dataclass(frozen=True)
class Answer:
    """Reply to an access."""

    idn: int
    error: ServiceError = ServiceError.NONE
    value: float = math.nan  # read or written value, in the unit of the IDN; NaN after an error

    @property
    def sentence(self) -> str:
        """Diagnostic message 8503 of a failed access (Schneider: with IDN and error number); empty without an error."""
        return message_8503(self.idn, self.error, ERROR_TEXTS[self.error]) if self.error else ''


def message_8503(idn: int, error: ServiceError, text: str) -> str:
    """Return the text of diagnostic message 8503, service channel error."""
    return f'8503: {format_idn(idn)}: {text} (error 0x{error:04x})'


def parse_idn(text: str) -> int:
    """Return the 16 bits of an identification number such as S-0-0104 or P-0-0012.

    Raises
    ------
    ParameterError
        The text is not an identification number.

    """
    match = _IDN_TEXT.fullmatch(text)
    if match is None or int(match[3]) > _NUMBER_MAX:
        raise ParameterError(
            f'{shown(text)} is not a valid IDN: expected S or P, a parameter set of 0 to 7 and a number up to 4095, '
            'such as S-0-0104'
        )
    return (_MANUFACTURER if match[1] == 'P' else 0) | int(match[2]) << _NUMBER_SHIFT | int(match[3])


def format_idn(idn: int) -> str:
    """Return the text of a 16-bit identification number."""
    kind = 'P' if idn & _MANUFACTURER else 'S'
    return f'{kind}-{idn >> _NUMBER_SHIFT & 7}-{idn & _NUMBER_MAX:04d}'


class Sender:
    """Sends the portions of one message cyclically."""

    def __init__(self, head: int, value: float | None, handshake: int) -> None:
        portions = _WITHOUT_VALUE if value is None else _PORTIONS
        message = head if value is None else head | int.from_bytes(struct.pack('>d', value), 'big')
        top = _PORTION_BITS * (_PORTIONS - 1)
        self._words = [
            handshake | n + 1 << _NUMBER_SHIFT | message >> top - _PORTION_BITS * n & PORTION_MASK
            for n in range(portions)
        ]
        self._next = 0

    @staticmethod
    def of_access(access: Access, handshake: int) -> 'Sender':
        """Return the master's sender of an access."""
        head = access.operation << _OPERATION_SHIFT | access.idn << _IDN_SHIFT
        return Sender(head, access.value if access.operation == Operation.WRITE else None, handshake)

    @staticmethod
    def of_answer(access: Access, answer: Answer, handshake: int) -> 'Sender':
        """Return the drive's sender of a reply."""
        with_value = access.operation == Operation.READ and not answer.error
        return Sender(answer.error << _ERROR_SHIFT, answer.value if with_value else None, handshake)

    def word(self) -> int:
        """Return the next word to send."""
        word = self._words[self._next]
        self._next = (self._next + 1) % len(self._words)
        return word


class Receiver:
    """Assembles the portions of one message, in any order and with duplicates."""

    def __init__(self) -> None:
        self._portions: list[int | None] = [None] * _PORTIONS

    def add(self, word: int) -> None:
        """Store a portion."""
        self._portions[(word >> _NUMBER_SHIFT & 7) - 1] = word & PORTION_MASK

    def access(self) -> Access | None:
        """Return the access once it is complete; invalid portions are cleared."""
        message = self._message(_WITHOUT_VALUE)
        if message is None:
            return None
        operation, idn = message >> _OPERATION_SHIFT, message >> _IDN_SHIFT & IDN_MAX
        if operation not in _OPERATIONS or message >> _VALUE_BITS & 3:
            self._clear()
        elif operation != Operation.WRITE:
            return Access(idn, Operation(operation))
        elif (value := self._value()) is not None:
            return Access(idn, Operation.WRITE, value)
        return None

    def answer(self, access: Access) -> Answer | None:
        """Return the reply to an access once it is complete; invalid portions are cleared."""
        message = self._message(_WITHOUT_VALUE)
        if message is None:
            return None
        error = message >> _ERROR_SHIFT
        if error not in _ERRORS or message >> _VALUE_BITS & 0xF:
            self._clear()
        elif error:
            return Answer(access.idn, ServiceError(error))
        elif access.operation != Operation.READ:
            return Answer(access.idn, value=access.value)
        elif (value := self._value()) is not None:
            return Answer(access.idn, value=value)
        return None

    def _message(self, portions: int) -> int | None:
        """Return the message of 84 bits once its first ``portions`` are present; the others count as zero."""
        message = 0
        for portion in self._portions[:portions]:
            if portion is None:
                return None
            message = message << _PORTION_BITS | portion
        return message << _PORTION_BITS * (_PORTIONS - portions)

    def _value(self) -> float | None:
        message = self._message(_PORTIONS)
        if message is None:
            return None
        (value,) = struct.unpack('>d', (message & (1 << _VALUE_BITS) - 1).to_bytes(8, 'big'))
        return float(value)

    def _clear(self) -> None:
        self._portions = [None] * _PORTIONS


def is_portion(word: int) -> bool:
    """Whether a word carries a portion."""
    return word >> _NUMBER_SHIFT & 7 != 0
