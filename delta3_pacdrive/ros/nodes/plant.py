"""Node of the plant: three motors, brakes, gears and the coupled arms.

In: ``axisN/motor_current`` of the three drives (currents of a period, brake output), ``sercos/phase``. Out:
``plant/motor_shafts`` (true shaft positions, speeds and coupling torques d), one message per exchange period.

The plant keeps bus time: the world stands while the bus is not in cyclic operation. Whenever cyclic operation ends, the
machine goes on without current, its brakes falling, for ``REST_S`` of bus time, in which it comes to rest.
"""

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.faults.effects import apply_to_plant
from delta3_pacdrive.plant.plant import Plant
from delta3_pacdrive.ros import cdr, node_process
from delta3_pacdrive.ros.announcements import Participant
from delta3_pacdrive.ros.fault_injection import Faults
from delta3_pacdrive.ros.parameters import declare_robot
from delta3_pacdrive.ros.qos import CYCLIC_PUBLISHER, CYCLIC_SUBSCRIPTION, LATCHED
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.sercos.bus_time import ACYCLIC_SEC, Clock
from delta3_pacdrive.sercos.configuration_check import DRIVES, PLANT
from delta3_pacdrive.sercos.participants import Occasion
from delta3_pacdrive.sercos.watchdog import DRIVE_SILENT_S, PARTING_S, Watch
from delta3_pacdrive.sercos.words import Phase

GREETING_S = 0.02
HOUSEKEEPING_S = 0.1
REPORT_EVERY = 3  # looks between two reports of who is missing
REST_S = 1.0


