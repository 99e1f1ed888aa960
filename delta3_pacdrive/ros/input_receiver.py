"""The master's end of ``sercos/at/io``: takes inputs off the wire and refuses what is none of its session."""

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.ros import cdr
from delta3_pacdrive.ros.cell_receiver import CellReceiver
from delta3_pacdrive.ros.interfaces import INPUTS
from delta3_pacdrive.sercos import telegrams
from delta3_pacdrive.sercos.telegrams import NO_SESSION


class InputReceiver(CellReceiver):
    """The master reads here what the inputs are in each bus cycle."""

    topic = INPUTS
    _names: tuple[str, ...] = ()  # that the codec is made for

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
