"""Node of the plant: motors, brakes, gears, the coupled arms, and up to two rotary axes.

In: ``axisN/motor_current`` of the drives (currents of a period, brake output), ``sercos/phase``. Out:
``plant/motor_shafts`` (true shaft positions, speeds and coupling torques d), one message per exchange period, and with
``supply.enabled`` ``plant/dc_link``, with ``thermal.in_drives`` ``plant/temperatures``, one per bus cycle. Timing:
``robot.plant.plant_clock``; bus participation: ``robot.plant.bus_plant``; the cell around the robot: ``plant_cell``.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any

from std_msgs.msg import Header

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.robot.drive.bus_drive import own_parameters
from delta3_pacdrive.robot.faults.fault import TASK
from delta3_pacdrive.robot.plant.bus_plant import BusPlant, current_max_a
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.bus_time import ACYCLIC_SEC, Clock
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES, PLANT
from delta3_pacdrive.robot.sercos.telegrams import NO_SESSION
from delta3_pacdrive.robot.sercos.words import Phase
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.fault_injection import Faults
from delta3_pacdrive.ros.parameters import declare_own, declare_robot
from delta3_pacdrive.ros.plant_cell import InputRequests, PlantCell
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire import cdr
from delta3_pacdrive.ros.wire.announcements import Participant
from delta3_pacdrive.ros.wire.interfaces import DC_LINK, MOTOR_CURRENT, MOTOR_SHAFTS, PHASE, TEMPERATURES

KIND = 'plant'
GREETING_S = 0.02
HOUSEKEEPING_S = 0.1
REPORT_EVERY = 3  # housekeeping periods between two reports of missing drives


class PlantNode(RobotNode):
    """Connects the plant to the bus."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__(KIND, **node_options)
        own = declare_own(self, KIND)
        parameters = declare_robot(self, KIND)
        path, start_cycle = own['cell'], own['cell_start_cycle']
        self._cell = cell = PlantCell(self, path, start_cycle, parameters) if path else None
        self._exchanges = Clock(parameters.bus.exchange_period_s)
        self._frame = NO_SESSION  # of the shafts
        self._frames: dict[bytes, tuple[bool, float]] = {}  # newest parsed frames of currents
        self._waiting = ''
        self._looks = 0
        around = (cell.inputs, cell.belts) if cell else ()
        self._participant = Participant(self, PLANT, parameters, *around)
        self.announce = self._participant.announce
        self._partners = node_process.PartnerWatch(self.get_logger().warning, HOUSEKEEPING_S)
        self._is_outside_bus = False
        faults = Faults(self, PLANT, lambda: plant.clock.cycle, lambda: plant.slave.session)
        self._bus_plant = plant = BusPlant(
            parameters=parameters,
            faults=faults,
            port=self,
            poll_s=HOUSEKEEPING_S,
            now_s=time.monotonic,
            around=cell.around if cell else None,
        )
        self._drives = parameters.axes
        self._codecs = [
            cdr.codec(
                telegrams.motor_current(axis, plant.clock.samples),
                current_max_a(own_parameters(parameters, index)[0].motor),
            )
            for index, axis in enumerate(self._drives)
        ]
        self._shafts = cdr.codec(telegrams.shafts(self._drives))
        self._publish = cdr.raw_publish(MOTOR_SHAFTS.publisher(self))
        self._cycles = Clock(parameters.bus.cycle_time_s)
        if parameters.thermal.in_drives:
            self._warmth = cdr.codec(telegrams.temperatures(self._drives))
            self._publish_temperatures = cdr.raw_publish(TEMPERATURES.publisher(self))
        if parameters.supply.enabled:
            self._link = cdr.codec(telegrams.DC_LINK)
            self._publish_link = cdr.raw_publish(DC_LINK.publisher(self))
        for index, axis in enumerate(self._drives):
            MOTOR_CURRENT.subscription(self, self._on_current(index), axis, raw=True)
        PHASE.bounded_subscription(self, self._on_phase, refuse=self._refuse)
        if cell:
            cell.receive_for(plant)
        self._requests = InputRequests(self, cell.around if cell else None)
        self._greeter = self.create_timer(GREETING_S, self._greet)
        self.create_timer(HOUSEKEEPING_S, self._housekeeping)

    # subscriptions ----------------------------------------------------------------------------------------------------

    def _on_phase(self, message: Header) -> None:
        phase, session, stamp = cdr.parse_phase(message)
        alone = self.count_publishers('sercos/phase') <= 1
        self._bus_plant.announced(phase, session, self._exchanges.count(*stamp), alone)
        self._partners.received(TASK)
        self._is_outside_bus = phase == Phase.CP4 and not self._bus_plant.slave.cyclic

    def _on_current(self, index: int) -> Callable[[bytes], None]:
        codec, known, bus, plant = self._codecs[index], self._frames, self._bus_plant.slave, self._bus_plant
        count, take = self._exchanges.count, self._bus_plant.clock.take

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
            else:
                plant.greeted(index)

        return receive

    def _refuse(self, reason: str) -> None:
        self.get_logger().warning(f'plant: {reason}', throttle_duration_sec=1.0)

    # callbacks of the plant -------------------------------------------------------------------------------------------

    def belong(self, session: bytes) -> None:
        """Use a session in the frames."""
        self._frame = session
        self._frames.clear()
        if self._cell:
            self._cell.forget()

    def greet(self, begins: bool) -> None:
        """Start or stop greeting the drives."""
        if begins:
            self._greeter.reset()
        else:
            self._greeter.cancel()

    def send_shafts(self, exchange: int, shafts: Sequence[float]) -> None:
        """Send the true shafts at the start of an exchange period."""
        self._publish(self._shafts.encode(self._exchanges.stamp(exchange), self._frame, shafts))

    def send_link(self, cycle: int, values: Sequence[float]) -> None:
        """Send the state of the DC link at the start of a bus cycle."""
        self._publish_link(self._link.encode(self._cycles.stamp(cycle), self._frame, values))

    def send_temperatures(self, cycle: int, values: Sequence[float]) -> None:
        """Send the temperatures of motors and drives at the start of a bus cycle."""
        self._publish_temperatures(self._warmth.encode(self._cycles.stamp(cycle), self._frame, values))

    def report_rest(self, sentence: str) -> None:
        """Log that the machine is at rest."""
        self.get_logger().info(sentence)

    def report_loss(self, sentence: str) -> None:
        """Log which drives have lost power."""
        self.get_logger().error(sentence)

    # timers -----------------------------------------------------------------------------------------------------------

    def _greet(self) -> None:
        """Send the shaft positions to the drives before cyclic operation."""
        if self._bus_plant.slave.session != NO_SESSION:
            shafts = self._bus_plant.clock.shafts()
            self._publish(self._shafts.encode((ACYCLIC_SEC, 0), self._frame, shafts))

    def _housekeeping(self) -> None:
        # in cyclic operation others monitor the bus, and a bus that runs without this plant does not call it
        cyclic = self._bus_plant.slave.cyclic
        self._partners.update(() if cyclic or self._is_outside_bus else (TASK,), time.monotonic())
        if cyclic:
            self._bus_plant.poll()
            return
        self._looks += 1
        if self._looks % REPORT_EVERY == 0:
            missing = [axis for axis in self._drives if self.count_publishers(f'{axis}/motor_current') == 0]
            waiting = f'waiting for {", ".join(missing)}' if missing else 'all drives are available'
            if waiting != self._waiting:
                self._waiting = waiting
                self.get_logger().info(f'plant: {waiting}')


def main() -> int:
    """Run the plant process."""
    return node_process.run_single(PlantNode)
