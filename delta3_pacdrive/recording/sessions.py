"""Bus sessions of a recording, used to ignore messages of a simultaneous playback."""

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.sercos.telegram_codec import read_header
from delta3_pacdrive.sercos.telegrams import parse_phase_text


class Sessions:
    """Bus sessions found in the announcements of bus phases."""

    def __init__(self) -> None:
        self._known: set[str] = set()

    def add(self, data: bytes) -> None:
        """Add a message of ``sercos/phase``; malformed ones are ignored."""
        try:
            self._known.add(parse_phase_text(read_header(data)[2])[1].decode())
        except TelegramError:
            return

    def holds(self, session: str) -> bool:
        """Return whether a session is known; true if none is known."""
        return not self._known or session in self._known
