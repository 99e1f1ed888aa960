"""The drive's end of the service channel; the words that go over it are told in ``service_channel``."""

from collections.abc import Callable

from delta3_pacdrive.sercos.service_channel import (
    HANDSHAKE,
    IDLE,
    PORTION_MASK,
    WORD_MAX,
    Access,
    Answer,
    Receiver,
    Sender,
    is_portion,
)


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
        self._receiver = Receiver()
        self._sender: Sender | None = None

    def received(self, word: int) -> None:
        """Take the word of an MDT."""
        if not 0 <= word <= WORD_MAX:
            return
        if is_portion(word):
            self._word = word
            self._take(word)
        elif word <= PORTION_MASK:
            self._word = word
            if word != IDLE:
                self._handshake = None  # whatever comes next begins a new access

    def to_send(self) -> int:
        """Return the word for the next AT."""
        if not is_portion(self._word):
            return self._word  # echo of an opening, or silence after silence
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
