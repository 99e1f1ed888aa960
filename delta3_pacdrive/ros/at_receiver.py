"""Reception of ``sercos/at/axisN`` by the master: decodes AT and rejects telegrams of other sessions."""

from collections.abc import Callable, Sequence
from functools import partial

from delta3_pacdrive.controller.cyclic_operation import Content
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.ros import cdr
from delta3_pacdrive.ros.interfaces import AT
from delta3_pacdrive.ros.polling import PollingNode, Taken
from delta3_pacdrive.sercos import telegrams
from delta3_pacdrive.sercos.bus_time import Clock
from delta3_pacdrive.sercos.configuration_check import DRIVES
from delta3_pacdrive.sercos.statistics import BusStatistics
from delta3_pacdrive.sercos.telegrams import NO_SESSION, parse_at_frame


class AtReceiver:
    """Receives the drives' feedback for the master.

    Parameters
    ----------
    polled
        Whether only ``poll`` reads telegrams; otherwise each is handled on arrival.
    statistics
        Counts rejected telegrams.
    receive
        Called with axis index, bus cycle, content and time of arrival [ns], 0 if unknown.
    receive_greeting
        Called before cyclic operation, with axis index and content.

    """

    def __init__(
        self,
        node: PollingNode,
        cycles: Clock,
        polled: bool,
        statistics: BusStatistics,
        receive: Callable[[int, int, Content, int], None],
        receive_greeting: Callable[[int, Content], None],
        drives: Sequence[str] = DRIVES,
    ) -> None:
        self.session = NO_SESSION  # without a session no telegram is accepted
        self._cycles, self._statistics = cycles, statistics
        self._receive, self._receive_greeting = receive, receive_greeting
        self._log = node.get_logger()
        self._drives = drives
        self._codecs = [cdr.codec(telegrams.at(axis)) for axis in drives]
        self._takes: list[Callable[[], Taken | None]] = []
        for index, axis in enumerate(drives):
            if polled:
                # The clock triggers the task, so an AT need not wake it: it is read at the next tick.
                self._takes.append(AT.polled_subscription(node, axis))
            else:
                callback = partial(self._on_at, index, received_ns=0)
                AT.subscription(node, callback, axis, raw=True)

    def poll(self, due: Callable[[int], bool]) -> None:
        """Read telegrams of each axis while ``due`` returns True for it."""
        for index, take in enumerate(self._takes):
            while due(index):
                taken = take()
                if taken is None:
                    break
                self._on_at(index, taken[0], taken[1]['received_timestamp'])

    def _on_at(self, index: int, data: bytes, received_ns: int) -> None:
        if self.session is NO_SESSION:
            return
        try:
            sec, nanosec, frame, values = self._codecs[index].decode(data)
            cycle = self._cycles.count(sec, nanosec)
            status, service = parse_at_frame(frame, self.session)
        except TelegramError as error:
            self.refuse(f'{self._drives[index]}: {error}')
            return
        if cycle >= 0:
            self._receive(index, cycle, (values, status, service), received_ns)
        else:
            self._receive_greeting(index, (values, status, service))

    def refuse(self, reason: str) -> None:
        """Count and log a rejected telegram."""
        self._statistics.refused += 1
        self._log.warning(reason, throttle_duration_sec=1.0)
