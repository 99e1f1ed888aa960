"""Node of the plant: three motors, brakes, gears and the coupled arms.

In: ``axisN/motor_current`` of the three drives (currents of a period, brake output), ``sercos/phase``. Out:
``plant/motor_shafts`` (true shaft positions, speeds and coupling torques d), one message per exchange period. When the
plant goes on, and how it comes to rest: see ``plant_clock``; how it takes part in the bus: see ``sercos.slave``.

It is longer than other nodes because it serves three drives, greets them, and decides which of them has lost power.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any

from std_msgs.msg import Header

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.plant.plant_clock import PlantClock
from delta3_pacdrive.ros import cdr, node_process
from delta3_pacdrive.ros.announcements import Participant
from delta3_pacdrive.ros.fault_injection import Faults
from delta3_pacdrive.ros.interfaces import MOTOR_CURRENT, MOTOR_SHAFTS, PHASE
from delta3_pacdrive.ros.parameters import declare_robot
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.sercos import slave, telegrams
from delta3_pacdrive.sercos.bus_time import ACYCLIC_SEC, Clock
from delta3_pacdrive.sercos.configuration_check import DRIVES, PLANT
from delta3_pacdrive.sercos.participants import Occasion
from delta3_pacdrive.sercos.slave import BusSlave
from delta3_pacdrive.sercos.telegrams import NO_SESSION
from delta3_pacdrive.sercos.watchdog import DRIVE_SILENT_S, PARTING_S, Watchdog

GREETING_S = 0.02
HOUSEKEEPING_S = 0.1
REPORT_EVERY = 3  # looks between two reports of who is missing


class PlantNode(RobotNode):
    """The node lets the machine behind the drives take part in the bus."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('plant', **node_options)
        parameters = declare_robot(self)
        self._exchanges = Clock(parameters.bus.exchange_period_s)
        self._slave = BusSlave()
        self._faults = Faults(self, PLANT, lambda: self._plant_clock.cycle, lambda: self._slave.session)
        self._plant_clock = PlantClock(parameters, self._faults, self._publish_shafts)
        self._frame = NO_SESSION  # of the shafts
        self._frames: dict[bytes, tuple[bool, float]] = {}  # of currents, the newest that were read
        self._linked: set[str] = set()
        self._drives = Watchdog(HOUSEKEEPING_S)
        self._waiting = ''
        self._looks = 0
        self._ways: dict[type, Callable[[Any], None]] = {
            slave.Answer: lambda action: self._announce(action.session),
            slave.Report: lambda action: self._announce(action.session, Occasion.STARTED),
            slave.Adopt: self._adopt,
            slave.Join: self._join,
            slave.Part: lambda _: None,  # the drives stop, and are waited for
            slave.Leave: self._leave,
        }
        # what back-EMF at twice the maximum speed would drive through a short at the motor
        motor = parameters.motor
        emf_v = motor.torque_constant_n_m_a / 3.0 * 2.0 * motor.max_speed_rad_s
        most_a = motor.peak_current_a + emf_v / (motor.winding_resistance_ohm / 2.0)
        self._codecs = [
            cdr.codec(telegrams.motor_current(axis, self._plant_clock.samples), most_a) for axis in DRIVES
        ]
        self._shafts = cdr.codec(telegrams.SHAFTS)
        self._publish = cdr.raw_publish(MOTOR_SHAFTS.publisher(self))
        for index, axis in enumerate(DRIVES):
            MOTOR_CURRENT.subscription(self, self._on_current(index), axis, raw=True)
        PHASE.bounded_subscription(self, self._on_phase, refuse=self._refuse)
        self._participant = Participant(self, PLANT, parameters)
        self._greeter = self.create_timer(GREETING_S, self._greet)
        self.create_timer(HOUSEKEEPING_S, self._housekeeping)

    # telegrams --------------------------------------------------------------------------------------------------------

    def _on_current(self, index: int) -> Callable[[bytes], None]:
        codec, axis, known = self._codecs[index], DRIVES[index], self._frames
        count, take, bus = self._exchanges.count, self._plant_clock.take, self._slave

        def receive(data: bytes) -> None:
            if bus.session == NO_SESSION:
                return
            try:
                sec, nanosec, frame, values = codec.decode(data)
                exchange = count(sec, nanosec)
                if frame not in known:
                    if len(known) > len(DRIVES):
                        known.clear()
                    known[frame] = telegrams.parse_current_frame(frame, bus.session)
            except TelegramError as error:
                self._refuse(str(error))
                return
            if exchange >= 0:
                take(index, exchange, *known[frame], values)
            elif not bus.cyclic and axis not in self._linked:
                self._linked.add(axis)
                self._announce(bus.session)

        return receive

    def _refuse(self, reason: str) -> None:
        self.get_logger().warning(f'plant: {reason}', throttle_duration_sec=1.0)

    def _publish_shafts(self, exchange: int, shafts: Sequence[float]) -> None:
        self._publish(self._shafts.encode(self._exchanges.stamp(exchange), self._frame, shafts))
        self._drives.received(time.monotonic())

    # the bus ----------------------------------------------------------------------------------------------------------

    def _on_phase(self, message: Header) -> None:
        phase, session, stamp = cdr.parse_phase(message)
        alone = self.count_publishers('sercos/phase') <= 1
        exchange = self._exchanges.count(*stamp)
        self._carry_out(self._slave.announced(phase, session, exchange, moves=True, alone=alone))

    def _carry_out(self, actions: Sequence[slave.Action]) -> None:
        for action in actions:
            self._ways[type(action)](action)

    def _announce(self, session: bytes, occasion: Occasion = Occasion.CALLED) -> None:
        links = tuple(sorted(self._linked))
        self._participant.announce(session, occasion, links, self._plant_clock.cycles_over)

    def _adopt(self, action: slave.Adopt) -> None:
        self._frame = action.session
        self._frames.clear()
        self._linked.clear()

    def _join(self, action: slave.Join) -> None:
        self._greeter.cancel()
        self._plant_clock.begin(action.start)

    def _leave(self, action: slave.Leave) -> None:
        self._linked.clear()
        if action.cyclic:
            cycle = self._plant_clock.come_to_rest()
            self._greeter.reset()
            self._announce(action.session, Occasion.LEFT)
            self.get_logger().info(f'plant: at rest in bus cycle {cycle}')

    # looks ------------------------------------------------------------------------------------------------------------

    def _greet(self) -> None:
        """Let the drives know where the shafts stand, and see who answers."""
        if self._slave.session != NO_SESSION:
            self._publish(self._shafts.encode((ACYCLIC_SEC, 0), self._frame, self._plant_clock.shafts()))

    def _housekeeping(self) -> None:
        if self._slave.cyclic:
            self._check_silence()
            return
        self._looks += 1
        if self._looks % REPORT_EVERY == 0:
            missing = [axis for axis in DRIVES if self.count_publishers(f'{axis}/motor_current') == 0]
            waiting = f'waiting for {", ".join(missing)}' if missing else 'all drives are there'
            if waiting != self._waiting:
                self._waiting = waiting
                self.get_logger().info(f'plant: {waiting}')

    def _check_silence(self) -> None:
        silence = self._drives.silence_s(time.monotonic())
        if silence <= (PARTING_S if self._slave.parting else DRIVE_SILENT_S):
            return
        silent = self._plant_clock.silent()
        names = ', '.join(DRIVES[index] for index in silent)
        self.get_logger().error(f'plant: no current of {names} for {silence:.1f} s: without power')
        if not self._plant_clock.drop(silent):
            self._carry_out(self._slave.rest())


def main() -> int:
    """Run the plant process."""
    return node_process.run_single(PlantNode)


if __name__ == '__main__':
    raise SystemExit(main())
