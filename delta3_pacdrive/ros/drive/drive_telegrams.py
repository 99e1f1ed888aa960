"""Cyclic telegrams of one drive.

In: ``sercos/mdt`` (commands), ``plant/motor_shafts`` (true shafts), with ``supply.enabled`` ``plant/dc_link``, with
``thermal.in_drives`` ``plant/temperatures``. Out: ``sercos/at/axisN`` (encoder, status), ``axisN/motor_current`` (I_eff
of every current-loop period), ``axisN/phase_current`` (I1s, I2s, I3s, on request).
"""

from sensor_msgs.msg import JointState

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.drive.bus_drive import BusDrive
from delta3_pacdrive.robot.drive.drive_clock import Command, Shaft
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.bus_time import ACYCLIC_SEC, Clock
from delta3_pacdrive.robot.sercos.telegram_codec import TelegramCodec
from delta3_pacdrive.robot.sercos.telegrams import NO_SESSION
from delta3_pacdrive.robot.sercos.words import Status
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire import cdr
from delta3_pacdrive.ros.wire.interfaces import (
    AT,
    DC_LINK,
    MDT,
    MOTOR_CURRENT,
    MOTOR_SHAFTS,
    PHASE_CURRENT,
    TEMPERATURES,
)
from delta3_pacdrive.ros.wire.publishers import Output

ACYCLIC = (ACYCLIC_SEC, 0)
RESTING = int(Status.READY_FOR_POWER)  # status word before cyclic operation


