"""Reception of ``sercos/at/io`` by the master: decodes inputs and rejects telegrams of other sessions."""

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.ros import cdr
from delta3_pacdrive.ros.cell_receiver import CellReceiver
from delta3_pacdrive.ros.interfaces import INPUTS
from delta3_pacdrive.sercos import telegrams
from delta3_pacdrive.sercos.telegrams import NO_SESSION


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
