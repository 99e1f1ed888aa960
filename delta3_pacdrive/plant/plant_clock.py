"""When the plant goes on: exchange period by exchange period, as the currents of the drives come.

The plant keeps bus time: the world stands while the bus is not in cyclic operation. Whenever cyclic operation ends, the
machine goes on without current, its brakes falling, for ``REST_S`` of bus time, in which it comes to rest.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from delta3_pacdrive.faults.effects import apply_to_plant
from delta3_pacdrive.faults.schedule import Schedule
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.plant.plant import Plant
from delta3_pacdrive.sercos.configuration_check import DRIVES

REST_S = 1.0


class PlantClock:
    """The plant in bus time.

    Parameters
    ----------
    parameters
        Of the robot.
    faults
        Of the plant.
    publish
        Called with the number of an exchange and the true shafts at its start.

    Attributes
    ----------
    exchange
        Number of the present exchange period, whose currents are awaited.
    powerless
        Drives that have sent no current: their motors are without power until cyclic operation begins anew.

    """

    def __init__(
        self, parameters: Parameters, faults: Schedule, publish: Callable[[int, Sequence[float]], None]
    ) -> None:
        bus = parameters.bus
        self._plant = Plant(parameters)
        self._faults, self._publish = faults, publish
        self.exchange = 0
        self._per_cycle = round(bus.cycle_time_s / bus.exchange_period_s)
        self._rest_cycles = math.ceil(REST_S / bus.cycle_time_s)
        self.samples = round(bus.exchange_period_s / parameters.drive.current_period_s)
        self._matrix = np.zeros((self.samples, len(DRIVES)))
        self._no_currents = (0.0,) * self.samples
        self._currents: list[dict[int, tuple[bool, float, tuple[float, ...]]]] = [{} for _ in DRIVES]
        self._payload: float | None = None
        self.powerless: set[int] = set()

    @property
    def cycle(self) -> int:
        """Present bus cycle."""
        return self.exchange // self._per_cycle

    @property
    def cycles_over(self) -> int:
        """First bus cycle that the plant has not seen; its last shafts were those of the present exchange."""
        return -(-self.exchange // self._per_cycle) + 1 if self.exchange else 0

    def shafts(self) -> Sequence[float]:
        """Return the true shafts: positions [rad], speeds [rad/s] and coupling torques d [N m]."""
        return self._plant.shafts()

    def begin(self, exchange: int) -> None:
        """Begin cyclic operation; bus time goes on there, it never goes back."""
        self.exchange = max(self.exchange, exchange)
        for waiting in self._currents:
            waiting.clear()
        self.powerless.clear()
        self._publish(self.exchange, self._plant.shafts())

    def take(
        self, index: int, exchange: int, released: bool, payload: float, values: tuple[float, ...]
    ) -> bool:
        """Take the currents of a drive and go on if they were the last; False if they are ahead of what it can know."""
        if exchange > self.exchange + self._per_cycle:
            return False
        waiting = self._currents[index]
        if exchange >= self.exchange and exchange not in waiting:
            waiting[exchange] = released, payload, values
            first, second, third = self._currents
            if (exchange in first and exchange in second and exchange in third) or self.powerless:
                self._advance()
        return True

    def silent(self) -> list[int]:
        """Return the drives whose currents are awaited."""
        return [index for index, waiting in enumerate(self._currents) if self.exchange not in waiting]

    def drop(self, silent: Sequence[int]) -> bool:
        """Go on without the currents of some drives; False if no drive has power any more."""
        self.powerless.update(silent)
        self._advance()
        return len(self.powerless) < len(DRIVES)

    def come_to_rest(self) -> int:
        """Let the machine go on without any current until it stands; return the bus cycle from which on it does."""
        end = -(-self.exchange // self._per_cycle) + self._rest_cycles
        self.powerless.update(range(len(DRIVES)))
        while self.exchange < end * self._per_cycle:
            self._integrate()
        return end

    def _advance(self) -> None:
        """Integrate every period whose currents are there from all drives that have power, as long as any has."""
        first, second, third = self._currents
        while True:
            exchange = self.exchange
            if not (exchange in first and exchange in second and exchange in third) and (
                not 0 < len(self.powerless) < len(DRIVES) or not self.powerless.issuperset(self.silent())
            ):
                return
            self._integrate()

    def _integrate(self) -> None:
        if self.exchange >= self._faults.next_cycle * self._per_cycle:
            changes = self._faults.due(self.cycle)
            apply_to_plant(self._plant.state[0], changes, self._faults.active)
        brakes = []
        for index, waiting in enumerate(self._currents):
            released = False
            values = self._no_currents
            current = waiting.pop(self.exchange, None)
            if current is not None and index not in self.powerless:
                # all three drives pass on the same payload, that of the MDT before
                released, self._payload, values = current
            self._matrix[:, index] = values
            brakes.append(released)
        self._plant.advance(self._matrix, brakes, self._payload)
        self.exchange += 1
        self._publish(self.exchange, self._plant.shafts())
