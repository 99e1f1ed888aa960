"""Cyclic telegrams of a robot: names and numbers of each, and the words in its frame.

A telegram is a message with a header: the stamp is bus time, the frame carries all data that are not floating-point
numbers. Frames between participants end with the session, four hexadecimal digits drawn by the master at each
phase-up. It distinguishes telegrams of other writers, such as a second robot or a bag being played back.
"""

import secrets
import struct
from binascii import unhexlify
from collections.abc import Sequence
from typing import NamedTuple

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.parameters import numbered
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES, ROTARY_DRIVES
from delta3_pacdrive.robot.sercos.words import PAYLOAD_MAX_KG, Phase

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
    """Layout of a telegram, the same in every cycle."""

    topic: str  # relative name
    type: str
    names: tuple[str, ...]  # joints; empty for types without such a field
    lengths: tuple[int, ...]  # of each array
    frame_length: int  # characters of ``frame_id``

    @staticmethod
    def triple(topic: str, message_type: str) -> 'Telegram':
        """Return the layout of a point or a vector in the frame of the base."""
        return Telegram(topic, message_type, (), (3,), len(BASE_FRAME))


def motor_current(axis: str, samples: int) -> Telegram:
    """Return the layout with I_eff [A] at the end of each current-loop period, as efforts."""
    return Telegram(f'{axis}/motor_current', JOINT_STATE, (axis,), (0, 0, samples), len(CURRENT_FRAME))


def mdt_form(drives: int) -> str:
    """Return the format of the frame of an MDT to a number of drives."""
    return f'CPn{" wwww" * drives}{" ssss" * drives} ppp.pppp oo hhhh'


def mdt(torques: bool, drives: Sequence[str] = DRIVES) -> Telegram:
    """Return the layout of an MDT, with or without torque commands S-0-0081 [N m]."""
    count = len(drives)
    lengths = (count, 0, count if torques else 0)
    return Telegram('sercos/mdt', JOINT_STATE, tuple(drives), lengths, len(mdt_form(count)))


def at(axis: str) -> Telegram:
    """Return the layout of the AT of a drive."""
    return Telegram(f'sercos/at/{axis}', JOINT_STATE, (axis,), (1, 1, 1), len(AT_FRAME))


def shafts(drives: Sequence[str] = DRIVES) -> Telegram:
    """Return the layout of the true motor shafts: positions [rad], speeds [rad/s], coupling torques [N m]."""
    count = len(drives)
    return Telegram('plant/motor_shafts', JOINT_STATE, tuple(drives), (count, count, count), len(NO_SESSION))


MDT_FRAME = mdt_form(len(DRIVES))
MDT, TORQUE_MDT = mdt(torques=False), mdt(torques=True)
AT, ROTARY_AT = (tuple(at(axis) for axis in drives) for drives in (DRIVES, ROTARY_DRIVES))
INPUTS_TOPIC, BELTS_TOPIC = 'sercos/at/io', 'sercos/at/belts'
SHAFTS = shafts()
# voltage [V], readiness and resistor load at the start of a bus cycle; powers [W] of the mains and of the resistor
DC_LINK = Telegram('plant/dc_link', JOINT_STATE, ('dc_link',), (3, 0, 2), len(NO_SESSION))
FOLLOWING_ERROR = Telegram('following_error', JOINT_STATE, DRIVES, (3, 0, 0), len(BASE_FRAME))
# joints of the robot as a tree (scene.joints): both rods of a forearm at their elbow, the plate on rod 1a
JOINTS = (
    *DRIVES,
    *(f'forearm{arm}{rod}_{angle}' for arm in (1, 2, 3) for rod in 'ab' for angle in ('pitch', 'swing')),
    'plate_swing',
    'plate_pitch',
)


def joints_of(drives: Sequence[str]) -> tuple[str, ...]:
    """Return the joints of a robot with these drives: ``JOINTS``, then the tool on the plate if it has a drive."""
    return (*JOINTS, *drives[len(DRIVES) :])


def joint_states(drives: Sequence[str] = DRIVES) -> Telegram:
    """Return the layout of joint positions [rad], speeds [rad/s] and torques [N m] of a robot with these drives."""
    names = joints_of(drives)
    return Telegram('joint_states', JOINT_STATE, names, (len(names),) * 3, len(BASE_FRAME))


