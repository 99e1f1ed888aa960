"""Bus time of a drive: processes exchanges as commands and shafts arrive, in the order of their stamps."""

import math
from collections.abc import Callable
from enum import Enum, auto
from typing import NamedTuple

from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.drive.scope import DriveScope
from delta3_pacdrive.robot.faults.effects import apply_to_drive
from delta3_pacdrive.robot.faults.schedule import Schedule
from delta3_pacdrive.robot.sercos.service_channel import Access, Answer
from delta3_pacdrive.robot.sercos.service_endpoints import ServiceSlave

PARTING_CYCLES = 100  # bus cycles that a drive stays on the bus after the longest stop
# position, speed, coupling torque; of an encoder at another axis also its position and speed
Shaft = tuple[float, float, float] | tuple[float, float, float, float, float]
Supply = tuple[float, ...]  # voltage, readiness and resistor load of the DC link
Warmth = tuple[float, ...]  # winding, housing and heat sink [degC], relative viscous friction


class Command(NamedTuple):
    """MDT data for a drive: shaft [rad], S-0-0134, service word, payload [kg], torque [N m]."""

    position: float
    control: int
    service: int
    payload: float
    torque: float = 0.0


class Taken(Enum):
    """Result of receiving a command."""

    IN_TIME = auto()
    LATE = auto()  # or a duplicate
    REPEATED = auto()  # the latest command again, while the next one is awaited: the bus is waiting
    CONTRADICTED = auto()  # differs from another command of the same cycle


class Callbacks(NamedTuple):
    """Connections of a drive clock to service channel, bus and state machine."""

    serve: Callable[[Access], Answer]  # executes accesses of the service channel
    send_answer: Callable[[int, int], None]  # bus cycle and status word; ``drive.answer`` is up to date
    send_current: Callable[[int, bool], None]  # exchange and brake output; ``drive.currents`` are up to date
    stopped: Callable[[], None]  # end of a stop without master


