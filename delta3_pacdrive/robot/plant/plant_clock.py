"""Bus time of the plant: advances by exchange periods as the currents of the drives arrive.

Simulated time stops while the bus is not in cyclic operation. At the end of cyclic operation the machine continues
without current and with applied brakes for ``REST_S`` of bus time, in which it comes to rest.
"""

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from delta3_pacdrive.parameters import ARMS, Parameters
from delta3_pacdrive.robot.faults.effects import (
    apply_to_link,
    apply_to_motors,
    apply_to_plant,
    apply_to_temperatures,
)
from delta3_pacdrive.robot.faults.schedule import Schedule
from delta3_pacdrive.robot.plant.dc_link import DcLink
from delta3_pacdrive.robot.plant.plant import Plant
from delta3_pacdrive.robot.plant.rotary_plant import RotaryPlant
from delta3_pacdrive.robot.plant.temperatures import Temperatures

REST_S = 1.0
OUTPUTS_AHEAD_MAX = 64  # largest lead of an MDT over the plant [bus cycles]


class Around(Protocol):
    """Cell of the robot, stepped with the plant in bus cycles."""

    def begin(self, cycle: int) -> None:
        """Start cyclic operation at a bus cycle."""

    def take_outputs(self, cycle: int, outputs: int) -> None:
        """Store the outputs of the MDT of a bus cycle, as bits."""

    def knows(self, cycle: int) -> bool:
        """Whether the outputs in effect in a bus cycle have been received."""

    def step(self, cycle: int, tcp_m: Sequence[float], turn_rad: float) -> float | None:
        """Advance to a bus cycle, with the true TCP [m] and tool angle [rad] at its beginning.

        Returns the payload [kg]; None: the robot's own value applies.
        """

    def drop_part(self) -> None:
        """Let the gripped part fall."""


