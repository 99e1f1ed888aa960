"""Cyclic messages as bytes of a fixed layout.

All cyclic messages of a robot have the same names and lengths in every cycle, so their CDR form is one `struct`:
packing and checking it takes 2 us instead of the 40 us of building or parsing a message object. On the wire they are
ordinary messages. What does not fit the layout (any client may publish) is parsed the ordinary way and checked.
"""

import secrets
import struct
from binascii import unhexlify
from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any

from geometry_msgs.msg import PointStamped, Vector3Stamped
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.sercos.words import PAYLOAD_MAX_KG, Phase

_ENCAPSULATION = b'\x00\x01\x00\x00'  # CDR, little endian

IMPOSSIBLE = 1e6  # rad, rad/s, N m: nothing that turns gets there
Decoded = tuple[int, int, bytes, tuple[float, ...]]


class _Layout:
    """Grows the constant bytes and the struct format of a message field by field."""

    def __init__(self, frame_length: int) -> None:
        self._size = 12 + frame_length + 1  # behind the encapsulation
        self._constant = b'\0'  # ends the frame
        self._format = f'<4siII{frame_length}s'
        self.constants: list[bytes] = []
        self.counts: list[int] = []

    def _align(self, unit: int) -> None:
        padding = -self._size % unit
        self._constant += b'\0' * padding
        self._size += padding

    def count(self, number: int) -> None:
        self._align(4)
        self._constant += struct.pack('<I', number)
        self._size += 4

    def text(self, value: str) -> None:
        self.count(len(value) + 1)
        self._constant += value.encode() + b'\0'
        self._size += len(value) + 1

    def doubles(self, number: int) -> None:
        if not number:
            return
        self._align(8)
        self._format += f'{len(self._constant)}s{number}d'
        self.constants.append(self._constant)
        self.counts.append(number)
        self._constant = b''
        self._size += 8 * number

    def close(self) -> struct.Struct:
        self._format += f'{len(self._constant)}s'
        self.constants.append(self._constant)
        return struct.Struct(self._format)


class _Codec:
    """Packs and unpacks one message type of fixed layout."""

    def __init__(self, layout: _Layout, frame_length: int, limit: float) -> None:
        self._limit = limit
        self._struct = layout.close()
        self._frame_size = frame_length + 1
        # the fields of the struct: encapsulation, sec, nanosec, frame size, frame, constant, doubles, constant, ...
        places, position = [], 5
        for count in layout.counts:
            places.append(position)
            position += 1 + count
        places.append(position)
        values = [
            place + 1 + n for place, count in zip(places, layout.counts, strict=False) for n in range(count)
        ]
        self._constants = tuple(layout.constants)
        self._constants_of = itemgetter(*places)
        self._values_of = itemgetter(*values)
        self._template: list[Any] = [_ENCAPSULATION, 0, 0, self._frame_size, b'', *[0.0] * (position - 4)]
        for place, constant in zip(places, layout.constants, strict=True):
            self._template[place] = constant
        starts = [sum(layout.counts[:n]) for n in range(len(layout.counts))]
        self._blocks = [
            (place + 1, start, start + count)
            for place, start, count in zip(places, starts, layout.counts, strict=False)
        ]

    def encode(self, stamp: tuple[int, int], frame: bytes, values: Sequence[float]) -> bytes:
        """Return the message as CDR; ``frame`` has the length that the codec was made for."""
        fields = self._template.copy()
        fields[1], fields[2] = stamp
        fields[4] = frame
        for place, start, end in self._blocks:
            fields[place : place + end - start] = values[start:end]
        return self._struct.pack(*fields)

    def decode(self, data: bytes) -> Decoded:
        """Return (sec, nanosec, frame, values) of a message; raises TelegramError."""
        decoded = self._decode_layout(data) or self._decode_message(data)
        values = decoded[3]
        total = sum(values)
        if total - total != 0.0:
            raise TelegramError(f'a number at stamp {decoded[0]}.{decoded[1]:09d} s is not finite')
        if max(values) > self._limit or min(values) < -self._limit:
            worst = max(values, key=abs)
            raise TelegramError(
                f'a number at stamp {decoded[0]}.{decoded[1]:09d} s is {worst:g}, the limit is {self._limit:g}'
            )
        return decoded

    def _decode_layout(self, data: bytes) -> Decoded | None:
        if len(data) != self._struct.size:
            return None
        fields = self._struct.unpack(data)
        if (
            self._constants_of(fields) != self._constants
            or fields[3] != self._frame_size
            or fields[0] != _ENCAPSULATION
        ):
            return None
        return fields[1], fields[2], fields[4], self._values_of(fields)

    def _decode_message(self, data: bytes) -> Decoded:
        raise NotImplementedError


