"""The plant as a bus participant: joins, advances with the currents of the drives, comes to rest, and leaves.

Free of ROS: telegrams arrive as calls, and a ``PlantPort`` sends.
"""

from collections.abc import Callable, Sequence
from typing import Protocol

from delta3_pacdrive.parameters import Motor, Parameters
from delta3_pacdrive.robot.faults.schedule import Schedule
from delta3_pacdrive.robot.plant.plant_clock import Around, PlantClock
from delta3_pacdrive.robot.sercos import slave
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES
from delta3_pacdrive.robot.sercos.participants import Occasion
from delta3_pacdrive.robot.sercos.slave import BusSlave
from delta3_pacdrive.robot.sercos.telegrams import NO_SESSION
from delta3_pacdrive.robot.sercos.watchdog import DRIVE_SILENT_S, PARTING_S, Watchdog
from delta3_pacdrive.robot.sercos.words import Phase


def current_max_a(motor: Motor) -> float:
    """Return an upper bound of currents [A]: back-EMF at twice the maximum speed through a short at the motor."""
    emf_v = motor.torque_constant_n_m_a / 3.0 * 2.0 * motor.max_speed_rad_s
    return motor.peak_current_a + emf_v / (motor.winding_resistance_ohm / 2.0)


class PlantPort(Protocol):
    """Outgoing messages of the plant."""

    def announce(
        self, session: bytes, occasion: Occasion, links: tuple[str, ...] = (), bus_cycle: int = 0
    ) -> None:
        """Announce the plant with the drives received in this session and the first bus cycle not processed."""

    def belong(self, session: bytes) -> None:
        """Adopt a session: clear the frames of the previous one."""

    def greet(self, begins: bool) -> None:
        """Start or stop publishing the shafts to the drives outside cyclic operation."""

    def send_shafts(self, exchange: int, shafts: Sequence[float]) -> None:
        """Send the true shafts at the start of an exchange period."""

    def send_link(self, cycle: int, values: Sequence[float]) -> None:
        """Send the state of a DC link with a model at the start of a bus cycle."""

    def send_temperatures(self, cycle: int, values: Sequence[float]) -> None:
        """Send the temperatures of a robot that warms up at the start of a bus cycle."""

    def report_rest(self, sentence: str) -> None:
        """Report that the machine is at rest."""

    def report_loss(self, sentence: str) -> None:
        """Report drives without power, or missing MDTs."""


class BusPlant:
    """The plant on the bus."""

    def __init__(
        self,
        parameters: Parameters,
        faults: Schedule,
        port: PlantPort,
        poll_s: float,
        now_s: Callable[[], float],
        around: Around | None = None,
    ) -> None:
        self._port, self._now_s = port, now_s
        self._linked: set[str] = set()  # drives received in this session
        self._drives = Watchdog(poll_s)
        self._repeated = 0  # repeated currents, at the last poll
        self.slave = BusSlave()
        self.clock = PlantClock(
            parameters,
            faults,
            self._send_shafts,
            around,
            publish_link=port.send_link,
            publish_temperatures=port.send_temperatures,
        )

    def _send_shafts(self, exchange: int, shafts: Sequence[float]) -> None:
        self._port.send_shafts(exchange, shafts)
        self._drives.received(self._now_s())

    # phases -----------------------------------------------------------------------------------------------------------

    def announced(self, phase: Phase, session: bytes, exchange: int, alone: bool) -> None:
        """Process the announcement of a phase; ``alone``: only one master announces phases."""
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
                    self.clock.continue_without_outputs()  # the drives are stopping, and their currents are awaited
                case slave.Leave(session, cyclic):
                    self._linked.clear()
                    if cyclic:
                        self._come_to_rest(session)

    def _come_to_rest(self, session: bytes) -> None:
        cycle = self.clock.come_to_rest()
        self._port.greet(True)
        self._announce(session, Occasion.LEFT)
        self._port.report_rest(f'plant: at rest in bus cycle {cycle}')

    def _announce(self, session: bytes, occasion: Occasion) -> None:
        self._port.announce(session, occasion, tuple(sorted(self._linked)), self.clock.cycles_over)

    def greeted(self, index: int) -> None:
        """Register a drive that has replied to a greeting."""
        axis = ALL_DRIVES[index]
        if self.slave.session != NO_SESSION and not self.slave.cyclic and axis not in self._linked:
            self._linked.add(axis)
            self._announce(self.slave.session, Occasion.CALLED)

    # polling ----------------------------------------------------------------------------------------------------------

    def poll(self) -> None:
        """Check for a timeout of the drives; silent drives count as unpowered."""
        if self.clock.repeated != self._repeated:
            self._repeated = self.clock.repeated
            self._drives.received(self._now_s())  # the bus is waiting
        silence = self._drives.silence_s(self._now_s())
        if silence <= (PARTING_S if self.slave.parting else DRIVE_SILENT_S):
            return
        silent = self.clock.silent()
        if silent:
            names = ', '.join(ALL_DRIVES[index] for index in silent)
            self._port.report_loss(f'plant: no current of {names} for {silence:.1f} s: without power')
        else:
            self._port.report_loss(f'plant: no MDT for {silence:.1f} s: the outputs stay as they are')
        if not self.clock.drop(silent):
            self._do(self.slave.rest())
