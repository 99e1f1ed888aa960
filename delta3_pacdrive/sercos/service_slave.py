"""Drive side of the service channel; ``service_channel`` describes the words."""

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
