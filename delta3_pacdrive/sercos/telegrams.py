"""Cyclic telegrams of a robot: names and numbers of each, and the words in its frame.

A telegram is a message with a header: the stamp is bus time, the frame carries what is no floating point number. Every
frame between participants ends with the session, four hexadecimal digits that the master draws whenever it phases the
bus up: what a foreign writer publishes, a second robot or a bag that is played back, is of another session.
"""

import secrets
import struct
from binascii import unhexlify
from collections.abc import Sequence
from typing import NamedTuple

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.sercos.configuration_check import DRIVES, TOOL_DRIVE
from delta3_pacdrive.sercos.words import PAYLOAD_MAX_KG, Phase

JOINT_STATE = 'sensor_msgs/msg/JointState'
POINT, VECTOR = 'geometry_msgs/msg/PointStamped', 'geometry_msgs/msg/Vector3Stamped'
BASE_FRAME = b'base'
NO_SESSION = b'0000'
BRAKE_FREE, BRAKE_HELD = 'free', 'held'
AT_FRAME = 'wwww ssss hhhh'
CURRENT_FRAME = f'{BRAKE_FREE} ppp.pppp hhhh'
_TWO_WORDS = struct.Struct('>HH')
_SESSIONS = 1 << 16


class Telegram(NamedTuple):
    """A telegram has the same names and lengths in every cycle.

    Attributes
    ----------
    topic, type
        Relative name, and type of the message.
    names
        Of the joints; none in a message that has no such field.
    lengths
        Numbers in each of its arrays.
    frame_length
        Characters of ``frame_id``.

    """

    topic: str
    type: str
    names: tuple[str, ...]
    lengths: tuple[int, ...]
    frame_length: int

    @staticmethod
    def triple(topic: str, message_type: str) -> 'Telegram':
        """Return that of a point or a vector in the frame of the base."""
        return Telegram(topic, message_type, (), (3,), len(BASE_FRAME))


def motor_current(axis: str, samples: int) -> Telegram:
    """Return that of I_eff [A] at the end of each current-loop period, as efforts."""
    return Telegram(f'{axis}/motor_current', JOINT_STATE, (axis,), (0, 0, samples), len(CURRENT_FRAME))


def mdt_form(drives: int) -> str:
    """Return the form of the frame of an MDT to so many drives."""
    return f'CPn{" wwww" * drives}{" ssss" * drives} ppp.pppp oo hhhh'


def mdt(torques: bool, drives: Sequence[str] = DRIVES) -> Telegram:
    """Return that of a master which commands torques S-0-0081 [N m] beside the shafts, or of one that does not."""
    count = len(drives)
    lengths = (count, 0, count if torques else 0)
    return Telegram('sercos/mdt', JOINT_STATE, tuple(drives), lengths, len(mdt_form(count)))


def at(axis: str) -> Telegram:
    """Return that of the answers of a drive."""
    return Telegram(f'sercos/at/{axis}', JOINT_STATE, (axis,), (1, 1, 1), len(AT_FRAME))


def shafts(drives: Sequence[str] = DRIVES) -> Telegram:
    """Return that of the true motor shafts of drives: positions [rad], speeds [rad/s], coupling torques [N m]."""
    count = len(drives)
    return Telegram('plant/motor_shafts', JOINT_STATE, tuple(drives), (count, count, count), len(NO_SESSION))


MDT_FRAME = mdt_form(len(DRIVES))
MDT, TORQUE_MDT = mdt(torques=False), mdt(torques=True)
AT, TOOL_AT = tuple(at(axis) for axis in DRIVES), at(TOOL_DRIVE)
INPUTS_TOPIC, BELTS_TOPIC = 'sercos/at/io', 'sercos/at/belts'
SHAFTS = shafts()
FOLLOWING_ERROR = Telegram('following_error', JOINT_STATE, DRIVES, (3, 0, 0), len(BASE_FRAME))
# the joints of the robot as a tree (scene.joints): both rods of a forearm at their elbow, the plate on rod 1a
JOINTS = (
    *DRIVES,
    *(f'forearm{arm}{rod}_{angle}' for arm in (1, 2, 3) for rod in 'ab' for angle in ('pitch', 'swing')),
    'plate_swing',
    'plate_pitch',
)


def joints_of(drives: Sequence[str]) -> tuple[str, ...]:
    """Return the joints of a robot with these drives: behind ``JOINTS`` the tool on the plate, if it has a drive."""
    return (*JOINTS, *drives[len(DRIVES) :])


def joint_states(drives: Sequence[str] = DRIVES) -> Telegram:
    """Return that of positions [rad], speeds [rad/s] and torques [N m] of the joints of a robot with these drives."""
    names = joints_of(drives)
    return Telegram('joint_states', JOINT_STATE, names, (len(names),) * 3, len(BASE_FRAME))


JOINT_STATES = joint_states()
TCP_COMMAND = Telegram.triple('tcp/command', POINT)
TCP_ACTUAL = Telegram.triple('tcp/actual', POINT)
TCP_ERROR = Telegram.triple('tcp/error', VECTOR)
JOINT_MOTION = Telegram('joint_motion', JOINT_STATE, DRIVES, (0, 3, 3), len(BASE_FRAME))
JACOBIAN = Telegram.triple('jacobian', VECTOR)
MASTER = Telegram.triple('motion/master', VECTOR)
TURN = Telegram.triple('tool/turn', VECTOR)  # of the rotary axis, where there is one


class DriveWords(NamedTuple):
    """An MDT tells a drive these words."""

    phase: Phase
    control: int
    service: int
    payload_kg: float


