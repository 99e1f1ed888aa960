"""Base of the receivers of cyclic cell telegrams (inputs and belts) on the master."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

from delta3_pacdrive.controller.robot_controller import RobotController
from delta3_pacdrive.ros.interfaces import Topic
from delta3_pacdrive.ros.polling import PollingNode
from delta3_pacdrive.sercos.bus_time import Clock
from delta3_pacdrive.sercos.telegram_codec import TelegramCodec


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