class DriveClock:
    """One drive in bus time.

    A command is awaited until a later one proves its loss, since telegrams of one sender keep their order; a shaft, the
    state of a DC link with a model, and the temperatures of a robot that warms up are awaited indefinitely. A drive
    that stops without its master awaits no commands.

    Attributes
    ----------
    late
        Number of late or duplicate commands, without repetitions while the bus is waiting.
    scope
        Armed oscilloscope, if any.

    """

    def __init__(
        self,
        drive: MC4,
        axis: str,
        parameters: Parameters,
        faults: Schedule,
        callbacks: Callbacks,
    ) -> None:
        bus = parameters.bus
        self._drive, self._axis, self._faults, self._callbacks = drive, axis, faults, callbacks
        self._per_cycle = round(bus.cycle_time_s / bus.exchange_period_s)
        stop_s = parameters.drive.stop_time_max_s + parameters.motor.brake_apply_s
        self._parting_cycles = math.ceil(stop_s / bus.cycle_time_s) + PARTING_CYCLES
        self.exchange = 0
        self.running = False
        self.service = ServiceSlave(callbacks.serve)
        self.late = 0
        self.scope: DriveScope | None = None
        self._parting = False
        self._parted = 0  # bus cycles since the start of a stop without master
        self._commands: dict[int, Command] = {}
        # cycles whose command was removed by an injected fault, and whether it arrived garbled
        self._lost: dict[int, bool] = {}
        self._newest = -1  # cycle of the latest command
        self._last_taken: tuple[int, Command | None] = -1, None
        self._shafts: dict[int, Shaft] = {}
        self._supplied = parameters.supply.enabled
        self._supplies: dict[int, Supply] = {}
        self._warms = parameters.thermal.in_drives
        self._warmths: dict[int, Warmth] = {}

    @property
    def cycle(self) -> int:
        """Present bus cycle."""
        return self.exchange // self._per_cycle

    @property
    def awaits_command(self) -> bool:
        """Whether the drive is waiting for a command, not for a shaft."""
        return self.exchange % self._per_cycle == 0 and self.exchange in self._shafts

    def begin(self, cycle: int) -> None:
        """Start cyclic operation at a bus cycle; telegrams received in advance are kept."""
        self.exchange = cycle * self._per_cycle
        self._commands = {key: value for key, value in self._commands.items() if key >= cycle}
        self._shafts = {key: value for key, value in self._shafts.items() if key >= self.exchange}
        self._supplies = {key: value for key, value in self._supplies.items() if key >= cycle}
        self._warmths = {key: value for key, value in self._warmths.items() if key >= cycle}
        self._newest = max(self._commands, default=-1)
        self.running, self._parting, self._parted = True, False, 0
        self._advance()

    def part(self) -> None:
        """Continue without a master: stop by reaction BD2, with the plant only."""
        self._parting, self._parted = True, 0
        self._drive.state['silent'] = 1
        self._advance()

    def leave(self) -> None:
        """Stop bus time without torque; a fault stays latched."""
        self.running = self._parting = False
        self._commands.clear()
        self._lost.clear()
        self._shafts.clear()
        self._supplies.clear()
        self._warmths.clear()
        self._drive.leave_bus()
        self.service = ServiceSlave(self._callbacks.serve)

    def take_command(self, cycle: int, command: Command | None, garbled: bool = False) -> Taken:
        """Store the command of a bus cycle, None for one removed by an injected fault or ``garbled`` by it."""
        if command is None:
            self._lost[cycle] = garbled
            self._advance()
            return Taken.IN_TIME
        taken = self._commands.get(cycle)
        if taken is None and cycle * self._per_cycle >= self.exchange and cycle not in self._lost:
            self._commands[cycle] = command
            if cycle > self._newest:
                self._newest = cycle
            self._advance()
            return Taken.IN_TIME
        if taken is None and self._last_taken[0] == cycle:
            taken = self._last_taken[1]
            if taken == command and self.awaits_command and cycle == self.cycle - 1:
                return Taken.REPEATED
        self.late += 1
        return Taken.LATE if taken is None or taken == command else Taken.CONTRADICTED

    def take_shaft(self, exchange: int, shaft: Shaft) -> None:
        """Store the true shaft at the start of an exchange period."""
        self._shafts[exchange] = shaft
        self._advance()

    def take_supply(self, cycle: int, supply: Supply) -> None:
        """Store the state of the DC link at the start of a bus cycle."""
        self._supplies[cycle] = supply
        self._advance()

    def take_temperatures(self, cycle: int, warmth: Warmth) -> None:
        """Store the temperatures of motor and drive at the start of a bus cycle."""
        self._warmths[cycle] = warmth
        self._advance()

    def _advance(self) -> None:
        """Run all exchanges whose telegrams have arrived."""
        drive = self._drive
        while self.running:
            exchange = self.exchange
            shaft = self._shafts.get(exchange)
            if shaft is None:
                return
            if len(shaft) == 5:
                drive.take_feedback(*shaft[3:])
                shaft = shaft[:3]
            cycle, within = divmod(exchange, self._per_cycle)
            if within == 0:
                if self._supplied:
                    if cycle not in self._supplies:
                        return
                    drive.take_link(self._supplies[cycle])
                if self._warms:
                    if cycle not in self._warmths:
                        return
                    drive.take_temperatures(self._warmths[cycle])
                if cycle >= self._faults.next_cycle:
                    changes = self._faults.due(cycle)
                    apply_to_drive(drive.state[0], self._axis, changes, self._faults.active)
                command = self._commands.pop(cycle, None)
                if command is not None:
                    position, control, service, payload, torque = command
                    self._last_taken = cycle, command
                    self.service.received(service)
                    status = drive.begin_cycle(position, control, *shaft, payload, torque)
                elif cycle in self._lost or self._newest > cycle or self._parting:
                    # a garbled telegram still synchronises
                    drive.state['mst_losses'] += not self._lost.pop(cycle, False)
                    status = drive.extrapolate_cycle(*shaft)
                    self._parted += self._parting
                    if self._parted > self._parting_cycles:
                        self._callbacks.stopped()
                        return
                else:
                    return
                self._callbacks.send_answer(cycle, status)
            del self._shafts[exchange]
            self._supplies.pop(cycle, None)
            self._warmths.pop(cycle, None)
            scope = self.scope
            released = drive.run_period(*shaft) if scope is None else scope.run_period(exchange, *shaft)
            self._callbacks.send_current(exchange, released)
            self.exchange = exchange + 1
