"""Node of one MC-4 servo drive.

In: ``sercos/phase``, ``sercos/mdt`` (commands), ``plant/motor_shafts`` (true shafts). Out: ``sercos/at/axisN``
(encoder, status), ``axisN/motor_current`` (I_eff of every current-loop period), ``axisN/phase_current`` (I1s, I2s, I3s,
on request), ``/diagnostics`` (1 Hz). When the drive goes on: see ``drive_clock``; how it takes part in the bus: see
``sercos.slave``.

It is longer than other nodes because a drive has four ends: bus, shaft, service channel with parameters, and people.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from delta3_pacdrive.drive.diagnostics import DriveFault, fault_text
from delta3_pacdrive.drive.drive_clock import Command, DriveClock, Taken
from delta3_pacdrive.drive.mc4 import MC4
from delta3_pacdrive.drive.register import Register
from delta3_pacdrive.drive.report import report
from delta3_pacdrive.errors import ParameterError, Reason, TelegramError
from delta3_pacdrive.faults.fault import MDT_FAULTS
from delta3_pacdrive.faults.telegram_faults import FaultyLink
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
from delta3_pacdrive.sercos import slave, telegrams
from delta3_pacdrive.sercos.bus_time import ACYCLIC_SEC, Clock
from delta3_pacdrive.sercos.configuration_check import DRIVES
from delta3_pacdrive.sercos.participants import Occasion
from delta3_pacdrive.sercos.slave import BusSlave
from delta3_pacdrive.sercos.telegrams import NO_SESSION
from delta3_pacdrive.sercos.watchdog import BUS_SILENT_S, MASTER_SILENT_S, Watchdog
from delta3_pacdrive.sercos.words import Phase, Status

HOUSEKEEPING_S = 0.25
HEALTH_EVERY = 4
AHEAD = 2  # cycles by which a drive may be behind the others
RESTING = int(Status.READY_FOR_POWER)  # status word before cyclic operation


class MC4DriveNode(RobotNode):
    """The node lets one drive take part in the bus.

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
        bus = parameters.bus
        self._index = number - 1
        self._axis = axis = DRIVES[self._index]
        self.drive = MC4(parameters, self._index)
        self._slave = BusSlave()
        self._cycles, self._exchanges = Clock(bus.cycle_time_s), Clock(bus.exchange_period_s)
        self._per_cycle = round(bus.cycle_time_s / bus.exchange_period_s)
        self._ahead_max = (
            bus.outstanding_cycles_max + AHEAD
        )  # cycles by which an MDT may come before its time
        self._faults = Faults(self, axis, lambda: self._drive_clock.cycle, lambda: self._slave.session)
        self._link: FaultyLink[Command] = FaultyLink(self._faults, MDT_FAULTS, self._refuse)
        self._register = Register(parameters, self._actual, self._configure, self.drive.clear_fault)
        self._settings = DriveParameters(self, axis, self._register)
        self._drive_clock = DriveClock(
            self.drive,
            axis,
            parameters,
            self._faults,
            lambda access: self._register.serve(access, self._words[0]),
            self._send_answer,
            self._send_current,
            lambda: self._carry_out(self._slave.rest()),
        )
        self._master = Watchdog(HOUSEKEEPING_S)
        self._frame = b''  # of the last MDT: it rarely changes
        # its phase, control word, word of the service channel and payload
        self._words: tuple[Phase, int, int, float] = (Phase.CP0, 0, 0, 0.0)
        self._current_frames: dict[tuple[bool, float], bytes] = {}
        self._resting_position: float | None = None
        self._reported_fault = DriveFault.NONE
        self._refused = 0
        self._waiting = ''
        self._looks = 0
        self._exchange_seen = 0  # at the last look
        self._ways: dict[type, Callable[[Any], None]] = {
            slave.Answer: lambda action: self._participant.announce(action.session),
            slave.Report: lambda action: self._participant.announce(action.session, Occasion.STARTED),
            slave.Adopt: lambda _: self._current_frames.clear(),
            slave.Join: self._join,
            slave.Part: self._part,
            slave.Leave: self._leave,
        }
        self._mdt = cdr.codec(telegrams.MDT)
        self._at = cdr.codec(telegrams.AT[self._index])
        self._current = cdr.codec(telegrams.motor_current(axis, len(self.drive.currents)))
        self._shaft = cdr.codec(telegrams.SHAFTS)
        self.publish_at = cdr.raw_publish(AT.publisher(self, axis))
        self._publish_current = cdr.raw_publish(MOTOR_CURRENT.publisher(self, axis))
        self._phases = Output(self, PHASE_CURRENT, axis)
        PHASE.bounded_subscription(self, self._on_phase, refuse=self._refuse)
        MDT.subscription(self, self._on_mdt, raw=True)
        MOTOR_SHAFTS.subscription(self, self._on_shafts, raw=True)
        self._participant = Participant(self, axis, parameters)
        self._health = Health(self, axis)
        self.create_timer(HOUSEKEEPING_S, self._housekeeping)

    def _refuse(self, reason: str) -> None:
        self._refused += 1
        self.get_logger().warning(reason, throttle_duration_sec=1.0)

    # the bus ----------------------------------------------------------------------------------------------------------

    def _on_phase(self, message: Header) -> None:
        phase, session, stamp = cdr.parse_phase(message)
        cycle = self._cycles.count(*stamp)
        alone = self.count_publishers('sercos/phase') <= 1
        self._carry_out(self._slave.announced(phase, session, cycle, self.drive.powered, alone))

    def _carry_out(self, actions: Sequence[slave.Action]) -> None:
        for action in actions:
            self._ways[type(action)](action)

    def _join(self, action: slave.Join) -> None:
        self._master.received(time.monotonic())
        self._drive_clock.begin(action.start)

    def _part(self, action: slave.Part) -> None:
        self._master.received(time.monotonic())
        self.get_logger().error(f'{self._axis}: {action.reason} in bus cycle {self._drive_clock.cycle}')
        self._drive_clock.part()

    def _leave(self, _: slave.Leave) -> None:
        self._drive_clock.leave()
        self._link.clear()
        self._resting_position = None
        self._frame = b''

    # telegrams --------------------------------------------------------------------------------------------------------

    def _on_mdt(self, data: bytes) -> None:
        bus, clock = self._slave, self._drive_clock
        if bus.session == NO_SESSION:
            return
        try:
            sec, nanosec, frame, values = self._mdt.decode(data)
            cycle = self._cycles.count(sec, nanosec)
            if frame != self._frame:
                self._words = telegrams.parse_mdt_frame(frame, self._index, bus.session)
                self._frame = frame
        except TelegramError as error:
            self._refuse(f'{self._axis}: {error}')
            return
        if cycle >= 0:
            now = clock.exchange // self._per_cycle
            if bus.cyclic and cycle > now + self._ahead_max:
                self._refuse(f'{self._axis}: an MDT of bus cycle {cycle} in cycle {now} is ahead of bus time')
                return
            self._master.received(time.monotonic())
            command = (values[self._index], *self._words[1:])
            for arrived, what in self._link.arrivals(self._axis, cycle, command):
                if clock.take_command(arrived, what) is Taken.CONTRADICTED:
                    reason = f'two different MDT of bus cycle {arrived}, is there a second master? (8506)'
                    self._carry_out(bus.lose_master(reason))
        elif self._resting_position is not None and not bus.cyclic:
            position = self.drive.encoder_position(self._resting_position)
            clock.service.received(self._words[2])
            frame = telegrams.at_frame(RESTING, clock.service.to_send(), bus.session)
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
            self._refuse(f'{self._axis}: {error}')
            return
        i = self._index
        if exchange >= 0:
            self._drive_clock.take_shaft(exchange, (values[i], values[3 + i], values[6 + i]))
        elif not self._slave.cyclic:
            self._resting_position = values[i]
            nothing = (0.0,) * len(self.drive.currents)
            frame = telegrams.current_frame(False, 0.0, session)
            self._publish_current(self._current.encode((ACYCLIC_SEC, 0), frame, nothing))

    def _send_answer(self, cycle: int, status: int) -> None:
        frame = telegrams.at_frame(status, self._drive_clock.service.to_send(), self._slave.session)
        stamp = self._cycles.stamp(cycle)
        self.publish_at(self._at.encode(stamp, frame, self.drive.answer.tolist()))
        if self._phases.wanted:
            message = JointState(name=['I1s', 'I2s', 'I3s'], effort=self.drive.phase_currents())
            message.header.stamp.sec, message.header.stamp.nanosec = stamp
            self._phases.publish(message)

    def _send_current(self, exchange: int, released: bool) -> None:
        drive = self.drive
        frame = self._current_frames.get((released, drive.payload))
        if frame is None:
            frame = telegrams.current_frame(released, drive.payload, self._slave.session)
            self._current_frames[released, drive.payload] = frame
        self._publish_current(
            self._current.encode(self._exchanges.stamp(exchange), frame, drive.currents.tolist())
        )

    # service channel --------------------------------------------------------------------------------------------------

    def _actual(self, name: str) -> float:
        """Field of the drive's state, for the service channel."""
        return float(self.drive.state[name][0])

    def _configure(self, parameters: Parameters) -> None:
        """Take over parameters that were written."""
        self.drive.configure(parameters)
        self._settings.follow(parameters, self._drive_clock.cycle)

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set what a ROS service asks for."""
        accepted = self._settings.accepted(parameter_list)
        if isinstance(accepted, Reason):
            return SetParametersResult(successful=False, reason=accepted.sentence)
        return super().set_parameters_atomically(accepted)

    # looks ------------------------------------------------------------------------------------------------------------

    def _housekeeping(self) -> None:
        fault = self.drive.fault
        if fault != self._reported_fault:
            self._reported_fault = fault
            if fault:
                self.get_logger().error(f'{self._axis}: {fault_text(fault)}')
            else:
                self.get_logger().info(f'{self._axis}: fault cleared')
        self._looks += 1
        if self._looks % HEALTH_EVERY == 0 and self._health.wanted:
            self._send_health()
        if self._slave.cyclic:
            self._check_silence()
            return
        waiting = ''
        if self.count_publishers('plant/motor_shafts') == 0:
            waiting = 'waiting for plant'
        elif self.count_publishers('sercos/mdt') == 0:
            waiting = 'waiting for transformation_task'
        if waiting != self._waiting:
            self._waiting = waiting
            self.get_logger().info(f'{self._axis}: {waiting or "all partners are there"}')

    def _check_silence(self) -> None:
        clock = self._drive_clock
        silence = self._master.silence_s(time.monotonic())
        if self._slave.parting:
            if clock.exchange != self._exchange_seen:
                self._exchange_seen = clock.exchange
                self._master.received(time.monotonic())
            elif silence > BUS_SILENT_S:
                self._carry_out(self._slave.rest())  # the plant is silent as well: nothing is left to stop
        elif not clock.awaits_command:
            self._master.received(time.monotonic())  # it is the plant that is waited for
        elif silence > MASTER_SILENT_S:
            self._carry_out(self._slave.lose_master(f'no MDT for {silence:.1f} s (8506)'))

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