class PlantClock:
    """The plant in bus time.

    Parameters
    ----------
    publish
        Called with the number of an exchange and the true shafts at its start.
    publish_link, publish_temperatures
        Called before at the start of each bus cycle if the DC link has a model, or if the robot warms up, with the
        cycle and the numbers of ``telegrams.DC_LINK`` or ``telegrams.temperatures``.

    Attributes
    ----------
    exchange
        Number of the present exchange period, whose currents are awaited.
    repeated
        Number of currents received twice, which drives send while the bus is waiting.
    powerless
        Drives that have sent no current: their motors are unpowered until the next start of cyclic operation, or until
        they send the current of the present exchange.

    """

    def __init__(
        self,
        parameters: Parameters,
        faults: Schedule,
        publish: Callable[[int, Sequence[float]], None],
        around: Around | None = None,
        publish_link: Callable[[int, Sequence[float]], None] | None = None,
        publish_temperatures: Callable[[int, Sequence[float]], None] | None = None,
    ) -> None:
        bus = parameters.bus
        self._link, self._publish_link = DcLink(parameters), publish_link
        self._temperatures, self._publish_temperatures = Temperatures(parameters), publish_temperatures
        self._plant = Plant(parameters)
        self._axes = parameters.axes
        self._rotary = [RotaryPlant(parameters, number) for number in range(len(self._axes) - ARMS)]
        self._faults, self._publish, self._around = faults, publish, around
        self._carried: float | None = None  # true payload, if known
        self._waits = True  # for the outputs of the previous MDT, if there is a cell
        self.exchange = self.repeated = 0
        self._per_cycle = round(bus.cycle_time_s / bus.exchange_period_s)
        self._rest_cycles = math.ceil(REST_S / bus.cycle_time_s)
        self.samples = round(bus.exchange_period_s / parameters.drive.current_period_s)
        self._matrix = np.zeros((self.samples, len(self._axes)))
        # by drive: its motor
        self._motors = [parameters.mounting.motor_of(index) for index in range(len(self._axes))]
        self._columns = [self._matrix.T[motor] for motor in self._motors]
        self._no_currents = (0.0,) * self.samples
        self._currents: list[dict[int, tuple[bool, float, tuple[float, ...]]]] = [{} for _ in self._axes]
        self._payload: float | None = None
        self.powerless: set[int] = set()

    @property
    def cycle(self) -> int:
        """Present bus cycle."""
        return self.exchange // self._per_cycle

    @property
    def cycles_over(self) -> int:
        """First bus cycle not processed; the last shafts were those of the present exchange."""
        return -(-self.exchange // self._per_cycle) + 1 if self.exchange else 0

    def shafts(self) -> Sequence[float]:
        """Return the true shafts: positions [rad], speeds [rad/s] and coupling torques d [N m], by axis."""
        shafts = self._plant.shafts()
        for count, axis in enumerate(self._rotary, ARMS + 1):
            for row, value in enumerate(axis.shaft(), 1):
                shafts.insert(count * row - 1, value)  # at the end of the row of this quantity
        return shafts

    def begin(self, exchange: int) -> None:
        """Start cyclic operation; bus time never decreases."""
        self.exchange = max(self.exchange, exchange)
        for waiting in self._currents:
            waiting.clear()
        self.powerless.clear()
        self._waits = True
        if self._around is not None:
            self._around.begin(-(-self.exchange // self._per_cycle))
        self._send()

    def take(
        self, index: int, exchange: int, released: bool, payload: float, values: tuple[float, ...]
    ) -> bool:
        """Store the currents of a drive and advance if they are complete; False if they are ahead of bus time."""
        if exchange > self.exchange + self._per_cycle:
            return False
        waiting = self._currents[index]
        self.repeated += exchange < self.exchange
        if exchange >= self.exchange and exchange not in waiting:
            waiting[exchange] = released, payload, values
            if exchange == self.exchange:
                # otherwise a drive that continues would push against its brake until its I2t monitoring trips
                self.powerless.discard(index)
            if self.powerless or self._has_currents(exchange):
                self._advance()
        return True

    def _has_currents(self, exchange: int) -> bool:
        """Whether the currents of all drives have arrived."""
        for waiting in self._currents:  # noqa: SIM110  a generator takes twice as long
            if exchange not in waiting:
                return False
        return True

    def take_outputs(self, cycle: int, outputs: int) -> None:
        """Store the outputs of the MDT of a bus cycle, as bits, and advance if nothing else is awaited."""
        if self._around is not None and cycle <= self.cycle + OUTPUTS_AHEAD_MAX:
            self._around.take_outputs(cycle, outputs)
            self._waits = True  # the master is sending outputs again
            self._advance()

    def silent(self) -> list[int]:
        """Return the drives whose currents are awaited."""
        return [index for index, waiting in enumerate(self._currents) if self.exchange not in waiting]

    def drop(self, silent: Sequence[int]) -> bool:
        """Continue without the currents of some drives, and without outputs; False if no powered drive is left."""
        self.powerless.update(silent)
        self.continue_without_outputs()
        return len(self.powerless) < len(self._currents)

    def continue_without_outputs(self) -> None:
        """Do not wait for outputs until some arrive again: the master may be lost, and the drives are stopping."""
        self._waits = False
        self._advance()

    def come_to_rest(self) -> int:
        """Run the machine without current until it is at rest; return the first bus cycle at rest."""
        end = -(-self.exchange // self._per_cycle) + self._rest_cycles
        self.powerless.update(range(len(self._currents)))
        while self.exchange < end * self._per_cycle:
            self._integrate()
        return end

    def _advance(self) -> None:
        """Integrate every period whose currents from all powered drives have arrived, while any drive is powered."""
        drives = len(self._currents)
        while True:
            if not self._has_currents(self.exchange) and (
                not 0 < len(self.powerless) < drives or not self.powerless.issuperset(self.silent())
            ):
                return
            if not self._knows_outputs():
                return
            self._integrate()

    def _knows_outputs(self) -> bool:
        """Whether the outputs of the previous MDT have arrived, if they are required."""
        if self._around is None or not self._waits or self.exchange % self._per_cycle:
            return True
        return self._around.knows(self.cycle)

    def _integrate(self) -> None:
        if self.exchange >= self._faults.next_cycle * self._per_cycle:
            changes = self._faults.due(self.cycle)
            apply_to_plant(self._plant.state[0], changes, self._faults.active)
            apply_to_link(self._link.state[0], self._faults.active)
            apply_to_temperatures(self._temperatures.bodies, self._faults.active, self._axes)
            for rotary, name in zip(self._rotary, self._axes[ARMS:], strict=True):
                apply_to_motors(rotary.state[0], self._faults.active, (name,))
            if self._around is not None and any(fault.kind == 'payload_lost' for fault, _ in changes):
                self._around.drop_part()
        if self._around is not None and not self.exchange % self._per_cycle:
            turn_rad = sum((axis.angle_rad for axis in self._rotary), 0.0)
            self._carried = self._around.step(self.cycle, self._plant.tcp().tolist(), turn_rad)
        warms, begins = self._temperatures.enabled, not self.exchange % self._per_cycle
        if warms and begins:
            self._temperatures.warm(self._plant.state[0], [axis.state[0] for axis in self._rotary])
        brakes = [False] * len(self._motors)
        for index, (column, waiting) in enumerate(zip(self._columns, self._currents, strict=True)):
            released = False
            values = self._no_currents
            current = waiting.pop(self.exchange, None)
            if current is not None and index not in self.powerless:
                # all drives pass on the same payload, that of the previous MDT
                released, self._payload, values = current
            column[:] = values
            brakes[self._motors[index]] = released
        payload = self._payload if self._carried is None else self._carried
        self._plant.advance(self._matrix, brakes[:ARMS], payload)
        for axis, released in zip(self._rotary, brakes[ARMS:], strict=True):
            axis.advance(self._matrix, released, float(self._plant.state['carried'][0]))
        if self._link.enabled:
            self._link.advance(sum((axis.drawn_j for axis in self._rotary), self._plant.drawn_j))
        self.exchange += 1
        if warms:
            shafts, axes = self.shafts(), len(self._axes)
            self._temperatures.collect(self._matrix, shafts[axes : 2 * axes])
            if not self.exchange % self._per_cycle:
                self._temperatures.end_cycle()
        self._send()

    def _send(self) -> None:
        """Publish the state at the start of the present exchange period."""
        if self._link.enabled and self._publish_link is not None and not self.exchange % self._per_cycle:
            self._publish_link(self.cycle, (*self._link.values(), *self._link.powers_w()))
            self._link.begin_cycle()
        if (
            self._temperatures.enabled
            and self._publish_temperatures is not None
            and not self.exchange % self._per_cycle
        ):
            self._publish_temperatures(self.cycle, self._temperatures.values())
        self._publish(self.exchange, self.shafts())
