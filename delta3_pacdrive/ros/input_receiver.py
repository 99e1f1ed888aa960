"""The master's end of ``sercos/at/io``: takes inputs off the wire and refuses what is none of its session."""

from collections.abc import Callable

from delta3_pacdrive.controller.robot_controller import RobotController
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.ros import cdr
from delta3_pacdrive.ros.interfaces import INPUTS
from delta3_pacdrive.ros.polling import PollingNode
from delta3_pacdrive.sercos import telegrams
from delta3_pacdrive.sercos.bus_time import Clock
from delta3_pacdrive.sercos.telegram_codec import TelegramCodec
from delta3_pacdrive.sercos.telegrams import NO_SESSION


class InputReceiver:
    """The master reads here what the inputs are in each bus cycle.

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

    """

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
        self._names: tuple[str, ...] = ()
        self._take = INPUTS.polled_subscription(node) if polled else None
        if not polled:
            INPUTS.subscription(node, self._on_inputs, raw=True)

    def poll(self) -> None:
        """Read what has come, as long as anything is due."""
        cycles = self._controller.cycles
        while self._take is not None and cycles.inputs.expected < cycles.next_cycle:
            taken = self._take()
            if taken is None:
                return
            self._on_inputs(taken[0])

    def _on_inputs(self, data: bytes) -> None:
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
