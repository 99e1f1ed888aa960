"""The plant as it takes part in the bus: it joins, goes on as the drives send currents, comes to rest, and leaves.

Pure: telegrams come in as calls, what has to go out is done by a ``PlantPort``. Tests let it run without ROS.
"""

from collections.abc import Callable, Sequence
from typing import Protocol

from delta3_pacdrive.faults.schedule import Schedule
from delta3_pacdrive.parameters import Motor, Parameters
from delta3_pacdrive.plant.plant_clock import Around, PlantClock
from delta3_pacdrive.sercos import slave
from delta3_pacdrive.sercos.configuration_check import ALL_DRIVES
from delta3_pacdrive.sercos.participants import Occasion
from delta3_pacdrive.sercos.slave import BusSlave
from delta3_pacdrive.sercos.telegrams import NO_SESSION
from delta3_pacdrive.sercos.watchdog import DRIVE_SILENT_S, PARTING_S, Watchdog
from delta3_pacdrive.sercos.words import Phase


def current_max_a(motor: Motor) -> float:
    """Return what no current [A] exceeds: that of back-EMF at twice the maximum speed through a short at the motor."""
    emf_v = motor.torque_constant_n_m_a / 3.0 * 2.0 * motor.max_speed_rad_s
    return motor.peak_current_a + emf_v / (motor.winding_resistance_ohm / 2.0)


class PlantPort(Protocol):
    """What the plant does on the bus."""

    def announce(
        self, session: bytes, occasion: Occasion, links: tuple[str, ...] = (), bus_cycle: int = 0
    ) -> None:
        """Announce itself in a session, with the drives it hears in it and the bus time that is over [cycles]."""

    def belong(self, session: bytes) -> None:
        """Forget frames of the session before; what is sent belongs to this one."""

    def greet(self, begins: bool) -> None:
        """Begin, or end, to tell the drives where their shafts stand, outside of cyclic operation."""

    def send_shafts(self, exchange: int, shafts: Sequence[float]) -> None:
        """Send the true shafts at the start of an exchange period."""

    def tell_rest(self, sentence: str) -> None:
        """Say that the machine stands."""

    def tell_loss(self, sentence: str) -> None:
        """Say which drives are without power, or that the MDT is missing."""


class BusPlant:
    """The machine behind the drives on the bus.

    Parameters
    ----------
    parameters
        Of the robot.
    faults
        Of the plant.
    port
        Does what has to be done outside.
    look_s
        Time between two looks [s].
    now_s
        Returns the time of a clock that never jumps [s].
    around
        What stands around the robot, if anything does.

    Attributes
    ----------
    slave, clock
        Its part in the bus, and the machine in bus time.

    """

    def __init__(
        self,
        parameters: Parameters,
        faults: Schedule,
        port: PlantPort,
        look_s: float,
        now_s: Callable[[], float],
        around: Around | None = None,
    ) -> None:
        self._port, self._now_s = port, now_s
        self._linked: set[str] = set()  # drives that are heard in this session
        self._drives = Watchdog(look_s)
        self._repeated = 0  # currents, at the last look
        self.slave = BusSlave()
        self.clock = PlantClock(parameters, faults, self._send_shafts, around)

    def _send_shafts(self, exchange: int, shafts: Sequence[float]) -> None:
        self._port.send_shafts(exchange, shafts)
        self._drives.received(self._now_s())

    # phases -----------------------------------------------------------------------------------------------------------

    def announced(self, phase: Phase, session: bytes, exchange: int, alone: bool) -> None:
        """Take the announcement of a phase; ``alone``: only one master announces any."""
        self._do(self.slave.announced(phase, session, exchange, moves=True, alone=alone))

    def _do(self, actions: Sequence[slave.Action]) -> None:
        for action in actions:
            match action:
                case slave.Answer(session):
                    self._announce(session, Occasion.CALLED)
                case slave.Report(session):
                    self._announce(session, Occasion.STARTED)
                case slave.Adopt(session):
                    self._linked.clear()
                    self._port.belong(session)
                case slave.Join(start):
                    self._port.greet(False)
                    self.clock.begin(start)
                case slave.Part():
                    self.clock.go_on_without_outputs()  # the drives stop, and are waited for
                case slave.Leave(session, cyclic):
                    self._linked.clear()
                    if cyclic:
                        self._come_to_rest(session)

    def _come_to_rest(self, session: bytes) -> None:
        cycle = self.clock.come_to_rest()
        self._port.greet(True)
        self._announce(session, Occasion.LEFT)
        self._port.tell_rest(f'plant: at rest in bus cycle {cycle}')

    def _announce(self, session: bytes, occasion: Occasion) -> None:
        self._port.announce(session, occasion, tuple(sorted(self._linked)), self.clock.cycles_over)

    def greeted(self, index: int) -> None:
        """Take the answer of a drive to a greeting: from now on it is heard."""
        axis = ALL_DRIVES[index]
        if self.slave.session != NO_SESSION and not self.slave.cyclic and axis not in self._linked:
            self._linked.add(axis)
            self._announce(self.slave.session, Occasion.CALLED)

    # looks ------------------------------------------------------------------------------------------------------------

    def look(self) -> None:
        """Look in cyclic operation whether the drives are still there; whoever is not has lost power."""
        if self.clock.repeated != self._repeated:
            self._repeated = self.clock.repeated
            self._drives.received(self._now_s())  # the bus waits
        silence = self._drives.silence_s(self._now_s())
        if silence <= (PARTING_S if self.slave.parting else DRIVE_SILENT_S):
            return
        silent = self.clock.silent()
        if silent:
            names = ', '.join(ALL_DRIVES[index] for index in silent)
            self._port.tell_loss(f'plant: no current of {names} for {silence:.1f} s: without power')
        else:
            self._port.tell_loss(f'plant: no MDT for {silence:.1f} s: the outputs stay as they are')
        if not self.clock.drop(silent):
            self._do(self.slave.rest())
