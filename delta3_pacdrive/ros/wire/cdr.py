"""Codecs of the cyclic messages, and the phase message."""

from collections.abc import Callable

from geometry_msgs.msg import PointStamped, Vector3Stamped
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.telegram_codec import IMPOSSIBLE, Message, TelegramCodec
from delta3_pacdrive.robot.sercos.telegrams import Telegram
from delta3_pacdrive.robot.sercos.words import Phase

TYPES: dict[str, type] = {
    telegrams.JOINT_STATE: JointState,
    telegrams.POINT: PointStamped,
    telegrams.VECTOR: Vector3Stamped,
}


def codec(telegram: Telegram, limit: float = IMPOSSIBLE) -> TelegramCodec:
    """Return the codec of a telegram; messages of any client library are accepted."""
    kind = TYPES[telegram.type]

    def parse(data: bytes) -> Message:
        try:
            message = deserialize_message(data, kind)
        except (RuntimeError, ValueError) as error:
            raise TelegramError(f'telegram is not a valid {kind.__name__}') from error
        header = message.header
        head = header.stamp.sec, header.stamp.nanosec, header.frame_id.encode()
        if isinstance(message, JointState):
            return Message(*head, message.name, (message.position, message.velocity, message.effort))
        vector = message.point if isinstance(message, PointStamped) else message.vector
        return Message(*head, (), ((vector.x, vector.y, vector.z),))

    return TelegramCodec(telegram, parse, limit)


def raw_publish(publisher: Publisher) -> Callable[[bytes], None]:
    """Return a function that publishes serialised messages without the checks of ``publish``."""
    return publisher.handle.publish_raw  # type: ignore[no-any-return]


def phase_message(phase: Phase, session: bytes, stamp: tuple[int, int]) -> Header:
    """Return the message of a communication phase; in CP4 the stamp is the start of cyclic operation [bus time]."""
    message = Header(frame_id=telegrams.phase_text(phase, session))
    message.stamp.sec, message.stamp.nanosec = stamp
    return message


def parse_phase(message: Header) -> tuple[Phase, bytes, tuple[int, int]]:
    """Return (phase, session, stamp); raises TelegramError."""
    return *telegrams.parse_phase_text(message.frame_id), (message.stamp.sec, message.stamp.nanosec)