class DriveTelegrams:
    """Sends the telegrams of a drive, and receives them after ``receive_for``; ``index`` of the axis is 0-based."""

    def __init__(self, node: RobotNode, parameters: Parameters, index: int) -> None:
        bus = parameters.bus
        drives = parameters.axes
        self._node, self._index, self._axis, self._count = node, index, drives[index], len(drives)
        mounting = parameters.mounting
        self._motor, self._encoder = mounting.motor_of(index), mounting.encoder_of(index)
        self._cycles, self._exchanges = Clock(bus.cycle_time_s), Clock(bus.exchange_period_s)
        self._samples = round(bus.exchange_period_s / parameters.drive.current_period_s)
        self._bus_drive: BusDrive
        self.refused = 0  # rejected telegrams
        self._greeted = False
        self._frame = b''  # of the last MDT; rarely changes
        self._words = (0, 0, 0.0)  # control word, service channel word and payload of that frame
        self._newest_current = b''
        self._current_frames: dict[tuple[bool, float], bytes] = {}
        self._torques = parameters.sends_torque  # whether an MDT commands them
        self._mdt = cdr.codec(telegrams.mdt(self._torques, drives))
        self._at = cdr.codec(telegrams.at(self._axis))
        self._current = cdr.codec(telegrams.motor_current(self._axis, self._samples))
        self._shaft = cdr.codec(telegrams.shafts(drives))
        self._supplied, self._link = parameters.supply.enabled, cdr.codec(telegrams.DC_LINK)
        self._warms, self._warmth = parameters.thermal.in_drives, cdr.codec(telegrams.temperatures(drives))
        self.publish_at = cdr.raw_publish(AT.publisher(node, self._axis))  # takes an encoded AT
        self._publish_current = cdr.raw_publish(MOTOR_CURRENT.publisher(node, self._axis))
        self._phases = Output(node, PHASE_CURRENT, self._axis)

    def receive_for(self, bus_drive: BusDrive) -> None:
        """Start receiving for a drive."""
        self._bus_drive = bus_drive
        MDT.subscription(self._node, self._on_mdt, raw=True)
        MOTOR_SHAFTS.subscription(self._node, self._on_shafts, raw=True)
        if self._supplied:
            DC_LINK.subscription(self._node, self._on_dc_link, raw=True)
        if self._warms:
            TEMPERATURES.subscription(self._node, self._on_temperatures, raw=True)

    def refuse(self, reason: str) -> None:
        """Count and log a rejected telegram."""
        self.refused += 1
        self._node.get_logger().warning(reason, throttle_duration_sec=1.0)

    def greeted_by_plant(self) -> bool:
        """Whether the plant has greeted this drive since the last call."""
        greeted, self._greeted = self._greeted, False
        return greeted

    def clear_frames(self) -> None:
        """Clear the cached frames of the previous session."""
        self._frame = self._newest_current = b''
        self._current_frames.clear()

    # reception --------------------------------------------------------------------------------------------------------

    def _on_mdt(self, data: bytes) -> None:
        bus_drive = self._bus_drive
        session = bus_drive.slave.session
        if session == NO_SESSION:
            return
        try:
            sec, nanosec, frame, values = self._mdt.decode(data)
            cycle = self._cycles.count(sec, nanosec)
            if frame != self._frame:
                phase, control, service, payload = telegrams.parse_mdt_frame(
                    frame, self._index, session, self._count
                )
                bus_drive.phase = phase
                self._words, self._frame = (control, service, payload), frame
        except TelegramError as error:
            self.refuse(f'{self._axis}: {error}')
            return
        if cycle >= 0:
            torque = values[self._count + self._index] if self._torques else 0.0
            bus_drive.take_command(cycle, Command(values[self._index], *self._words, torque))
            return
        position = bus_drive.greeted(self._words[1])
        if position is not None:
            frame = telegrams.at_frame(RESTING, bus_drive.clock.service.to_send(), session)
            self.publish_at(self._at.encode(ACYCLIC, frame, (position, 0.0, 0.0)))

    def _on_shafts(self, data: bytes) -> None:
        bus_drive = self._bus_drive
        session = bus_drive.slave.session
        if session == NO_SESSION:
            return
        try:
            sec, nanosec, frame, values = self._shaft.decode(data)
            if frame != session:
                telegrams.require_session(frame, session)
            exchange = self._exchanges.count(sec, nanosec)
        except TelegramError as error:
            self.refuse(f'{self._axis}: {error}')
            return
        i, count = self._motor, self._count
        if exchange >= 0:
            shaft: Shaft = values[i], values[count + i], values[2 * count + i]
            if self._encoder != i:
                shaft = (*shaft, values[self._encoder], values[count + self._encoder])
            bus_drive.clock.take_shaft(exchange, shaft)
        elif not bus_drive.slave.cyclic:
            self._greeted = True
            bus_drive.drive.take_feedback(values[self._encoder], 0.0)
            bus_drive.set_rest_position(values[i])
            frame = telegrams.current_frame(False, 0.0, session)
            self._publish_current(self._current.encode(ACYCLIC, frame, (0.0,) * self._samples))

    def _on_dc_link(self, data: bytes) -> None:
        cycle, values = self._of_cycle(self._link, data, 'the state of the DC link')
        if cycle >= 0:
            self._bus_drive.clock.take_supply(cycle, values[:3])

    def _on_temperatures(self, data: bytes) -> None:
        cycle, values = self._of_cycle(self._warmth, data, 'a message of temperatures')
        if cycle >= 0:
            self._bus_drive.clock.take_temperatures(cycle, values[self._index :: self._count])

    def _of_cycle(self, codec: TelegramCodec, data: bytes, name: str) -> tuple[int, tuple[float, ...]]:
        """Return bus cycle and values of a message of the plant; the cycle is -1 if the message is rejected."""
        session = self._bus_drive.slave.session
        if session == NO_SESSION:
            return -1, ()
        try:
            sec, nanosec, frame, values = codec.decode(data)
            telegrams.require_session(frame, session, name)
            return self._cycles.count(sec, nanosec), values
        except TelegramError as error:
            self.refuse(f'{self._axis}: {error}')
            return -1, ()

    # transmission -----------------------------------------------------------------------------------------------------

    def send_answer(self, cycle: int, status: int) -> None:
        """Send the AT of a bus cycle."""
        bus_drive = self._bus_drive
        frame = telegrams.at_frame(status, bus_drive.clock.service.to_send(), bus_drive.slave.session)
        stamp = self._cycles.stamp(cycle)
        self.publish_at(self._at.encode(stamp, frame, bus_drive.drive.answer.tolist()))
        if self._phases.wanted:
            message = JointState(name=['I1s', 'I2s', 'I3s'], effort=bus_drive.drive.phase_currents())
            message.header.stamp.sec, message.header.stamp.nanosec = stamp
            self._phases.publish(message)

    def send_current(self, exchange: int, released: bool) -> None:
        """Send the currents of an exchange period and the brake output."""
        drive = self._bus_drive.drive
        frame = self._current_frames.get((released, drive.payload))
        if frame is None:
            frame = telegrams.current_frame(released, drive.payload, self._bus_drive.slave.session)
            self._current_frames[released, drive.payload] = frame
        self._newest_current = self._current.encode(
            self._exchanges.stamp(exchange), frame, drive.currents.tolist()
        )
        self._publish_current(self._newest_current)

    def repeat_current(self) -> None:
        """Send the currents of the newest exchange again."""
        if self._newest_current:
            self._publish_current(self._newest_current)
