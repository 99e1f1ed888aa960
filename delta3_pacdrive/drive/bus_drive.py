"""A drive that takes part in the bus: it joins, follows commands, answers, notices that its master is lost, and leaves.

Pure: telegrams come in as calls, what has to go out is done by a ``DrivePort``. Tests let it run without ROS.
"""

from collections.abc import Callable, Sequence
from typing import Protocol

from delta3_pacdrive.drive.channels import Channel
from delta3_pacdrive.drive.drive_clock import Command, DriveClock, Taken
from delta3_pacdrive.drive.mc4 import MC4
from delta3_pacdrive.drive.register import Register
from delta3_pacdrive.drive.scope import Block, DriveScope
from delta3_pacdrive.faults.fault import MDT_FAULTS
from delta3_pacdrive.faults.schedule import Schedule
from delta3_pacdrive.faults.telegram_faults import FaultyLink
from delta3_pacdrive.parameters import Parameters, of_tool_axis
from delta3_pacdrive.sercos import slave
from delta3_pacdrive.sercos.configuration_check import ALL_DRIVES, DRIVES
from delta3_pacdrive.sercos.participants import Occasion
from delta3_pacdrive.sercos.slave import BusSlave
from delta3_pacdrive.sercos.watchdog import BUS_SILENT_S, MASTER_SILENT_S, Watchdog
from delta3_pacdrive.sercos.words import Phase

AHEAD = 2  # cycles by which a drive may be behind the others


def own_parameters(parameters: Parameters, index: int) -> tuple[Parameters, int]:
    """Return the parameters of a drive, and its number among those that share them: a rotary axis has its own."""
    return (parameters, index) if index < len(DRIVES) else (of_tool_axis(parameters), 0)


class DrivePort(Protocol):
    """What a drive does on the bus."""

    def announce(self, session: bytes, occasion: Occasion) -> None:
        """Announce itself in a session."""

    def forget(self) -> None:
        """Forget frames of the session before."""

    def send_answer(self, cycle: int, status: int) -> None:
        """Send the AT of a bus cycle, which ``MC4.answer`` holds."""

    def send_current(self, exchange: int, released: bool) -> None:
        """Send the currents of an exchange period, which ``MC4.currents`` holds, and the brake output."""

    def repeat_current(self) -> None:
        """Send the currents of the newest exchange again: the drive is still there."""

    def changed(self, parameters: Parameters, cycle: int) -> None:
        """Take note of parameters that were written in a bus cycle."""

    def refuse(self, reason: str) -> None:
        """Say that a telegram was refused."""

    def tell_loss(self, reason: str) -> None:
        """Say why the drive goes on without its master."""


