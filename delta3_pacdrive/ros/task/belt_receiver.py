"""Reception of ``sercos/at/belts`` by the master: decodes counts and parts and rejects other sessions' messages.

A message without parts has a fixed layout like every telegram; each part adds six efforts.
"""

from collections.abc import Sequence

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from delta3_pacdrive.belts.camera import Sighting
from delta3_pacdrive.belts.meeting import BeltAxes
from delta3_pacdrive.belts.tracking import BeltReading
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.telegram_codec import TelegramCodec
from delta3_pacdrive.robot.sercos.telegrams import NO_SESSION
from delta3_pacdrive.ros.task.receivers import CellReceiver
from delta3_pacdrive.ros.wire import cdr
from delta3_pacdrive.ros.wire.interfaces import BELTS

COUNT_MAX = 2.0**53
EVENT = 6  # numbers per part: belt, type (-1: latched by the light barrier), count, along, across, angle


class BeltReceiver(CellReceiver):
    """Receives the state of the belts for the master, in every bus cycle."""

    topic = BELTS
    _belts: tuple[BeltAxes, ...] = ()  # for which the codec was built

    def _expected(self) -> int:
        return self._controller.cycles.belts.expected

    def _on_message(self, data: bytes) -> None:
        controller = self._controller
        tracking, session = controller.task.tracking, controller.bus.session
        if session == NO_SESSION or not controller.bus.cyclic or not tracking.belts:
            return
        if self._codec is None or tracking.belts != self._belts:
            self._belts = tracking.belts
            self._codec = cdr.codec(telegrams.belts([belt.name for belt in self._belts]), COUNT_MAX)
        try:
            cycle, readings = self._read(data, self._codec, session)
        except TelegramError as error:
            self._refuse(f'belts: {error}')
            return
        controller.cycles.take_belts(cycle, readings)

    def _read(self, data: bytes, codec: TelegramCodec, session: bytes) -> tuple[int, list[BeltReading]]:
        """Return bus cycle and readings of a message; raises TelegramError."""
        head = codec.decode_layout(data)
        if head is None:
            sec, nanosec, frame, values, events = self._with_parts(data)
        else:
            (sec, nanosec, frame, values), events = codec.decode(data), ()
        telegrams.require_session(frame, session, 'a message of belts')
        n = len(self._belts)
        latched: list[list[int]] = [[] for _ in range(n)]
        sighted: list[list[Sighting]] = [[] for _ in range(n)]
        for at in range(0, len(events), EVENT):
            belt, kind, count, along, across, angle = events[at : at + EVENT]
            types = self._belts[int(belt)].types if 0 <= belt < n else ()
            if not 0 <= belt < n or not -1 <= kind < len(types):
                raise TelegramError(f'part has invalid type {kind:g} on belt {belt:g}')
            if kind < 0:
                latched[int(belt)].append(int(count))
            else:
                sighted[int(belt)].append(Sighting(types[int(kind)], along, across, angle, int(count)))
        readings = [
            BeltReading(int(values[k]), tuple(latched[k]), tuple(sighted[k]), int(values[n + k]))
            for k in range(n)
        ]
        return self._clock.count(sec, nanosec), readings

    def _with_parts(self, data: bytes) -> tuple[int, int, bytes, Sequence[float], Sequence[float]]:
        try:
            message = deserialize_message(data, JointState)
        except (RuntimeError, ValueError) as error:
            raise TelegramError('telegram is not a valid JointState') from error
        names, n = [belt.name for belt in self._belts], len(self._belts)
        lengths = len(message.position), len(message.velocity), len(message.effort) % EVENT
        if list(message.name) != names or lengths != (n, n, 0):
            raise TelegramError(f'telegram names {list(message.name)!r:.80}, expected {names}')
        values = [*message.position, *message.velocity]
        if not all(abs(value) < COUNT_MAX for value in (*values, *message.effort)):
            raise TelegramError('telegram contains a value that is out of range or not a number')
        head = message.header
        return head.stamp.sec, head.stamp.nanosec, head.frame_id.encode(), values, list(message.effort)


def parts_of(belts: Sequence[BeltAxes], readings: Sequence[BeltReading]) -> list[float]:
    """Return the efforts of a message: the latched and sighted parts of a bus cycle."""
    efforts: list[float] = []
    for n, (belt, reading) in enumerate(zip(belts, readings, strict=True)):
        for count in reading.latched:
            efforts += (n, -1.0, count, 0.0, 0.0, 0.0)
        for seen in reading.sighted:
            kind = belt.types.index(seen.type)
            efforts += (n, kind, seen.count, seen.along_m, seen.across_m, seen.angle_rad)
    return [float(value) for value in efforts]