class JointStateCodec(_Codec):
    """``sensor_msgs/JointState`` with fixed names and numbers of positions, velocities and efforts."""

    def __init__(
        self,
        names: tuple[str, ...],
        counts: tuple[int, int, int],
        frame_length: int,
        limit: float = IMPOSSIBLE,
    ) -> None:
        layout = _Layout(frame_length)
        layout.count(len(names))
        for name in names:
            layout.text(name)
        for count in counts:
            layout.count(count)
            layout.doubles(count)
        super().__init__(layout, frame_length, limit)
        self._names = list(names)
        self._lengths = counts

    def _decode_message(self, data: bytes) -> Decoded:
        try:
            message = deserialize_message(data, JointState)
        except (RuntimeError, ValueError) as error:
            raise TelegramError('a telegram is no JointState') from error
        arrays = (message.position, message.velocity, message.effort)
        lengths = tuple(len(array) for array in arrays)
        if message.name != self._names or lengths != self._lengths:
            raise TelegramError(
                f'a telegram names {list(message.name)!r:.80} with {lengths} numbers, '
                f'expected {self._names} with {self._lengths}'
            )
        stamp = message.header.stamp
        values = tuple(value for array in arrays for value in array)
        return stamp.sec, stamp.nanosec, message.header.frame_id.encode(), values


class StampedTripleCodec(_Codec):
    """``geometry_msgs/PointStamped`` or ``Vector3Stamped``: both are a header and three doubles."""

    def __init__(self, message_type: type[PointStamped] | type[Vector3Stamped], frame_length: int) -> None:
        layout = _Layout(frame_length)
        layout.doubles(3)
        super().__init__(layout, frame_length, IMPOSSIBLE)
        self._type = message_type

    def _decode_message(self, data: bytes) -> Decoded:
        message = deserialize_message(data, self._type)
        vector = message.point if self._type is PointStamped else message.vector
        stamp = message.header.stamp
        values = (vector.x, vector.y, vector.z)
        return stamp.sec, stamp.nanosec, message.header.frame_id.encode(), values


def raw_publish(publisher: Publisher) -> Callable[[bytes], None]:
    """Return the call that publishes a serialised message, without the tests that ``publish`` makes every time."""
    return publisher.handle.publish_raw  # type: ignore[no-any-return]


AXES = ('axis1', 'axis2', 'axis3')
BASE_FRAME = b'base'

# Every telegram between participants ends with the session, four hexadecimal digits that the master draws whenever it
# phases the bus up: what a stranger publishes, a second robot or a bag that is played back, is of another session.
NO_SESSION = b'0000'
# MDT: frame = communication phase, the control words S-0-0134 of the three drives, their service channel words, the
# payload that the controller's outputs have gripped [kg] and the session,
# "CP4 e000 e000 e000 0000 0000 0000 000.5000 3fa9"
MDT_FRAME_LENGTH = 47
# AT: frame = status word S-0-0135, service channel word and session, "c008 0000 3fa9"
AT_FRAME_LENGTH = 14
# motor current: frame = brake output, gripped payload [kg] and session, "free 000.5000 3fa9" or "held 000.5000 3fa9"
CURRENT_FRAME_LENGTH = 18
# shafts: frame = session
SHAFTS_FRAME_LENGTH = 4
BRAKE_FREE, BRAKE_HELD = 'free', 'held'
_TWO_WORDS = struct.Struct('>HH')
_SESSIONS = 1 << 16


def new_session() -> bytes:
    """Draw a session."""
    return b'%04x' % (1 + secrets.randbelow(_SESSIONS - 1))


def mdt_codec() -> JointStateCodec:
    """Codec of ``sercos/mdt``: three motor shaft commands."""
    return JointStateCodec(AXES, (3, 0, 0), MDT_FRAME_LENGTH)


def at_codec(axis: str) -> JointStateCodec:
    """Codec of ``sercos/at/axisN``: position, velocity, torque."""
    return JointStateCodec((axis,), (1, 1, 1), AT_FRAME_LENGTH)


def current_codec(axis: str, samples: int, limit_a: float = IMPOSSIBLE) -> JointStateCodec:
    """Codec of ``axisN/motor_current``: I_eff [A] at the end of each current-loop period, in ``effort``."""
    return JointStateCodec((axis,), (0, 0, samples), CURRENT_FRAME_LENGTH, limit_a)


def shafts_codec() -> JointStateCodec:
    """Codec of ``plant/motor_shafts``: positions, speeds, coupling torques d."""
    return JointStateCodec(AXES, (3, 3, 3), SHAFTS_FRAME_LENGTH)


