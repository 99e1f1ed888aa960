"""Receivers of the cyclic telegrams of drives (AT) and of the inputs of the cell."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from typing import ClassVar

from delta3_pacdrive.control.operation.robot_controller import RobotController
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.bus_time import Clock
from delta3_pacdrive.robot.sercos.telegram_codec import TelegramCodec
from delta3_pacdrive.robot.sercos.telegrams import NO_SESSION, parse_at_frame
from delta3_pacdrive.ros.wire import cdr
from delta3_pacdrive.ros.wire.interfaces import AT, INPUTS, Topic
from delta3_pacdrive.ros.wire.polling import PollingNode, Taken


class CellReceiver(ABC):
    """Receives one cyclic topic of the cell for the master.

    With ``polled`` only ``poll`` reads telegrams; otherwise each is handled on arrival. ``refuse`` is called with the
    reason when a telegram is rejected.
    """

    topic: ClassVar[Topic]

    def __init__(
        self,
        node: PollingNode,
        clock: Clock,
        polled: bool,
        controller: RobotController,
        refuse: Callable[[str], None],
    ) -> None:
        self._clock, self._controller, self._refuse = clock, controller, refuse
        self._codec: TelegramCodec | None = None
        self._take = self.topic.polled_subscription(node) if polled else None
        if not polled:
            self.topic.subscription(node, self._on_message, raw=True)

    def poll(self) -> None:
        """Read telegrams until the current bus cycle is complete."""
        cycles = self._controller.cycles
        while self._take is not None and self._expected() < cycles.next_cycle:
            taken = self._take()
            if taken is None:
                return
            self._on_message(taken[0])

    @abstractmethod
    def _expected(self) -> int:
        """Return the bus cycle of the next expected telegram."""

    @abstractmethod
    def _on_message(self, data: bytes) -> None:
        """Accept or reject a telegram."""


class InputReceiver(CellReceiver):
    """Receives the inputs for the master, in every bus cycle."""

    topic = INPUTS
    _names: tuple[str, ...] = ()  # for which the codec was built

    def _expected(self) -> int:
        return self._controller.cycles.inputs.expected

    def _on_message(self, data: bytes) -> None:
        controller = self._controller
        names, session = controller.cycles.inputs.names, controller.bus.session
        if session == NO_SESSION or not controller.bus.cyclic or not names:
            return
        if self._codec is None or names != self._names:
            self._names, self._codec = names, cdr.codec(telegrams.inputs(names))
        try:
            sec, nanosec, frame, values = self._codec.decode(data)
            telegrams.require_session(frame, session, 'a message of inputs')
            cycle = self._clock.count(sec, nanosec)
            bits = 0
            for n, value in enumerate(values):
                if value not in (0.0, 1.0):
                    raise TelegramError(f'input {names[n]} is {value:g}, but must be 0 or 1')
                bits |= int(value) << n
        except TelegramError as error:
            self._refuse(f'inputs: {error}')
            return
        controller.cycles.take_inputs(cycle, bits)


class AtReceiver:
    """Receives the drives' feedback for the master.

    With ``polled`` only ``poll`` reads telegrams; otherwise each is handled on arrival.
    """

    def __init__(self, node: PollingNode, clock: Clock, polled: bool, controller: RobotController) -> None:
        self.session = NO_SESSION  # without a session no telegram is accepted
        self._clock, self._controller, self._cycles = clock, controller, controller.cycles
        self._log = node.get_logger()
        self._drives = controller.services.drives
        self._codecs = [cdr.codec(telegrams.at(axis)) for axis in self._drives]
        self._takes: list[Callable[[], Taken | None]] = []
        for index, axis in enumerate(self._drives):
            if polled:
                # The clock triggers the task, so an AT need not wake it: it is read at the next tick.
                self._takes.append(AT.polled_subscription(node, axis))
            else:
                callback = partial(self._on_at, index, received_ns=0)
                AT.subscription(node, callback, axis, raw=True)

    def poll(self) -> None:
        """Read telegrams of each axis while further ones are expected."""
        for index, take in enumerate(self._takes):
            while self._cycles.due(index):
                taken = take()
                if taken is None:
                    break
                self._on_at(index, taken[0], taken[1]['received_timestamp'])

    def _on_at(self, index: int, data: bytes, received_ns: int) -> None:
        if self.session is NO_SESSION:
            return
        try:
            sec, nanosec, frame, values = self._codecs[index].decode(data)
            cycle = self._clock.count(sec, nanosec)
            status, service = parse_at_frame(frame, self.session)
        except TelegramError as error:
            self.refuse(f'{self._drives[index]}: {error}')
            return
        if cycle >= 0:
            self._cycles.take(index, cycle, (values, status, service), received_ns)
        else:
            self._controller.receive_greeting(index, (values, status, service))

    def refuse(self, reason: str) -> None:
        """Count and log a rejected telegram."""
        self._cycles.statistics.refused += 1
        self._log.warning(reason, throttle_duration_sec=1.0)