class BrakeOutput(NamedTuple):
    """A motor current tells the plant these words."""

    released: bool
    payload_kg: float


def inputs(names: Sequence[str]) -> Telegram:
    """Return that of inputs with these names: 1 is on, 0 is off."""
    return Telegram(INPUTS_TOPIC, JOINT_STATE, tuple(names), (len(names), 0, 0), len(NO_SESSION))


def belts(names: Sequence[str]) -> Telegram:
    """Return that of belts with these names, of a bus cycle without parts: counts, and how many pictures were taken."""
    return Telegram(BELTS_TOPIC, JOINT_STATE, tuple(names), (len(names), len(names), 0), len(NO_SESSION))


def new_session() -> bytes:
    """Draw a session."""
    return b'%04x' % (1 + secrets.randbelow(_SESSIONS - 1))


def mdt_frame(
    phase: int,
    control: int,
    payload_kg: float,
    session: bytes,
    service: Sequence[int] = (0, 0, 0),
    outputs: int = 0,
) -> bytes:
    """Frame of an MDT: phase, the control word S-0-0134 for each drive, its word of the service channel, payload.

    Behind them the digital outputs: bit n is output n. There are as many drives as words of the service channel.
    """
    words = ' '.join(f'{word:04x}' for word in (*[control] * len(service), *service))
    return f'CP{phase} {words} {payload_kg:08.4f} {outputs:02x} '.encode() + session


def parse_mdt_frame(frame: bytes, axis_index: int, session: bytes, drives: int = len(DRIVES)) -> DriveWords:
    """Return what an MDT to so many drives tells one of them; raises TelegramError."""
    try:
        head, *words, payload, outputs, theirs = frame.decode('ascii').split()
        if len(words) != 2 * drives:
            raise ValueError
        _outputs(outputs)
        control, service = _TWO_WORDS.unpack(unhexlify(words[axis_index] + words[drives + axis_index]))
        parsed = DriveWords(Phase[head], control, service, _payload(payload))
    except (ValueError, KeyError, struct.error):
        raise TelegramError(f'frame_id {frame!r:.60} of an MDT is not "{mdt_form(drives)}"') from None
    require_session(theirs.encode(), session, 'an MDT')
    return parsed


def parse_outputs(frame: bytes, session: bytes) -> int:
    """Return the outputs that an MDT tells the plant, as bits; raises TelegramError."""
    try:
        *_, outputs, theirs = frame.decode('ascii').split()
        parsed = _outputs(outputs)
    except ValueError:
        raise TelegramError(f'frame_id {frame!r:.60} of an MDT is not "{MDT_FRAME}"') from None
    require_session(theirs.encode(), session, 'an MDT to the plant')
    return parsed


def at_frame(status: int, service: int, session: bytes) -> bytes:
    """Frame of an AT: status word S-0-0135, word of the service channel."""
    return b'%04x %04x %b' % (status, service, session)


def parse_at_frame(frame: bytes, session: bytes) -> tuple[int, int]:
    """Return (status word, word of the service channel) of an AT; raises TelegramError."""
    try:
        status, service, theirs = frame.split()
        parsed = _TWO_WORDS.unpack(unhexlify(status + service))
    except (ValueError, struct.error):
        raise TelegramError(f'frame_id {frame!r:.60} of an AT is not "{AT_FRAME}"') from None
    if theirs != session:
        require_session(theirs, session, 'an AT')
    return parsed


def current_frame(released: bool, payload_kg: float, session: bytes) -> bytes:
    """Frame of a motor current: brake output, payload."""
    return f'{BRAKE_FREE if released else BRAKE_HELD} {payload_kg:08.4f} '.encode() + session


def parse_current_frame(frame: bytes, session: bytes) -> BrakeOutput:
    """Return the words of a motor current; raises TelegramError."""
    try:
        brake, payload, theirs = frame.decode('ascii').split()
        if brake not in (BRAKE_FREE, BRAKE_HELD):
            raise ValueError
        parsed = BrakeOutput(brake == BRAKE_FREE, _payload(payload))
    except ValueError:
        raise TelegramError(
            f'frame_id {frame!r:.60} of a motor current is not "{BRAKE_FREE}" or "{BRAKE_HELD}", '
            'a payload and a session'
        ) from None
    require_session(theirs.encode(), session, 'a motor current')
    return parsed


def require_session(theirs: bytes, session: bytes, what: str = 'a message of motor shafts') -> None:
    """Refuse a telegram of another session, which is the whole frame of shafts; raises TelegramError."""
    if theirs != session:
        raise TelegramError(
            f'{what} belongs to session {theirs.decode("ascii", "backslashreplace")!r:.20}, '
            f'but this one is {session.decode()}'
        )


def phase_text(phase: Phase, session: bytes) -> str:
    """Frame of the announcement of a communication phase."""
    return f'{phase.name} {session.decode()}'


def parse_phase_text(text: str) -> tuple[Phase, bytes]:
    """Return phase and session; raises TelegramError."""
    try:
        name, session = text.split()
        return Phase[name], session.encode('ascii')
    except (KeyError, ValueError):
        raise TelegramError(f'frame_id {text!r:.60} of a phase is not "CPn hhhh"') from None


def _outputs(text: str) -> int:
    if len(text) != len('oo'):
        raise ValueError
    return unhexlify(text)[0]


def _payload(text: str) -> float:
    value = float(text)
    if not 0.0 <= value <= PAYLOAD_MAX_KG:
        raise ValueError
    return value
