"""Node of the plant: three motors, brakes, gears and the coupled arms.

In: ``axisN/motor_current`` of the three drives (currents of a period, brake output), ``sercos/phase``. Out:
``plant/motor_shafts`` (true shaft positions, speeds and coupling torques d), one message per exchange period.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import UInt8

from delta3_pacdrive.bus.phases import DRIVES, PLANT
from delta3_pacdrive.bus.time import ACYCLIC_SEC, Clock
from delta3_pacdrive.bus.words import Phase
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.nodes import runtime, telegram
from delta3_pacdrive.nodes.participant import Participant
from delta3_pacdrive.nodes.qos import CYCLIC_PUBLISHER, CYCLIC_SUBSCRIPTION, LATCHED
from delta3_pacdrive.nodes.robot_parameters import declare_robot
from delta3_pacdrive.plant.mechanism import Plant

GREETING_S = 0.02
REPORT_EVERY = 12  # greetings between two looks at who is missing


class PlantNode(Node):
    """The machine behind the drives."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('plant', **node_options)
        parameters = declare_robot(self)
        bus = parameters.bus
        self._plant = Plant(parameters)
        self._exchanges = Clock(bus.exchange_period_s)
        self._exchange = 0
        samples = round(bus.exchange_period_s / parameters.drive.current_period_s)
        self._matrix = np.zeros((samples, 3))
        self._currents: list[dict[int, tuple[bool, float, tuple[float, ...]]]] = [{}, {}, {}]
        self._heard: set[str] = set()
        self._cyclic = False
        self._refused = 0
        self._waiting = ''
        self._greetings = 0

        self._codecs = [telegram.current_codec(axis, samples) for axis in DRIVES]
        self._shafts = telegram.shafts_codec()
        self._publish = telegram.raw_publish(
            self.create_publisher(JointState, 'plant/motor_shafts', CYCLIC_PUBLISHER)
        )
        for index, axis in enumerate(DRIVES):
            self.create_subscription(
                JointState, f'{axis}/motor_current', self._on_current(index), CYCLIC_SUBSCRIPTION, raw=True
            )
        self.create_subscription(UInt8, 'sercos/phase', self._on_phase, LATCHED)
        self._participant = Participant(self, PLANT, parameters)
        self._greeter = self.create_timer(GREETING_S, self._greet)

    def _on_current(self, index: int) -> Callable[[bytes], None]:
        codec, waiting, axis = self._codecs[index], self._currents[index], DRIVES[index]
        known: dict[bytes, tuple[bool, float]] = {}

        def receive(data: bytes) -> None:
            try:
                sec, nanosec, frame, values = codec.decode(data)
                exchange = self._exchanges.count(sec, nanosec)
                if frame not in known:
                    known.clear()
                    known[frame] = telegram.parse_current_frame(frame)
            except TelegramError as error:
                self._refused += 1
                self.get_logger().warning(f'plant: {error}', throttle_duration_sec=1.0)
                return
            if exchange >= 0:
                waiting[exchange] = (*known[frame], values)
                self._advance()
            elif axis not in self._heard:
                self._heard.add(axis)
                self._participant.announce(tuple(sorted(self._heard)))

        return receive

    def _on_phase(self, message: UInt8) -> None:
        if message.data == Phase.CP4 and not self._cyclic:
            self._cyclic = True
            self._greeter.cancel()
            self._publish_shafts(self._exchanges.stamp(0))

    def _publish_shafts(self, stamp: tuple[int, int]) -> None:
        self._publish(self._shafts.encode(stamp, telegram.BASE_FRAME, self._plant.shafts()))

    def _advance(self) -> None:
        """Integrate every period whose currents are there from all three drives."""
        first, second, third = self._currents
        while self._exchange in first and self._exchange in second and self._exchange in third:
            brakes = []
            payload = 0.0
            for index, waiting in enumerate(self._currents):
                # all three drives pass on the same payload, that of the MDT before
                released, payload, self._matrix[:, index] = waiting.pop(self._exchange)
                brakes.append(released)
            self._plant.advance(self._matrix, brakes, payload)
            self._exchange += 1
            self._publish_shafts(self._exchanges.stamp(self._exchange))

    def _greet(self) -> None:
        """Before cyclic operation: let the drives know where the shafts stand, and hear who answers."""
        self._publish_shafts((ACYCLIC_SEC, 0))
        self._greetings += 1
        if self._greetings % REPORT_EVERY == 0:
            missing = [axis for axis in DRIVES if axis not in self._heard]
            waiting = f'waiting for {", ".join(missing)}' if missing else 'all drives are there'
            if waiting != self._waiting:
                self._waiting = waiting
                self.get_logger().info(f'plant: {waiting}')


def main() -> int:
    """Run the plant process."""
    return runtime.run_single(PlantNode)


if __name__ == '__main__':
    raise SystemExit(main())