class BusDrive:
    """One drive on the bus.

    Parameters
    ----------
    parameters, index
        Of the robot; number of the axis, 0 to 2, and 3 for the rotary one.
    faults
        Of the drive.
    port
        Does what has to be done outside.
    look_s
        Time between two looks [s].
    now_s
        Returns the time of a clock that never jumps [s].

    Attributes
    ----------
    drive, slave, clock, register
        The drive, its part in the bus, its bus time, its operation data.
    phase
        That the last MDT told.

    """

    def __init__(
        self,
        parameters: Parameters,
        index: int,
        faults: Schedule,
        port: DrivePort,
        look_s: float,
        now_s: Callable[[], float],
    ) -> None:
        self._axis, self._port, self._now_s = ALL_DRIVES[index], port, now_s
        own, number = own_parameters(parameters, index)
        self._ahead_max = parameters.bus.outstanding_cycles_max + AHEAD
        self._link: FaultyLink[Command] = FaultyLink(faults, MDT_FAULTS, port.refuse)
        self._master = Watchdog(look_s)
        self._resting_position: float | None = None
        self._exchange_seen = 0  # at the last look
        self.phase = Phase.CP0
        self._shown = own  # with which samples were taken
        self.drive, self.slave = MC4(own, number), BusSlave()
        self.register = Register(own, self._actual, self._configure, self.drive.clear_fault)
        self.clock = DriveClock(
            self.drive,
            self._axis,
            own,
            faults,
            lambda access: self.register.serve(access, self.phase),
            port.send_answer,
            port.send_current,
            lambda: self._do(self.slave.rest()),
        )

    def _actual(self, name: str) -> float:
        """Field of the drive's state, for the service channel."""
        return float(self.drive.state[name][0])

    def arm(self, channels: Sequence[Channel], decimation: int, hand_over: Callable[[Block], None]) -> None:
        """Arm the oscilloscope of the drive, from the next exchange on, instead of one that was armed before."""
        self.clock.scope = DriveScope(self.drive, channels, decimation, lambda: self._shown, hand_over)

    def disarm(self) -> None:
        """Run the loops without oscilloscope again."""
        self.clock.scope = None

    def _configure(self, parameters: Parameters) -> None:
        if self.clock.scope is not None:
            self.clock.scope.flush()  # what it holds was so with the parameters before
        self._shown = parameters
        self.drive.configure(parameters)
        self._port.changed(parameters, self.clock.cycle)

    # phases -----------------------------------------------------------------------------------------------------------

    def announced(self, phase: Phase, session: bytes, cycle: int, alone: bool) -> None:
        """Take the announcement of a phase; ``alone``: only one master announces any."""
        self._do(self.slave.announced(phase, session, cycle, self.drive.powered, alone))

    def _do(self, actions: Sequence[slave.Action]) -> None:
        for action in actions:
            match action:
                case slave.Answer(session):
                    self._port.announce(session, Occasion.CALLED)
                case slave.Report(session):
                    self._port.announce(session, Occasion.STARTED)
                case slave.Adopt():
                    self._port.forget()
                case slave.Join(start):
                    self._master.received(self._now_s())
                    self.clock.begin(start)
                case slave.Part(reason):
                    self._master.received(self._now_s())
                    self._port.tell_loss(f'{self._axis}: {reason} in bus cycle {self.clock.cycle}')
                    self.clock.part()
                case slave.Leave():
                    self.clock.leave()
                    self._link.clear()
                    self._resting_position = None
                    self._port.forget()

    # telegrams --------------------------------------------------------------------------------------------------------

    def take_command(self, cycle: int, command: Command) -> None:
        """Take the MDT of a bus cycle."""
        now = self.clock.cycle
        if self.slave.cyclic and cycle > now + self._ahead_max:
            self._port.refuse(
                f'{self._axis}: an MDT of bus cycle {cycle} in cycle {now} is ahead of bus time'
            )
            return
        self._master.received(self._now_s())
        for arrived, what in self._link.arrivals(self._axis, cycle, command):
            taken = self.clock.take_command(arrived, what)
            if taken in (Taken.LATE, Taken.REPEATED) and self.clock.awaits_command:
                self._port.repeat_current()  # the bus waits, and everybody on it is there
            elif taken is Taken.CONTRADICTED:
                reason = f'two different MDT of bus cycle {arrived}, is there a second master? (8506)'
                self._do(self.slave.lose_master(reason))

    def stand(self, position: float) -> None:
        """Take note of where the motor shaft stands [rad], outside of cyclic operation."""
        self._resting_position = position

    def greeted(self, service: int) -> float | None:
        """Take a greeting; returns the encoder position [rad] to answer with, None if there is none."""
        if self._resting_position is None or self.slave.cyclic:
            return None
        self.clock.service.received(service)
        return self.drive.encoder_position(self._resting_position)

    # looks ------------------------------------------------------------------------------------------------------------

    def look(self) -> None:
        """Look in cyclic operation whether the master, or at a stop without it the plant, is still there."""
        now_s, clock = self._now_s(), self.clock
        silence = self._master.silence_s(now_s)
        if self.slave.parting:
            if clock.exchange != self._exchange_seen:
                self._exchange_seen = clock.exchange
                self._master.received(now_s)
            elif silence > BUS_SILENT_S:
                self._do(self.slave.rest())  # the plant is silent as well: nothing is left to stop
        elif not clock.awaits_command:
            self._master.received(now_s)  # it is the plant that is waited for
        elif silence > MASTER_SILENT_S:
            self._do(self.slave.lose_master(f'no MDT for {silence:.1f} s (8506)'))
