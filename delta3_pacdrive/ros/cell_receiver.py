"""The master's end of what the cell tells in each bus cycle: how telegrams of inputs and belts come off the wire."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

from delta3_pacdrive.controller.robot_controller import RobotController
from delta3_pacdrive.ros.interfaces import Topic
from delta3_pacdrive.ros.polling import PollingNode
from delta3_pacdrive.sercos.bus_time import Clock
from delta3_pacdrive.sercos.telegram_codec import TelegramCodec


class CellReceiver(ABC):
    """The master reads here what one topic tells in each bus cycle.

    Parameters
    ----------
    node
        Subscribes.
    clock
        Bus time.
    polled
        Whether telegrams are read by ``poll`` alone.
    controller
        Takes them.
    refuse
        Called with a sentence about what is no telegram of this robot.

    Attributes
    ----------
    topic
        That is read.

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
        """Read what has come, as long as anything is due."""
        cycles = self._controller.cycles
        while self._take is not None and self._expected() < cycles.next_cycle:
            taken = self._take()
            if taken is None:
                return
            self._on_message(taken[0])

    @abstractmethod
    def _expected(self) -> int:
        """Return the bus cycle whose telegram comes next."""

    @abstractmethod
    def _on_message(self, data: bytes) -> None:
        """Take a telegram, or refuse it."""
