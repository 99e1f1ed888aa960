"""Both sides of the service channel of a drive; ``service_channel`` describes the words."""

from collections import deque
from collections.abc import Callable
from operator import index

from delta3_pacdrive.errors import TelegramError, shown
from delta3_pacdrive.robot.sercos.service_channel import (
    HANDSHAKE,
    IDLE,
    IDN_MAX,
    PORTION_MASK,
    WORD_MAX,
    Access,
    Answer,
    Operation,
    Receiver,
    Sender,
    ServiceError,
    format_idn,
    is_portion,
)

WAITING_MAX = 64  # accesses
ANSWER_CYCLES_MAX = 100  # per access; PacDrive: about 10 ms


class ServiceMaster:
    """Master side of one drive's service channel: one access at a time, further ones are queued.

    Call ``to_send`` once per cycle and ``received`` once per AT, in order. Each request gets one reply, in the order
    of the requests.

    Parameters
    ----------
    cycles_max
        Timeout of an access [cycles], including the opening of the channel.

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
        self._sender: Sender | None = None
        self._receiver = Receiver()

    @property
    def outstanding(self) -> int:
        """Number of accesses without a returned reply."""
        return len(self._waiting) + len(self._answers) + (self._access is not None)

    def request(self, access: Access) -> None:
        """Queue an access.

        Raises
        ------
        TelegramError
            The queue is full, or the access cannot be encoded.

        """
        access = _checked(access)
        if self.outstanding >= self._waiting_max:
            raise TelegramError(
                f'{format_idn(access.idn)} rejected: {self.outstanding} accesses are waiting in the service channel'
            )
        self._waiting.append(access)

    def close(self) -> None:
        """Reject all accesses with the error "not open", because the bus fell below CP2."""
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
        """Process the word of the next AT, None if it was lost; return a completed reply."""
        if word is not None and self._access is not None and 0 <= word <= WORD_MAX:
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
            self._opening = self._opening % PORTION_MASK + 1
            self._sender = None

    def _send(self, access: Access) -> None:
        self._handshake ^= HANDSHAKE
        self._sender, self._receiver = Sender.of_access(access, self._handshake), Receiver()

    def _take(self, word: int, access: Access) -> None:
        if self._sender is None:
            if word == self._opening:
                self._open = True
                self._send(access)
        elif is_portion(word) and word & HANDSHAKE == self._handshake:
            self._receiver.add(word)
            answer = self._receiver.answer(access)
            if answer is not None:
                self._finish(answer)

    def _finish(self, answer: Answer) -> None:
        self._answers.append(answer)
        self._access = None


def _checked(access: Access) -> Access:
    """Return a validated access with its declared types."""
    try:
        idn, operation, value = index(access.idn), Operation(access.operation), float(access.value)
    except (AttributeError, TypeError, ValueError, OverflowError):
        raise TelegramError(
            f'{shown(access)} is not a valid access: expected IDN, operation and a number of 64 bits'
        ) from None
    if not 0 <= idn <= IDN_MAX:
        raise TelegramError(f'{shown(idn)} is not a 16-bit IDN')
    return Access(idn, operation, value)


class ServiceSlave:
    """Drive side of the service channel.

    Call ``received`` with the word of each received MDT and ``to_send`` for each AT.

    Parameters
    ----------
    access
        Executes a complete access and returns the reply. It must not raise.

    """

    def __init__(self, access: Callable[[Access], Answer]) -> None:
        self._handle = access
        self._word = IDLE  # last word of the master
        self._handshake: int | None = None  # of the current access, pending or answered
        self._receiver = Receiver()
        self._sender: Sender | None = None

    def received(self, word: int) -> None:
        """Process the word of an MDT."""
        if not 0 <= word <= WORD_MAX:
            return
        if is_portion(word):
            self._word = word
            self._take(word)
        elif word <= PORTION_MASK:
            self._word = word
            if word != IDLE:
                self._handshake = None  # the next portion begins a new access

    def to_send(self) -> int:
        """Return the word for the next AT."""
        if not is_portion(self._word):
            return self._word  # echo of an opening, or idle
        return self._sender.word() if self._sender is not None else IDLE

    def _take(self, word: int) -> None:
        handshake = word & HANDSHAKE
        if handshake != self._handshake:
            self._handshake = handshake
            self._receiver, self._sender = Receiver(), None
        if self._sender is not None:
            return
        self._receiver.add(word)
        access = self._receiver.access()
        if access is not None:
            self._sender = Sender.of_answer(access, self._handle(access), handshake)
