"""Transmission of ``sercos/mdt`` by the master: commands of a cycle for all drives in one frame."""

from rclpy.node import Node

from delta3_pacdrive.control.cycle.transformation import Command
from delta3_pacdrive.robot.sercos import master, telegrams
from delta3_pacdrive.robot.sercos.bus_time import ACYCLIC_SEC
from delta3_pacdrive.robot.sercos.service_requests import ServiceRequests
from delta3_pacdrive.robot.sercos.telegrams import NO_SESSION
from delta3_pacdrive.robot.sercos.words import CONTROL_OFF, Phase
from delta3_pacdrive.ros.wire import cdr
from delta3_pacdrive.ros.wire.interfaces import MDT


class CommandSender:
    """Sends the MDT of the master; with ``torques`` they contain torques in addition to positions."""

    def __init__(self, node: Node, torques: bool, requests: ServiceRequests) -> None:
        self._requests = requests
        self._session = NO_SESSION
        self._last = b''
        self._frames: dict[tuple[int, float, int], bytes] = {}  # without service channel words
        self._torques, self._count = torques, len(requests.drives)
        self._idle = (0,) * self._count
        self._codec = cdr.codec(telegrams.mdt(torques, requests.drives))
        self.publish = cdr.raw_publish(MDT.publisher(node))  # takes an encoded MDT

    def begin(self, session: bytes) -> None:
        """Start sending in a session."""
        self._session = session
        self._last = b''
        self._frames.clear()

    def greet(self, greeting: master.Greet) -> None:
        """Greet the drives before cyclic operation."""
        words = self._requests.to_send()
        frame = telegrams.mdt_frame(greeting.phase, CONTROL_OFF, 0.0, greeting.session, words)
        self.publish(
            self._codec.encode((ACYCLIC_SEC, 0), frame, [0.0] * self._count * (2 if self._torques else 1))
        )

    def send(self, stamp: tuple[int, int], command: Command) -> None:
        """Send the MDT of a bus cycle."""
        motors, torques, control, payload, outputs = command
        if self._requests.busy:
            words = self._requests.to_send()
            frame = telegrams.mdt_frame(Phase.CP4, control, payload, self._session, words, outputs)
        else:
            known = self._frames.get((control, payload, outputs))
            frame = known or telegrams.mdt_frame(
                Phase.CP4, control, payload, self._session, self._idle, outputs
            )
            self._frames[control, payload, outputs] = frame
        values = motors.tolist()
        if self._torques:
            values += torques.tolist()
        self._last = self._codec.encode(stamp, frame, values)
        self.publish(self._last)

    def repeat(self) -> None:
        """Send the newest MDT again as a heartbeat while the bus waits for a script."""
        if self._last:
            self.publish(self._last)
