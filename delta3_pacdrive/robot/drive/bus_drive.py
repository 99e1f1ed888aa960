"""A drive as a bus participant: joins, follows commands, sends ATs, detects the loss of its master, and leaves.

Free of ROS: telegrams arrive as calls, and a ``DrivePort`` sends.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from delta3_pacdrive.parameters import Parameters, rotary_axis_parameters
from delta3_pacdrive.robot.drive.channels import Channel
from delta3_pacdrive.robot.drive.drive_clock import Callbacks, Command, DriveClock, Taken
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.drive.register import Register
from delta3_pacdrive.robot.drive.scope import Block, DriveScope
from delta3_pacdrive.robot.faults.fault import MDT_FAULTS
from delta3_pacdrive.robot.faults.schedule import Schedule
from delta3_pacdrive.robot.faults.telegram_faults import FaultyLink
from delta3_pacdrive.robot.sercos import slave
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, DRIVES
from delta3_pacdrive.robot.sercos.participants import Occasion
from delta3_pacdrive.robot.sercos.service_channel import Access, Answer
from delta3_pacdrive.robot.sercos.slave import BusSlave
from delta3_pacdrive.robot.sercos.watchdog import BUS_SILENT_S, MASTER_SILENT_S, Watchdog
from delta3_pacdrive.robot.sercos.words import Phase

AHEAD = 2  # cycles by which a drive may lag behind the others


def own_parameters(parameters: Parameters, index: int) -> tuple[Parameters, int]:
    """Return the parameters of a drive, and its index among the drives with equal parameters."""
    number = index - len(DRIVES)
    return (parameters, index) if number < 0 else (rotary_axis_parameters(parameters, number), 0)


class DrivePort(Protocol):
    """Outgoing messages of a drive."""

    def announce(self, session: bytes, occasion: Occasion) -> None:
        """Announce the drive in a session."""

    def clear_frames(self) -> None:
        """Clear the frames of the previous session."""

    def send_answer(self, cycle: int, status: int) -> None:
        """Send the AT of a bus cycle from ``MC4.answer``."""

    def send_current(self, exchange: int, released: bool) -> None:
        """Send the currents of an exchange period from ``MC4.currents``, with the brake output."""

    def repeat_current(self) -> None:
        """Send the latest currents again, as a sign of life."""

    def changed(self, parameters: Parameters, cycle: int) -> None:
        """Handle parameters changed over the service channel in a bus cycle."""

    def back_up(self, data: Mapping[str, float]) -> bool:
        """Store data of the drive permanently; return whether that is possible."""

    def refuse(self, reason: str) -> None:
        """Report a rejected telegram."""

    def report_loss(self, reason: str) -> None:
        """Report the reason why the drive continues without its master."""


class BusDrive:
    """One drive on the bus.

    Parameters
    ----------
    parameters, index
        Parameters of the robot, and axis number: 0 to 2, or from 3 on for a rotary axis.
    stored
        Data of an earlier backup, which replace those of the parameters.

    """

    def __init__(
        self,
        parameters: Parameters,
        index: int,
        faults: Schedule,
        port: DrivePort,
        poll_s: float,
        now_s: Callable[[], float],
        stored: Mapping[str, float] | None = None,
    ) -> None:
        self._axis, self._port, self._now_s = ALL_DRIVES[index], port, now_s
        own, number = own_parameters(parameters, index)
        self._ahead_max = parameters.bus.outstanding_cycles_max + AHEAD
        self._link: FaultyLink[Command] = FaultyLink(faults, MDT_FAULTS, port.refuse)
        self._master = Watchdog(poll_s)
        self._resting_position: float | None = None
        self._exchange_seen = 0  # at the last poll
        self.phase = Phase.CP0  # of the last MDT
        self._sampled_with = own  # parameters of the samples since the last flush
        self.drive, self.slave = MC4(own, number), BusSlave()
        self.drive.state['place'] = index
        self.drive.restore_data(stored or {})
        self.register = Register(
            own,
            self._actual,
            self._configure,
            self.drive.clear_fault,
            self._excite,
            drive=self.drive,
            back_up=lambda: port.back_up(self.drive.stored_data()),
        )
        callbacks = Callbacks(
            serve=self._serve,
            send_answer=port.send_answer,
            send_current=port.send_current,
            stopped=lambda: self._do(self.slave.rest()),
        )
        self.clock = DriveClock(self.drive, self._axis, own, faults, callbacks)

    def _actual(self, name: str) -> float:
        """Return a field of the drive's state, for the service channel."""
        return float(self.drive.state[name][0])

    def _serve(self, access: Access) -> Answer:
        self.drive.attend_excitation()
        return self.register.serve(access, self.phase)

    def _excite(self, on: bool) -> bool:
        """Start or stop the generator; return whether that is possible."""
        if on:
            return self.drive.start_excitation(self.register.parameters)
        self.drive.stop_excitation()
        return True

    def arm(self, channels: Sequence[Channel], decimation: int, hand_over: Callable[[Block], None]) -> None:
        """Arm the oscilloscope from the next exchange on, replacing an armed one."""
        self.clock.scope = DriveScope(self.drive, channels, decimation, lambda: self._sampled_with, hand_over)

    def disarm(self) -> None:
        """Disarm the oscilloscope."""
        self.clock.scope = None

    def _configure(self, parameters: Parameters) -> None:
        if self.clock.scope is not None:
            self.clock.scope.flush()  # its samples were taken with the old parameters
        self._sampled_with = parameters
        self.drive.configure(parameters)
        self._port.changed(parameters, self.clock.cycle)

    # phases -----------------------------------------------------------------------------------------------------------

    def announced(self, phase: Phase, session: bytes, cycle: int, alone: bool) -> None:
        """Process the announcement of a phase; ``alone``: only one master announces phases."""
        self._do(self.slave.announced(phase, session, cycle, self.drive.powered, alone))

    def _do(self, actions: Sequence[slave.Action]) -> None:
        for action in actions:
            match action:
                case slave.Answer(session):
                    self._port.announce(session, Occasion.CALLED)
                case slave.Report(session):
                    self._port.announce(session, Occasion.STARTED)
                case slave.Adopt():
                    self.register.begin_session()
                    self._port.clear_frames()
                case slave.Join(start):
                    self._master.received(self._now_s())
                    self.clock.begin(start)
                case slave.Part(reason):
                    self._master.received(self._now_s())
                    self._port.report_loss(f'{self._axis}: {reason} in bus cycle {self.clock.cycle}')
                    self.clock.part()
                case slave.Leave():
                    self.clock.leave()
                    self._link.clear()
                    self._resting_position = None
                    self._port.clear_frames()

    # telegrams --------------------------------------------------------------------------------------------------------

    def take_command(self, cycle: int, command: Command) -> None:
        """Process the MDT of a bus cycle."""
        now = self.clock.cycle
        if self.slave.cyclic and cycle > now + self._ahead_max:
            self._port.refuse(
                f'{self._axis}: an MDT of bus cycle {cycle} in cycle {now} is ahead of bus time'
            )
            return
        self._master.received(self._now_s())
        for arrived, received in self._link.arrivals(self._axis, cycle, command):
            garbled = received is None and self._link.garbles(self._axis, arrived)
            taken = self.clock.take_command(arrived, received, garbled)
            if taken in (Taken.LATE, Taken.REPEATED) and self.clock.awaits_command:
                self._port.repeat_current()  # the bus is waiting, but all participants are running
            elif taken is Taken.CONTRADICTED:
                reason = f'two different MDT of bus cycle {arrived}, is there a second master? (8506)'
                self._do(self.slave.lose_master(reason))

    def set_rest_position(self, position: float) -> None:
        """Store the motor shaft position [rad] outside cyclic operation."""
        self._resting_position = position

    def greeted(self, service: int) -> float | None:
        """Process a greeting; return the encoder position [rad] for the reply, None if it is unknown."""
        if self._resting_position is None or self.slave.cyclic:
            return None
        self.clock.service.received(service)
        return self.drive.encoder_position(self._resting_position)

    # polling ----------------------------------------------------------------------------------------------------------

    def poll(self) -> None:
        """Check for a timeout of the master, or of the plant during a stop without master."""
        now_s, clock = self._now_s(), self.clock
        silence = self._master.silence_s(now_s)
        if self.slave.parting:
            if clock.exchange != self._exchange_seen:
                self._exchange_seen = clock.exchange
                self._master.received(now_s)
            elif silence > BUS_SILENT_S:
                self._do(self.slave.rest())  # the plant is silent as well: there is nothing to stop
        elif not clock.awaits_command:
            self._master.received(now_s)  # waiting for the plant
        elif silence > MASTER_SILENT_S:
            self._do(self.slave.lose_master(f'no MDT for {silence:.1f} s (8506)'))