JOINT_STATES = joint_states()
TCP_COMMAND = Telegram.triple('tcp/command', POINT)
TCP_ACTUAL = Telegram.triple('tcp/actual', POINT)
TCP_ERROR = Telegram.triple('tcp/error', VECTOR)
JOINT_MOTION = Telegram('joint_motion', JOINT_STATE, DRIVES, (0, 3, 3), len(BASE_FRAME))
JACOBIAN = Telegram.triple('jacobian', VECTOR)
MASTER = Telegram.triple('motion/master', VECTOR)
# of the optional rotary axes
TURNS = tuple(Telegram.triple(numbered('tool/turn', number), VECTOR) for number in range(len(ROTARY_DRIVES)))


class DriveWords(NamedTuple):
    """Words of an MDT for one drive."""

    phase: Phase
    control: int
    service: int
    payload_kg: float


class BrakeOutput(NamedTuple):
    """Words of a motor current telegram for the plant."""

    released: bool
    payload_kg: float


def temperatures(drives: Sequence[str] = DRIVES) -> Telegram:
    """Return the layout of the temperatures of windings, housings and heat sinks [degC], and viscous frictions."""
    count = len(drives)
    return Telegram(
        'plant/temperatures', JOINT_STATE, tuple(drives), (count, count, 2 * count), len(NO_SESSION)
    )


def inputs(names: Sequence[str]) -> Telegram:
    """Return the layout of inputs with these names: 1 is on, 0 is off."""
    return Telegram(INPUTS_TOPIC, JOINT_STATE, tuple(names), (len(names), 0, 0), len(NO_SESSION))


def belts(names: Sequence[str]) -> Telegram:
    """Return the layout of belts with these names, in a cycle without reported parts: encoder and picture counts."""
    return Telegram(BELTS_TOPIC, JOINT_STATE, tuple(names), (len(names), len(names), 0), len(NO_SESSION))


def progress_values(names: Sequence[str]) -> Telegram:
    """Return the layout of the numbers of a progress report, with their names."""
    return Telegram('motion/progress/values', JOINT_STATE, tuple(names), (len(names), 0, 0), len(BASE_FRAME))


def new_session() -> bytes:
    """Draw a session at random."""
    return b'%04x' % (1 + secrets.randbelow(_SESSIONS - 1))


def mdt_frame(
    phase: int,
    control: int,
    payload_kg: float,
    session: bytes,
    service: Sequence[int] = (0, 0, 0),
    outputs: int = 0,
) -> bytes:
    """Return the frame of an MDT: phase, control word S-0-0134 and service word of each drive, payload, outputs.

    Bit n is output n. There are as many drives as service words.
    """
    words = ' '.join(f'{word:04x}' for word in (*[control] * len(service), *service))
    return f'CP{phase} {words} {payload_kg:08.4f} {outputs:02x} '.encode() + session


def parse_mdt_frame(frame: bytes, axis_index: int, session: bytes, drives: int = len(DRIVES)) -> DriveWords:
    """Return the words of an MDT for one of its drives; raises TelegramError."""
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
    """Return the outputs of an MDT, as bits; raises TelegramError."""
    try:
        *_, outputs, theirs = frame.decode('ascii').split()
        parsed = _outputs(outputs)
    except ValueError:
        raise TelegramError(f'frame_id {frame!r:.60} of an MDT is not "{MDT_FRAME}"') from None
    require_session(theirs.encode(), session, 'an MDT to the plant')
    return parsed


def at_frame(status: int, service: int, session: bytes) -> bytes:
    """Return the frame of an AT: status word S-0-0135, service word."""
    return b'%04x %04x %b' % (status, service, session)


def parse_at_frame(frame: bytes, session: bytes) -> tuple[int, int]:
    """Return (status word, service word) of an AT; raises TelegramError."""
    try:
        status, service, theirs = frame.split()
        parsed = _TWO_WORDS.unpack(unhexlify(status + service))
    except (ValueError, struct.error):
        raise TelegramError(f'frame_id {frame!r:.60} of an AT is not "{AT_FRAME}"') from None
    if theirs != session:
        require_session(theirs, session, 'an AT')
    return parsed


def current_frame(released: bool, payload_kg: float, session: bytes) -> bytes:
    """Return the frame of a motor current: brake output, payload."""
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
    """Raise TelegramError for a telegram of another session."""
    if theirs != session:
        raise TelegramError(
            f'{what} belongs to session {theirs.decode("ascii", "backslashreplace")!r:.20}, '
            f'but this one is {session.decode()}'
        )


def phase_text(phase: Phase, session: bytes) -> str:
    """Return the frame that announces a communication phase."""
    return f'{phase.name} {session.decode()}'


def parse_phase_text(text: str) -> tuple[Phase, bytes]:
    """Return phase and session of an announcement; raises TelegramError."""
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
