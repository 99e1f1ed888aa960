"""The sessions of the bus that a recording holds: what belongs to another one was played back meanwhile."""

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.sercos.telegram_codec import read_header
from delta3_pacdrive.sercos.telegrams import parse_phase_text


class Sessions:
    """The sessions that the announcements of the bus phases name."""

    def __init__(self) -> None:
        self._known: set[str] = set()

    def add(self, data: bytes) -> None:
        """Take a message of ``sercos/phase``; one that is none counts for nothing."""
        try:
            self._known.add(parse_phase_text(read_header(data)[2])[1].decode())
        except TelegramError:
            return

    def holds(self, session: str) -> bool:
        """Whether a session is one of them; every one is where none is known."""
        return not self._known or session in self._known
