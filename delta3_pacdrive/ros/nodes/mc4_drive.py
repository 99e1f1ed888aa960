"""Node of one MC-4 servo drive.

In: ``sercos/phase``, ``sercos/mdt`` (commands), ``plant/motor_shafts`` (true shafts). Out: ``sercos/at/axisN``
(encoder, status), ``axisN/motor_current`` (I_eff of every current-loop period), ``axisN/phase_current`` (I1s, I2s, I3s,
on request), ``/diagnostics`` (1 Hz).
"""

import math
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from delta3_pacdrive.drive.diagnostics import (
    WARNINGS,
    DriveFault,
    class_1_diagnostic,
    class_2_diagnostic,
    fault_text,
)
from delta3_pacdrive.drive.mc4 import MC4
from delta3_pacdrive.drive.operation_data import Register
from delta3_pacdrive.errors import ParameterError, TelegramError
from delta3_pacdrive.faults.effects import apply_to_drive
from delta3_pacdrive.faults.fault import MDT_FAULTS
from delta3_pacdrive.faults.telegram_faults import FaultyLink
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.ros import cdr, node_process
from delta3_pacdrive.ros.announcements import Participant
from delta3_pacdrive.ros.diagnostics import Health
from delta3_pacdrive.ros.drive_parameters import WRITABLE, DriveParameters
from delta3_pacdrive.ros.fault_injection import Faults
from delta3_pacdrive.ros.parameters import declare, declare_robot, descriptor
from delta3_pacdrive.ros.publishers import Output
from delta3_pacdrive.ros.qos import CYCLIC_PUBLISHER, CYCLIC_SUBSCRIPTION, LATCHED, REPORT
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.sercos.bus_time import ACYCLIC_SEC, Clock
from delta3_pacdrive.sercos.configuration_check import DRIVES
from delta3_pacdrive.sercos.participants import Occasion
from delta3_pacdrive.sercos.service_channel import ServiceSlave
from delta3_pacdrive.sercos.watchdog import BUS_SILENT_S, MASTER_SILENT_S, Watch
from delta3_pacdrive.sercos.words import Phase, Status

HOUSEKEEPING_S = 0.25
HEALTH_EVERY = 4
AHEAD = 2  # cycles by which a drive may be behind the others
PARTING_CYCLES = 100  # of bus time that a drive stays on the bus beyond the longest stop
RESTING = int(Status.READY_FOR_POWER)  # status word before cyclic operation
_Command = tuple[float, int, int, float]  # position, control word, service channel, payload