class PlantNode(RobotNode):
    """The machine behind the drives."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('plant', **node_options)
        parameters = declare_robot(self)
        bus = parameters.bus
        self._plant = Plant(parameters)
        self._exchanges = Clock(bus.exchange_period_s)
        self._exchange = 0
        self._exchanges_per_cycle = round(bus.cycle_time_s / bus.exchange_period_s)
        self._rest_cycles = math.ceil(REST_S / bus.cycle_time_s)
        samples = round(bus.exchange_period_s / parameters.drive.current_period_s)
        self._matrix = np.zeros((samples, 3))
        self._currents: list[dict[int, tuple[bool, float, tuple[float, ...]]]] = [{}, {}, {}]
        self._payload: float | None = None
        self._silence = (0.0,) * samples
        self._powerless: set[int] = set()
        self._heard: set[str] = set()
        self._session = cdr.NO_SESSION
        self._cyclic = False
        self._falling = False  # the phase has fallen, the drives are about to leave
        self._drives = Watch(HOUSEKEEPING_S)
        self._refused = 0
        self._waiting = ''
        self._looks = 0

        # what back-EMF at twice the maximum speed would drive through a short at the motor
        motor = parameters.motor
        emf_v = motor.torque_constant_n_m_a / 3.0 * 2.0 * motor.max_speed_rad_s
        most_a = motor.peak_current_a + emf_v / (motor.winding_resistance_ohm / 2.0)
        self._codecs = [cdr.current_codec(axis, samples, most_a) for axis in DRIVES]
        self._frames: dict[bytes, tuple[bool, float]] = {}  # the newest that were read
        self._shafts = cdr.shafts_codec()
        self._publish = cdr.raw_publish(
            self.create_publisher(JointState, 'plant/motor_shafts', CYCLIC_PUBLISHER)
        )
        for index, axis in enumerate(DRIVES):
            self.create_subscription(
                JointState, f'{axis}/motor_current', self._on_current(index), CYCLIC_SUBSCRIPTION, raw=True
            )
        self.create_bounded_subscription(Header, 'sercos/phase', self._on_phase, LATCHED, refuse=self._refuse)
        self._participant = Participant(self, PLANT, parameters)
        self._faults = Faults(
            self, PLANT, lambda: self._exchange // self._exchanges_per_cycle, lambda: self._session
        )
        self._greeter = self.create_timer(GREETING_S, self._greet)
        self.create_timer(HOUSEKEEPING_S, self._housekeeping)

    def _on_current(self, index: int) -> Callable[[bytes], None]:
        codec, waiting, axis = self._codecs[index], self._currents[index], DRIVES[index]
        known = self._frames

        def receive(data: bytes) -> None:
            if self._session == cdr.NO_SESSION:
                return
            try:
                sec, nanosec, frame, values = codec.decode(data)
                exchange = self._exchanges.count(sec, nanosec)
                if frame not in known:
                    if len(known) > len(DRIVES):
                        known.clear()
                    known[frame] = cdr.parse_current_frame(frame, self._session)
            except TelegramError as error:
                self._refuse(str(error))
                return
            if exchange > self._exchange + self._exchanges_per_cycle:
                self._refused += 1  # ahead of what it can know
            elif exchange >= self._exchange and exchange not in waiting:
                waiting[exchange] = (*known[frame], values)
                self._advance()
            elif exchange < 0 and not self._cyclic and axis not in self._heard:
                self._heard.add(axis)
                self._announce(self._session)

        return receive

    def _refuse(self, reason: str) -> None:
        self._refused += 1
        self.get_logger().warning(f'plant: {reason}', throttle_duration_sec=1.0)

    def _announce(self, session: bytes, occasion: Occasion = Occasion.CALLED) -> None:
        # its last message of shafts was that of the present exchange
        over = -(-self._exchange // self._exchanges_per_cycle) + 1 if self._exchange else 0
        self._participant.announce(session, occasion, tuple(sorted(self._heard)), over)

    # phases of the bus ------------------------------------------------------------------------------------------------

    def _on_phase(self, message: Header) -> None:
        phase, session, stamp = cdr.parse_phase(message)
        exchange = self._exchanges.count(*stamp)
        if self._cyclic and self.count_publishers('sercos/phase') > 1:
            return  # a second master, or a stranger; a new master announces itself again when the last one has gone
        if phase == Phase.CP0:
            self._falling = self._cyclic
            if not self._cyclic:
                self._session = cdr.NO_SESSION
                self._heard.clear()
                self._announce(session)
        elif phase != Phase.CP4:
            if self._cyclic:
                self._come_to_rest()
            if session != self._session:
                self._session = session
                self._frames.clear()
                self._heard.clear()
        elif session == self._session and not self._cyclic:
            self._join(exchange)
        elif self._session == cdr.NO_SESSION:
            self._announce(session, Occasion.STARTED)

    def _join(self, exchange: int) -> None:
        """Begin cyclic operation; bus time goes on there."""
        self._exchange = max(self._exchange, exchange)
        for waiting in self._currents:
            waiting.clear()
        self._powerless.clear()
        self._cyclic, self._falling = True, False
        self._drives.heard(time.monotonic())
        self._greeter.cancel()
        self._publish_shafts(self._exchanges.stamp(self._exchange))

    def _come_to_rest(self) -> None:
        """Let the machine go on without current until it stands; then the world stands as well."""
        start = -(-self._exchange // self._exchanges_per_cycle)
        end = (start + self._rest_cycles) * self._exchanges_per_cycle
        self._powerless.update(range(len(DRIVES)))
        while self._exchange < end:
            self._integrate()
        left, self._session = self._session, cdr.NO_SESSION
        self._cyclic = self._falling = False
        self._heard.clear()
        self._greeter.reset()
        self._announce(left, Occasion.LEFT)
        self.get_logger().info(f'plant: at rest in bus cycle {end // self._exchanges_per_cycle}')

    # motion -----------------------------------------------------------------------------------------------------------

    def _publish_shafts(self, stamp: tuple[int, int]) -> None:
        self._publish(self._shafts.encode(stamp, self._session, self._plant.shafts()))

    def _advance(self) -> None:
        """Integrate every period whose currents are there from all drives that have power."""
        first, second, third = self._currents
        while True:
            exchange = self._exchange
            if not (exchange in first and exchange in second and exchange in third):
                if len(self._powerless) == len(DRIVES):
                    self._come_to_rest()
                    return
                if not self._powerless or not self._others_are_there():
                    return
            self._integrate()
            self._drives.heard(time.monotonic())

    def _others_are_there(self) -> bool:
        """Whether all drives that have power have sent their currents."""
        return all(
            self._exchange in waiting or index in self._powerless
            for index, waiting in enumerate(self._currents)
        )

    def _integrate(self) -> None:
        if self._exchange >= self._faults.next_cycle * self._exchanges_per_cycle:
            changes = self._faults.begin_and_end(self._exchange // self._exchanges_per_cycle)
            apply_to_plant(self._plant.state[0], changes, self._faults.active)
        brakes = []
        for index, waiting in enumerate(self._currents):
            released = False
            values = self._silence
            current = waiting.pop(self._exchange, None)
            if current is not None and index not in self._powerless:
                # all three drives pass on the same payload, that of the MDT before
                released, self._payload, values = current
            self._matrix[:, index] = values
            brakes.append(released)
        self._plant.advance(self._matrix, brakes, self._payload)
        self._exchange += 1
        self._publish_shafts(self._exchanges.stamp(self._exchange))

    def _check_silence(self) -> None:
        silence = self._drives.silence_s(time.monotonic())
        if silence <= (PARTING_S if self._falling else DRIVE_SILENT_S):
            return
        silent = [index for index, waiting in enumerate(self._currents) if self._exchange not in waiting]
        self._powerless.update(silent)
        names = ', '.join(DRIVES[index] for index in silent)
        self.get_logger().error(f'plant: no current of {names} for {silence:.1f} s: without power')
        self._advance()

    # before cyclic operation ------------------------------------------------------------------------------------------

    def _greet(self) -> None:
        """Let the drives know where the shafts stand, and hear who answers."""
        if self._session != cdr.NO_SESSION:
            self._publish_shafts((ACYCLIC_SEC, 0))

    def _housekeeping(self) -> None:
        if self._cyclic:
            self._check_silence()
            return
        self._looks += 1
        if self._looks % REPORT_EVERY == 0:
            missing = [axis for axis in DRIVES if self.count_publishers(f'{axis}/motor_current') == 0]
            waiting = f'waiting for {", ".join(missing)}' if missing else 'all drives are there'
            if waiting != self._waiting:
                self._waiting = waiting
                self.get_logger().info(f'plant: {waiting}')


def main() -> int:
    """Run the plant process."""
    return node_process.run_single(PlantNode)


if __name__ == '__main__':
    raise SystemExit(main())
