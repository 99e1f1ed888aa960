"""Node of one MC-4 servo drive.

In: ``sercos/phase``, ``sercos/mdt`` (commands), ``plant/motor_shafts`` (true shafts). Out: ``sercos/at/axisN``
(encoder, status), ``axisN/motor_current`` (I_eff of every current-loop period), ``axisN/phase_current`` (I1s, I2s, I3s,
on request), ``/diagnostics`` (1 Hz). When the drive goes on, and how it takes part in the bus: see
``drive.bus_drive``.

It is longer than other nodes because a drive has four kinds of telegrams, parameters, and people who look at it.
"""

import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from delta3_pacdrive.drive.bus_drive import BusDrive
from delta3_pacdrive.drive.diagnostics import DriveFault, fault_text
from delta3_pacdrive.drive.report import report
from delta3_pacdrive.errors import ParameterError, Reason, TelegramError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.ros import cdr, node_process
from delta3_pacdrive.ros.announcements import Participant
from delta3_pacdrive.ros.diagnostics import Health
from delta3_pacdrive.ros.drive_parameters import WRITABLE, DriveParameters
from delta3_pacdrive.ros.fault_injection import Faults
from delta3_pacdrive.ros.interfaces import AT, MDT, MOTOR_CURRENT, MOTOR_SHAFTS, PHASE, PHASE_CURRENT
from delta3_pacdrive.ros.parameters import declare, declare_robot, descriptor
from delta3_pacdrive.ros.publishers import Output
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.sercos import telegrams
from delta3_pacdrive.sercos.bus_time import ACYCLIC_SEC, Clock
from delta3_pacdrive.sercos.configuration_check import DRIVES
from delta3_pacdrive.sercos.participants import Occasion
from delta3_pacdrive.sercos.telegrams import NO_SESSION
from delta3_pacdrive.sercos.words import Status

HOUSEKEEPING_S = 0.25
HEALTH_EVERY = 4
RESTING = int(Status.READY_FOR_POWER)  # status word before cyclic operation