def following_error_codec() -> JointStateCodec:
    """Codec of ``following_error``: per arm, in ``position``."""
    return JointStateCodec(AXES, (3, 0, 0), len(BASE_FRAME))


def joint_states_codec() -> JointStateCodec:
    """Codec of ``joint_states``: arm angles, arm speeds, motor torques."""
    return JointStateCodec(AXES, (3, 3, 3), len(BASE_FRAME))


def mdt_frame(
    phase: int, control: int, payload_kg: float, session: bytes, service: Sequence[int] = (0, 0, 0)
) -> bytes:
    """Frame of an MDT that gives all drives the same control word, and each its word of the service channel."""
    word = f'{control:04x}'
    channel = ' '.join(f'{item:04x}' for item in service)
    return f'CP{phase} {word} {word} {word} {channel} {payload_kg:08.4f} '.encode() + session


def parse_mdt_frame(frame: bytes, axis_index: int, session: bytes) -> tuple[Phase, int, int, float]:
    """Return (phase, control word and service channel word of an axis, payload [kg]); raises TelegramError."""
    try:
        head, *words, payload, theirs = frame.decode('ascii').split()
        if len(words) != 2 * len(AXES):
            raise ValueError
        control, service = _TWO_WORDS.unpack(unhexlify(words[axis_index] + words[len(AXES) + axis_index]))
        parsed = Phase[head], control, service, _payload(payload)
    except (ValueError, KeyError, struct.error):
        raise TelegramError(
            f'frame_id {frame!r:.60} of an MDT is not "CPn wwww wwww wwww ssss ssss ssss ppp.pppp hhhh"'
        ) from None
    _require(session, theirs.encode(), 'an MDT')
    return parsed


def _require(session: bytes, theirs: bytes, what: str) -> None:
    if theirs != session:
        raise TelegramError(
            f'{what} belongs to session {theirs.decode("ascii", "backslashreplace")!r:.20}, '
            f'but this one is {session.decode()}'
        )


def current_frame(released: bool, payload_kg: float, session: bytes) -> bytes:
    """Frame of a motor current."""
    return f'{BRAKE_FREE if released else BRAKE_HELD} {payload_kg:08.4f} '.encode() + session


def parse_current_frame(frame: bytes, session: bytes) -> tuple[bool, float]:
    """Return (whether the brake is released, payload [kg]); raises TelegramError."""
    try:
        brake, payload, theirs = frame.decode('ascii').split()
        if brake not in (BRAKE_FREE, BRAKE_HELD):
            raise ValueError
        parsed = brake == BRAKE_FREE, _payload(payload)
    except ValueError:
        raise TelegramError(
            f'frame_id {frame!r:.60} of a motor current is not "free" or "held", a payload and a session'
        ) from None
    _require(session, theirs.encode(), 'a motor current')
    return parsed


def _payload(text: str) -> float:
    value = float(text)
    if not 0.0 <= value <= PAYLOAD_MAX_KG:
        raise ValueError
    return value


def at_frame(status: int, service: int, session: bytes) -> bytes:
    """Frame of an AT."""
    return b'%04x %04x %b' % (status, service, session)


def parse_at_frame(frame: bytes, session: bytes) -> tuple[int, int]:
    """Return (status word, service channel word) of an AT; raises TelegramError."""
    try:
        status, service, theirs = frame.split()
        parsed = _TWO_WORDS.unpack(unhexlify(status + service))
    except (ValueError, struct.error):
        raise TelegramError(f'frame_id {frame!r:.60} of an AT is not "wwww ssss hhhh"') from None
    if theirs != session:
        _require(session, theirs, 'an AT')
    return parsed


def require_session(frame: bytes, session: bytes) -> None:
    """Refuse shafts of another session; raises TelegramError."""
    if frame != session:
        _require(session, frame, 'a message of motor shafts')


def phase_message(phase: Phase, session: bytes, stamp: tuple[int, int]) -> Header:
    """Announcement of a communication phase: in CP4 the stamp is the bus time at which cyclic operation begins."""
    message = Header(frame_id=f'{phase.name} {session.decode()}')
    message.stamp.sec, message.stamp.nanosec = stamp
    return message


def parse_phase(message: Header) -> tuple[Phase, bytes, tuple[int, int]]:
    """Return (phase, session, stamp); raises TelegramError."""
    try:
        name, session = message.frame_id.split()
        return Phase[name], session.encode('ascii'), (message.stamp.sec, message.stamp.nanosec)
    except (KeyError, ValueError):
        raise TelegramError(f'frame_id {message.frame_id!r:.60} of a phase is not "CPn hhhh"') from None
