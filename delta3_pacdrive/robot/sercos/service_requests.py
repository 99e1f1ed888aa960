"""Service channels of all drives in the master, with the callbacks of pending requests."""

from collections import deque
from collections.abc import Callable, Sequence

from delta3_pacdrive.errors import Reason, TelegramError
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.service_channel import (
    ERROR_TEXTS,
    Access,
    Answer,
    ServiceError,
    message_8503,
)
from delta3_pacdrive.robot.sercos.service_endpoints import ServiceMaster

Done = Callable[[int, Answer], None]


class ServiceRequests:
    """Requests to the drives, one at a time per service channel.

    Parameters
    ----------
    closed
        Returns the reason why the channels are closed, None while they are open.

    Attributes
    ----------
    busy
        Whether an access is in progress.

    """

    def __init__(self, closed: Callable[[], Reason | None], drives: Sequence[str] = DRIVES) -> None:
        self._closed, self.drives = closed, drives
        self._channels = [ServiceMaster() for _ in drives]
        self._waiting: list[deque[Done]] = [deque() for _ in drives]
        self.busy = False

    def ask(self, index: int, access: Access, done: Done) -> None:
        """Queue an access; ``done`` is called with the reply some ten telegrams later. Raises TelegramError."""
        reason = self._closed()
        if reason is not None:
            text = f'{ERROR_TEXTS[ServiceError.NOT_OPEN]}: {reason}'
            raise TelegramError(message_8503(access.idn, ServiceError.NOT_OPEN, text))
        self.ask_during_start_up(index, access, done)

    def ask_during_start_up(self, index: int, access: Access, done: Done) -> None:
        """Queue an access of the master itself, in any phase from CP2 on; otherwise as ``ask``."""
        self._channels[index].request(access)
        self._waiting[index].append(done)
        self.busy = True

    def to_send(self) -> list[int]:
        """Return the words for the next MDT."""
        return [channel.to_send() for channel in self._channels]

    def received(self, index: int, word: int | None) -> None:
        """Process the word of an AT, None if it was lost."""
        answer = self._channels[index].received(word)
        if answer is not None:
            done = self._waiting[index].popleft()
            self.busy = any(self._waiting)
            done(index, answer)

    def close(self) -> None:
        """Reject all pending accesses, because cyclic operation has ended."""
        for index, channel in enumerate(self._channels):
            channel.close()
            while channel.outstanding:
                self.received(index, None)