class MC4DriveNode(RobotNode):
    """The node lets one drive take part in the graph.

    Attributes
    ----------
    drive
        The drive, without ROS.
    publish_at
        Sends an AT, given as bytes.

    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__('mc4_drive', **node_options)
        number = declare(self, 'axis', 0, descriptor('number of the axis, 1 to 3', 0, len(DRIVES), int))
        if not number:
            raise ParameterError(f'{self.get_fully_qualified_name()} needs the parameter axis: 1, 2 or 3')
        parameters = declare_robot(self, frozenset(WRITABLE))
        self._index = number - 1
        self._axis = axis = DRIVES[self._index]
        self._cycles = Clock(parameters.bus.cycle_time_s)
        self._exchanges = Clock(parameters.bus.exchange_period_s)
        faults = Faults(self, axis, lambda: self._drive_clock.cycle, lambda: self._slave.session)
        self._bus_drive = BusDrive(parameters, self._index, faults, self, HOUSEKEEPING_S, time.monotonic)
        self._drive_clock, self._slave = self._bus_drive.clock, self._bus_drive.slave
        self.drive = self._bus_drive.drive
        self._settings = DriveParameters(self, axis, self._bus_drive.register)
        self._frame = b''  # of the last MDT: it rarely changes
        self._words = (0, 0, 0.0)  # its control word, word of the service channel and payload
        self._current_frames: dict[tuple[bool, float], bytes] = {}
        self._reported_fault = DriveFault.NONE
        self._refused = 0
        self._waiting = ''
        self._looks = 0
        self._mdt = cdr.codec(telegrams.MDT)
        self._at = cdr.codec(telegrams.AT[self._index])
        self._current = cdr.codec(telegrams.motor_current(axis, len(self.drive.currents)))
        self._shaft = cdr.codec(telegrams.SHAFTS)
        self.publish_at = cdr.raw_publish(AT.publisher(self, axis))
        self._publish_current = cdr.raw_publish(MOTOR_CURRENT.publisher(self, axis))
        self._phases = Output(self, PHASE_CURRENT, axis)
        PHASE.bounded_subscription(self, self._on_phase, refuse=self.refuse)
        MDT.subscription(self, self._on_mdt, raw=True)
        MOTOR_SHAFTS.subscription(self, self._on_shafts, raw=True)
        self._participant = Participant(self, axis, parameters)
        self._health = Health(self, axis)
        self.create_timer(HOUSEKEEPING_S, self._housekeeping)

    # what comes in ----------------------------------------------------------------------------------------------------

    def _on_phase(self, message: Header) -> None:
        phase, session, stamp = cdr.parse_phase(message)
        alone = self.count_publishers('sercos/phase') <= 1
        self._bus_drive.announced(phase, session, self._cycles.count(*stamp), alone)

    def _on_mdt(self, data: bytes) -> None:
        session = self._slave.session
        if session == NO_SESSION:
            return
        try:
            sec, nanosec, frame, values = self._mdt.decode(data)
            cycle = self._cycles.count(sec, nanosec)
            if frame != self._frame:
                phase, control, service, payload = telegrams.parse_mdt_frame(frame, self._index, session)
                self._bus_drive.phase = phase
                self._words, self._frame = (control, service, payload), frame
        except TelegramError as error:
            self.refuse(f'{self._axis}: {error}')
            return
        if cycle >= 0:
            self._bus_drive.take_command(cycle, (values[self._index], *self._words))
            return
        position = self._bus_drive.greeted(self._words[1])
        if position is not None:
            frame = telegrams.at_frame(RESTING, self._drive_clock.service.to_send(), session)
            self.publish_at(self._at.encode((ACYCLIC_SEC, 0), frame, (position, 0.0, 0.0)))

    def _on_shafts(self, data: bytes) -> None:
        session = self._slave.session
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
        i = self._index
        if exchange >= 0:
            self._drive_clock.take_shaft(exchange, (values[i], values[3 + i], values[6 + i]))
        elif not self._slave.cyclic:
            self._bus_drive.stand(values[i])
            nothing = (0.0,) * len(self.drive.currents)
            frame = telegrams.current_frame(False, 0.0, session)
            self._publish_current(self._current.encode((ACYCLIC_SEC, 0), frame, nothing))

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set what a ROS service asks for."""
        accepted = self._settings.accepted(parameter_list)
        if isinstance(accepted, Reason):
            return SetParametersResult(successful=False, reason=accepted.sentence)
        return super().set_parameters_atomically(accepted)

    # what the drive does ----------------------------------------------------------------------------------------------

    def announce(self, session: bytes, occasion: Occasion) -> None:
        """Announce the drive in a session."""
        self._participant.announce(session, occasion)

    def forget(self) -> None:
        """Forget frames of the session before."""
        self._frame = b''
        self._current_frames.clear()

    def send_answer(self, cycle: int, status: int) -> None:
        """Send the AT of a bus cycle."""
        frame = telegrams.at_frame(status, self._drive_clock.service.to_send(), self._slave.session)
        stamp = self._cycles.stamp(cycle)
        self.publish_at(self._at.encode(stamp, frame, self.drive.answer.tolist()))
        if self._phases.wanted:
            message = JointState(name=['I1s', 'I2s', 'I3s'], effort=self.drive.phase_currents())
            message.header.stamp.sec, message.header.stamp.nanosec = stamp
            self._phases.publish(message)

    def send_current(self, exchange: int, released: bool) -> None:
        """Send the currents of an exchange period and the brake output."""
        drive = self.drive
        frame = self._current_frames.get((released, drive.payload))
        if frame is None:
            frame = telegrams.current_frame(released, drive.payload, self._slave.session)
            self._current_frames[released, drive.payload] = frame
        self._publish_current(
            self._current.encode(self._exchanges.stamp(exchange), frame, drive.currents.tolist())
        )

    def changed(self, parameters: Parameters, cycle: int) -> None:
        """Let the ROS parameters follow those that were written in a bus cycle."""
        self._settings.follow(parameters, cycle)

    def refuse(self, reason: str) -> None:
        """Count and say that a telegram was refused."""
        self._refused += 1
        self.get_logger().warning(reason, throttle_duration_sec=1.0)

    def tell_loss(self, reason: str) -> None:
        """Say why the drive goes on without its master."""
        self.get_logger().error(reason)

    # looks ------------------------------------------------------------------------------------------------------------

    def _housekeeping(self) -> None:
        self._tell_fault()
        self._looks += 1
        if self._looks % HEALTH_EVERY == 0 and self._health.wanted:
            self._send_health()
        if self._slave.cyclic:
            self._bus_drive.look()
            return
        waiting = ''
        if self.count_publishers('plant/motor_shafts') == 0:
            waiting = 'waiting for plant'
        elif self.count_publishers('sercos/mdt') == 0:
            waiting = 'waiting for transformation_task'
        if waiting != self._waiting:
            self._waiting = waiting
            self.get_logger().info(f'{self._axis}: {waiting or "all partners are there"}')

    def _tell_fault(self) -> None:
        fault = self.drive.fault
        if fault == self._reported_fault:
            return
        self._reported_fault = fault
        if fault:
            self.get_logger().error(f'{self._axis}: {fault_text(fault)}')
        else:
            self.get_logger().info(f'{self._axis}: fault cleared')

    def diagnostics(self) -> dict[str, Any]:
        """What the drive says of itself, by SERCOS names."""
        counted = {'late_telegrams': self._drive_clock.late, 'refused_telegrams': self._refused}
        return report(self.drive) | counted

    def _send_health(self) -> None:
        drive = self.drive
        level = DiagnosticStatus.ERROR if drive.fault else DiagnosticStatus.OK
        if not drive.fault and drive.warning:
            level = DiagnosticStatus.WARN
        self._health.send(level, fault_text(drive.fault), self.diagnostics())


def main() -> int:
    """Run one drive process."""
    return node_process.run_single(MC4DriveNode)


if __name__ == '__main__':
    raise SystemExit(main())
