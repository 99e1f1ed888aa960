"""Requests of operators to the service channels of the drives, as text, and their answers.

In: ``sercos/service/request`` (String: "axis1 read S-0-0104", "axis2 write S-0-0104 70", "axis3 command S-0-0099").
Out: ``sercos/service/answer`` (String: one sentence for each request, with value and unit, or message 8503).

Everybody hears every answer. A request may begin with a mark of the asker's own choice, and its answer begins with the
same: "#3fa9 axis1 read S-0-0104" is answered with "#3fa9 accepted: axis1: ...".
"""

import re
from collections import deque
from collections.abc import Callable

from rclpy.node import Node
from std_msgs.msg import String

from delta3_pacdrive.drive.operation_data import TABLE, refusal, value_text
from delta3_pacdrive.errors import Delta3Error, TelegramError, shown
from delta3_pacdrive.ros.interfaces import SERVICE_ANSWER, SERVICE_REQUEST
from delta3_pacdrive.sercos.configuration_check import DRIVES
from delta3_pacdrive.sercos.service_channel import (
    ERROR_TEXTS,
    Access,
    Answer,
    Operation,
    ServiceError,
    ServiceMaster,
    format_idn,
    message_8503,
    parse_idn,
)

Done = Callable[[int, Answer], None]
_MARK = re.compile(r'\s*(#\S{1,32}(?:\s+|$))(.*)', re.DOTALL)
OPERATIONS = {operation.name.lower(): operation for operation in Operation}


class ServiceDesk:
    """The master's ends of the three service channels, and who asks what through them.

    Parameters
    ----------
    node
        Publishes the answers.
    closed
        Returns why the channels are closed, empty while they are open.

    """

    def __init__(self, node: Node, closed: Callable[[], str]) -> None:
        self._closed = closed
        self._channels = [ServiceMaster() for _ in DRIVES]
        self._waiting: list[deque[Done]] = [deque() for _ in DRIVES]
        self._accesses = 0
        self._answers = SERVICE_ANSWER.publisher(node)
        SERVICE_REQUEST.subscription(node, self._on_request)

    @property
    def busy(self) -> bool:
        """Whether an access is under way."""
        return self._accesses > 0

    def ask(self, index: int, access: Access, done: Done) -> None:
        """Ask a drive; ``done`` is called with the answer some ten telegrams later. Raises TelegramError."""
        reason = self._closed()
        if reason:
            text = f'{ERROR_TEXTS[ServiceError.NOT_OPEN]}: {reason}'
            raise TelegramError(message_8503(access.idn, ServiceError.NOT_OPEN, text))
        self._channels[index].request(access)
        self._waiting[index].append(done)
        self._accesses += 1

    def to_send(self) -> list[int]:
        """Return the words for the next MDT."""
        return [channel.to_send() for channel in self._channels]

    def received(self, index: int, word: int | None) -> None:
        """Take the word of an AT, None for one that was lost."""
        answer = self._channels[index].received(word)
        if answer is not None:
            self._accesses -= 1
            self._waiting[index].popleft()(index, answer)

    def close(self) -> None:
        """End all accesses: there are no more cycles."""
        for index, channel in enumerate(self._channels):
            channel.close()
            while channel.outstanding:
                self.received(index, None)

    def _on_request(self, message: String) -> None:
        mark, request = split_mark(message.data)

        def say(text: str) -> None:
            self._answers.publish(String(data=f'{mark} {text}' if mark else text))

        try:
            index, access = parse_request(request)
            self.ask(index, access, lambda index, answer: say(sentence(index, access, answer)))
        except Delta3Error as error:
            say(f'refused: {error}')


def split_mark(text: str) -> tuple[str, str]:
    """Return (mark such as "#3fa9", the rest) of a request or an answer; the mark is empty without one."""
    match = _MARK.match(text)
    return (match[1].rstrip(), match[2]) if match else ('', text)


def parse_request(text: str) -> tuple[int, Access]:
    """Return (number of the drive, access) of a request; raises TelegramError or ParameterError."""
    words = text.split()
    if len(words) < 3 or words[0] not in DRIVES or words[1] not in OPERATIONS:
        raise TelegramError(
            f'{shown(text)} is no request: expected "axis1 read S-0-0104", "axis1 write S-0-0104 60" or '
            '"axis1 command S-0-0099"'
        )
    operation = OPERATIONS[words[1]]
    if len(words) != (4 if operation == Operation.WRITE else 3):
        raise TelegramError(f'{shown(text)}: only "write" takes a value, and it needs one')
    value = _number(words[3]) if operation == Operation.WRITE else 0.0
    return DRIVES.index(words[0]), Access(parse_idn(words[2]), operation, value)


def _number(text: str) -> float:
    try:
        # Python alone takes 1_0 for 10
        return float(text if text.isascii() and '_' not in text else '')
    except ValueError:
        raise TelegramError(f'{shown(text)} is no number') from None


def sentence(index: int, access: Access, answer: Answer) -> str:
    """Say what became of an access."""
    if answer.error:
        return f'refused: {DRIVES[index]}: {refusal(access, answer)}'
    row = TABLE[access.idn]
    if access.operation == Operation.COMMAND:
        return f'accepted: {DRIVES[index]}: {format_idn(access.idn)} {row.name}: done'
    return f'accepted: {DRIVES[index]}: {format_idn(access.idn)} {row.name} = {value_text(row, answer.value)}'