class MC4DriveNode(RobotNode):
    """One axis."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('mc4_drive', **node_options)
        number = declare(self, 'axis', 0, descriptor('number of the axis, 1 to 3', 0, len(DRIVES), int))
        if not number:
            raise ParameterError(f'{self.get_fully_qualified_name()} needs the parameter axis: 1, 2 or 3')
        parameters = declare_robot(self, frozenset(WRITABLE))
        bus = parameters.bus
        self._index = number - 1
        self._axis = axis = DRIVES[self._index]
        self._drive = MC4(parameters, self._index)
        self._session = cdr.NO_SESSION
        self._cyclic = False
        self._parting = False  # no master any more: the drive stops by itself
        self._parted = 0  # bus cycles since then
        stop_s = parameters.drive.stop_time_max_s + parameters.motor.brake_apply_s
        self._parting_cycles = math.ceil(stop_s / bus.cycle_time_s) + PARTING_CYCLES
        self._master = Watch(HOUSEKEEPING_S)
        self._cycles = Clock(bus.cycle_time_s)
        self._exchanges = Clock(bus.exchange_period_s)
        self._exchanges_per_cycle = round(bus.cycle_time_s / bus.exchange_period_s)
        self._exchange = 0
        self._frame = b''  # of the last MDT: it rarely changes
        self._words: tuple[Phase, int, int, float] = (
            Phase.CP0,
            0,
            0,
            0.0,
        )  # phase, control, service channel, payload
        self._current_frames: dict[tuple[bool, float], bytes] = {}
        self._ahead_max = (
            bus.outstanding_cycles_max + AHEAD
        )  # cycles by which an MDT may come before its time
        self._commands: dict[int, _Command] = {}
        self._last_taken: tuple[int, _Command | None] = -1, None
        self._shafts: dict[int, tuple[float, float, float]] = {}
        self._resting_position: float | None = None
        self._reported_fault = DriveFault.NONE
        self._newest_command = -1
        self._refused = self._late = 0
        self._waiting = ''
        self._looks = 0

        self._register = Register(parameters, self._actual, self._configure, self._drive.clear_fault)
        self._service = self._new_service()
        self._settings = DriveParameters(self, axis, self._register)
        self._mdt = cdr.mdt_codec()
        self._at = cdr.at_codec(axis)
        self._current = cdr.current_codec(axis, len(self._drive.currents))
        self._shaft = cdr.shafts_codec()
        self._publish_at = cdr.raw_publish(
            self.create_publisher(JointState, f'sercos/at/{axis}', CYCLIC_PUBLISHER)
        )
        self._publish_current = cdr.raw_publish(
            self.create_publisher(JointState, f'{axis}/motor_current', CYCLIC_PUBLISHER)
        )
        self._phases = Output(self, JointState, f'{axis}/phase_current', REPORT)
        self.create_bounded_subscription(Header, 'sercos/phase', self._on_phase, LATCHED, refuse=self._refuse)
        self.create_subscription(JointState, 'sercos/mdt', self._on_mdt, CYCLIC_SUBSCRIPTION, raw=True)
        self.create_subscription(
            JointState, 'plant/motor_shafts', self._on_shafts, CYCLIC_SUBSCRIPTION, raw=True
        )
        self._participant = Participant(self, axis, parameters)
        self._faults = Faults(self, axis, lambda: self._cycle, lambda: self._session)
        # cycles whose MDT an injected fault has taken away
        self._lost: set[int] = set()
        self._link: FaultyLink[_Command] = FaultyLink(self._faults, MDT_FAULTS, self._refuse)
        self._dc_link_v = parameters.drive.dc_link_voltage_v
        self._health = Health(self, axis)
        self.create_timer(HOUSEKEEPING_S, self._housekeeping)

    def _new_service(self) -> ServiceSlave:
        return ServiceSlave(lambda access: self._register.serve(access, self._words[0]))

    def _refuse(self, reason: str) -> None:
        self._refused += 1
        self.get_logger().warning(reason, throttle_duration_sec=1.0)

    # phases of the bus ------------------------------------------------------------------------------------------------

    def _on_phase(self, message: Header) -> None:
        phase, session, stamp = cdr.parse_phase(message)
        cycle = self._cycles.count(*stamp)
        if self._cyclic and self.count_publishers('sercos/phase') > 1:
            return  # a second master, or a stranger; a new master announces itself again when the last one has gone
        if phase == Phase.CP0:
            if self._cyclic and self._drive.powered:
                self._part('the phase fell to CP0')
            elif not self._parting:
                self._leave()
                self._participant.announce(session)
        elif phase != Phase.CP4:
            if self._cyclic:
                self._leave()
            if session != self._session:
                self._session = session
                self._current_frames.clear()
        elif session == self._session and not self._cyclic:
            self._join(cycle)
        elif self._session == cdr.NO_SESSION:
            self._participant.announce(session, Occasion.STARTED)

    def _join(self, cycle: int) -> None:
        """Begin cyclic operation with a bus cycle; what came of it already waits."""
        self._exchange = cycle * self._exchanges_per_cycle
        self._commands = {key: value for key, value in self._commands.items() if key >= cycle}
        self._shafts = {key: value for key, value in self._shafts.items() if key >= self._exchange}
        self._newest_command = max(self._commands, default=-1)
        self._cyclic, self._parting = True, False
        self._master.heard(time.monotonic())
        self._advance()

    def _part(self, reason: str) -> None:
        """Go on without a master: stop by reaction BD2, with the plant only, then leave the bus (8506)."""
        if self._parting:
            return
        self._parting, self._parted = True, 0
        self._drive.state['silent'] = 1
        self._master.heard(time.monotonic())
        self.get_logger().error(f'{self._axis}: {reason} in bus cycle {self._cycle}')
        self._advance()

    def _leave(self) -> None:
        """Leave the bus without torque; a fault stays latched."""
        self._commands.clear()
        self._lost.clear()
        self._link.clear()
        self._shafts.clear()
        self._resting_position = None
        self._frame = b''
        if self._session != cdr.NO_SESSION:
            self._session = cdr.NO_SESSION
            self._cyclic = self._parting = False
            self._drive.leave_bus()
            self._service = self._new_service()

    @property
    def _cycle(self) -> int:
        return self._exchange // self._exchanges_per_cycle

    # telegrams --------------------------------------------------------------------------------------------------------

    def _on_mdt(self, data: bytes) -> None:
        if self._session == cdr.NO_SESSION:
            return
        try:
            sec, nanosec, frame, values = self._mdt.decode(data)
            cycle = self._cycles.count(sec, nanosec)
            if frame != self._frame:
                self._words = cdr.parse_mdt_frame(frame, self._index, self._session)
                self._frame = frame
        except TelegramError as error:
            self._refuse(f'{self._axis}: {error}')
            return
        if cycle >= 0:
            if self._cyclic and cycle > self._cycle + self._ahead_max:
                self._refuse(
                    f'{self._axis}: an MDT of bus cycle {cycle} in cycle {self._cycle} is ahead of bus time'
                )
                return
            self._master.heard(time.monotonic())
            command = (values[self._index], *self._words[1:])
            for arrived, what in self._link.arrivals(self._axis, cycle, command):
                self._take_mdt(arrived, what)
        elif self._resting_position is not None and not self._cyclic:
            position = self._drive.encoder_position(self._resting_position)
            self._service.received(self._words[2])
            frame = cdr.at_frame(RESTING, self._service.to_send(), self._session)
            self._publish_at(self._at.encode((ACYCLIC_SEC, 0), frame, (position, 0.0, 0.0)))

    def _take_mdt(self, cycle: int, command: _Command | None) -> None:
        if command is None:
            self._lost.add(cycle)
            self._advance()
            return
        due = cycle * self._exchanges_per_cycle >= self._exchange and cycle not in self._lost
        taken = self._commands.get(cycle)
        if due and taken is None:
            self._commands[cycle] = command
            self._newest_command = max(self._newest_command, cycle)
            self._advance()
            return
        self._late += 1  # late, or repeated
        if taken is None and self._last_taken[0] == cycle:
            taken = self._last_taken[1]
        if taken is not None and taken != command and self._cyclic:
            self._part(f'two different MDT of bus cycle {cycle}, is there a second master? (8506)')

    def _on_shafts(self, data: bytes) -> None:
        if self._session == cdr.NO_SESSION:
            return
        try:
            sec, nanosec, frame, values = self._shaft.decode(data)
            cdr.require_session(frame, self._session)
            exchange = self._exchanges.count(sec, nanosec)
        except TelegramError as error:
            self._refuse(f'{self._axis}: {error}')
            return
        i = self._index
        if exchange >= 0:
            self._shafts[exchange] = (values[i], values[3 + i], values[6 + i])
            self._advance()
        elif not self._cyclic:
            self._resting_position = values[i]
            nothing = (0.0,) * len(self._drive.currents)
            frame = cdr.current_frame(False, 0.0, self._session)
            self._publish_current(self._current.encode((ACYCLIC_SEC, 0), frame, nothing))

    def _advance(self) -> None:
        """Run every exchange whose telegrams are there, in the order of their stamps."""
        drive = self._drive
        while self._cyclic:
            exchange = self._exchange
            shaft = self._shafts.get(exchange)
            if shaft is None:
                return
            cycle, within = divmod(exchange, self._exchanges_per_cycle)
            if within == 0:
                if cycle >= self._faults.next_cycle:
                    self._change_faults(cycle)
                telegram_ = self._commands.pop(cycle, None)
                if telegram_ is not None:
                    command, control, service, payload = telegram_
                    self._last_taken = cycle, telegram_
                    self._service.received(service)
                    status = drive.begin_cycle(command, control, *shaft, payload)
                elif cycle in self._lost or self._newest_command > cycle or self._parting:
                    # telegrams of one sender keep their order: a later one says that this one was lost
                    self._lost.discard(cycle)
                    status = drive.extrapolate_cycle(*shaft)
                    if self._parting:
                        self._master.heard(time.monotonic())
                        self._parted += 1
                        if self._parted > self._parting_cycles:
                            self._leave()
                            return
                else:
                    return
                frame = cdr.at_frame(status, self._service.to_send(), self._session)
                self._publish_at(self._at.encode(self._cycles.stamp(cycle), frame, drive.answer.tolist()))
                if self._phases.wanted:
                    self._publish_phase_currents(cycle)
            del self._shafts[exchange]
            frame = self._current_frame(drive.run_period(*shaft), drive.payload)
            self._publish_current(
                self._current.encode(self._exchanges.stamp(exchange), frame, drive.currents.tolist())
            )
            self._exchange = exchange + 1

    def _change_faults(self, cycle: int) -> None:
        changes = self._faults.begin_and_end(cycle)
        apply_to_drive(self._drive.state[0], self._axis, changes, self._faults.active, self._dc_link_v)

    def _current_frame(self, released: bool, payload: float) -> bytes:
        frame = self._current_frames.get((released, payload))
        if frame is None:
            frame = cdr.current_frame(released, payload, self._session)
            self._current_frames[released, payload] = frame
        return frame

    def _actual(self, name: str) -> float:
        """Field of the drive's state, for the service channel."""
        return float(self._drive.state[name][0])

    def _configure(self, parameters: Parameters) -> None:
        """Take over parameters that were written."""
        self._drive.configure(parameters)
        self._settings.follow(parameters, self._cycle)

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set what a ROS service asks for."""
        accepted, reason = self._settings.accepted(parameter_list)
        if reason:
            return SetParametersResult(successful=False, reason=reason)
        return super().set_parameters_atomically(accepted)

    def _publish_phase_currents(self, cycle: int) -> None:
        message = JointState(name=['I1s', 'I2s', 'I3s'], effort=self._drive.phase_currents())
        message.header.stamp.sec, message.header.stamp.nanosec = self._cycles.stamp(cycle)
        self._phases.publish(message)

    def _housekeeping(self) -> None:
        fault = self._drive.fault
        if fault != self._reported_fault:
            self._reported_fault = fault
            if fault:
                self.get_logger().error(f'{self._axis}: {fault_text(fault)}')
            else:
                self.get_logger().info(f'{self._axis}: fault cleared')
        self._looks += 1
        if self._looks % HEALTH_EVERY == 0 and self._health.wanted:
            self._send_health()
        if self._cyclic:
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
        silence = self._master.silence_s(time.monotonic())
        if self._parting:
            if silence > BUS_SILENT_S:
                self._leave()  # the plant is silent as well: there is nothing left to stop
        elif self._exchange % self._exchanges_per_cycle or self._exchange not in self._shafts:
            self._master.heard(time.monotonic())  # it is the plant that is waited for
        elif silence > MASTER_SILENT_S:
            self._part(f'no MDT for {silence:.1f} s (8506)')

    def diagnostics(self) -> dict[str, Any]:
        """What the drive says of itself, by SERCOS names."""
        drive = self._drive
        state = drive.state[0]
        return {
            'state': drive.drive_state.name,
            'diagnostic': fault_text(drive.fault),
            'warnings': [WARNINGS[warning].text for warning in WARNINGS if drive.warning & warning],
            'S-0-0011 class 1 diagnostic': f'{class_1_diagnostic(drive.fault):04x}',
            'S-0-0012 class 2 diagnostic': f'{class_2_diagnostic(drive.warning):04x}',
            'S-0-0028 MST losses': int(state['mdt_losses']),
            'S-0-0029 MDT losses': int(state['mdt_losses']),
            'S-0-0134 control word': f'{int(state["control"]):04x}',
            'S-0-0135 status word': f'{int(state["status"]):04x}',
            'overload_s': round(float(state['overload']), 3),
            'late_telegrams': self._late,
            'refused_telegrams': self._refused,
        }

    def _send_health(self) -> None:
        drive = self._drive
        level = DiagnosticStatus.ERROR if drive.fault else DiagnosticStatus.OK
        if not drive.fault and drive.warning:
            level = DiagnosticStatus.WARN
        self._health.send(level, fault_text(drive.fault), self.diagnostics())


def main() -> int:
    """Run one drive process."""
    return node_process.run_single(MC4DriveNode)


if __name__ == '__main__':
    raise SystemExit(main())
