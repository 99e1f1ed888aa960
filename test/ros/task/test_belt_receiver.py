"""Tests of the master's end of ``sercos/at/belts``: rejection of invalid and foreign telegrams."""

import math
from types import SimpleNamespace

import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from belts import around, speed_of
from cases import for_each
from delta3_pacdrive.belts.camera import Sighting
from delta3_pacdrive.belts.tracking import BeltReading
from delta3_pacdrive.robot.sercos.bus_time import Clock
from delta3_pacdrive.ros.task.belt_receiver import BeltReceiver, parts_of
from delta3_pacdrive.simulation.belts import axes_of

CAMERA = {'at_mm': 200, 'length_mm': 200, 'every_mm': 120}
BELTS = axes_of(around([speed_of(0.4)], 3, camera=CAMERA))
READING = BeltReading(1234, (1200, 1180), (Sighting('bar', 0.2, 0.01, 0.3, 1111),), 7)
SESSION = 'a1b2'
OUT_OF_RANGE = 'telegram contains a value that is out of range or not a number'


class Receiver:
    """The receiver of a master in session ``a1b2``; its accepted and rejected telegrams."""

    def __init__(self, session: bytes = SESSION.encode()) -> None:
        self.taken: list[object] = []
        self.refused: list[str] = []
        self._calls: list[object] = []
        take = SimpleNamespace(take_belts=lambda cycle, readings: self.taken.append((cycle, readings)))
        controller = SimpleNamespace(
            task=SimpleNamespace(tracking=SimpleNamespace(belts=BELTS)),
            bus=SimpleNamespace(session=session, cyclic=True),
            cycles=take,
        )
        node = SimpleNamespace(create_subscription=lambda *call, **_: self._calls.append(call[2]))
        BeltReceiver(node, Clock(1e-3), False, controller, self.refused.append)

    def hear(self, data: bytes) -> None:
        """Let the receiver hear a message."""
        (call,) = self._calls
        call(data)


def message(reading=READING, stamp=(1, 5_000_000), frame=SESSION, **changed):
    told = {
        'name': ['line'],
        'position': [float(reading.count)],
        'velocity': [float(reading.pictures)],
        'effort': parts_of(BELTS, [reading]),
    } | changed
    found = JointState(**told)
    found.header.stamp.sec, found.header.stamp.nanosec = stamp
    found.header.frame_id = frame
    return serialize_message(found)


@pytest.mark.parametrize('reading', [READING, BeltReading(-5, (), (), 0), BeltReading(7, (3,))])
def test_readings_are_transferred_unchanged(reading):
    receiver = Receiver()
    receiver.hear(message(reading))
    assert receiver.taken == [(1005, [reading])]
    assert receiver.refused == []


def without_parts(**changed):
    return message(BeltReading(1), **changed)


@for_each(
    ('data', 'sentence'),
    [
        (message(frame='ffff'), "a message of belts belongs to session 'ffff', but this one is a1b2"),
        (without_parts(frame='ffff'), "a message of belts belongs to session 'ffff', but this one is a1b2"),
        (message(name=['belt']), "telegram names ['belt'], expected ['line']"),
        (message(name=[]), "telegram names [], expected ['line']"),
        (message(position=[1.0, 2.0]), "telegram names ['line'], expected ['line']"),
        (message(effort=[0.0] * 5), 'telegram names'),
        (message(effort=[0.0, 1.0, 5.0, 0.0, 0.0, 0.0]), 'part has invalid type 1 on belt 0'),
        (message(effort=[1.0, 0.0, 5.0, 0.0, 0.0, 0.0]), 'part has invalid type 0 on belt 1'),
        (message(effort=[-1.0, 0.0, 5.0, 0.0, 0.0, 0.0]), 'part has invalid type 0 on belt -1'),
        (message(effort=[0.0, math.nan, 5.0, 0.0, 0.0, 0.0]), OUT_OF_RANGE),
        (message(effort=[0.0, 0.0, math.inf, 0.0, 0.0, 0.0]), OUT_OF_RANGE),
        (message(position=[1e300]), OUT_OF_RANGE),
        (without_parts(position=[math.nan]), 'out of range'),
        (without_parts(velocity=[1e300]), 'out of range'),
        (message(stamp=(1, 500)), 'is not a multiple of'),
        (without_parts(stamp=(1, 500)), 'is not a multiple of'),
        (b'', 'telegram is not a valid JointState'),
        (b'\0' * 40, 'telegram names []'),
        (message()[:-9], 'telegram is not a valid JointState'),
        (message().replace(b'a1b2', b'\xff\xfe\xfd\xfc'), 'belts: '),
    ],
)
def test_invalid_belt_telegram_is_rejected_by_name(data, sentence):
    receiver = Receiver()
    receiver.hear(data)
    assert receiver.taken == []
    (refused,) = receiver.refused
    assert refused.startswith('belts: ')
    assert sentence in refused


def test_telegrams_without_a_session_are_ignored():
    receiver = Receiver(session=b'0000')
    receiver.hear(message(frame='0000'))
    assert (receiver.taken, receiver.refused) == ([], [])
