"""The cell as it takes part in the bus: outputs come with the MDT, inputs go out with the AT, both by bus cycle.

Pure: what goes out is sent by a ``WorldPort``. Outputs of the MDT of a bus cycle are there in the next one.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Protocol

from delta3_pacdrive.configuration.checked import nearest_of
from delta3_pacdrive.errors import Code, Reason, shown
from delta3_pacdrive.motion.output_names import OWN, OutputNames, named_bits
from delta3_pacdrive.peripherals.parts import Miss, PartRecord
from delta3_pacdrive.peripherals.world import World

COMMANDS_MAX = 64  # MDT that are ahead of the plant


class WorldPort(Protocol):
    """What a cell does on the bus."""

    def send_inputs(self, cycle: int, inputs: Mapping[str, bool]) -> None:
        """Send the inputs of a bus cycle."""

    def send_belts(self, cycle: int) -> None:
        """Send what the belts tell in a bus cycle."""

    def tell_parts(self, told: dict[str, Any]) -> None:
        """Tell what has happened to parts in a bus cycle."""


class BusWorld:
    """A cell goes on with the plant.

    Parameters
    ----------
    world
        The cell.
    port
        Sends.
    outputs
        Those of the robot, by all their names.

    Attributes
    ----------
    outputs
        That are there, as bits.
    cycle
        The last bus cycle that it has gone through, -1 before the first one.

    """

    def __init__(self, world: World, port: WorldPort, outputs: OutputNames = OWN) -> None:
        self._world, self._port, self._outputs = world, port, outputs
        self._commands: deque[tuple[int, int]] = deque(maxlen=COMMANDS_MAX)
        self._known = -1  # newest bus cycle whose outputs are known
        self.outputs, self.cycle = 0, -1

    def begin(self, cycle: int) -> None:
        """Begin cyclic operation with a bus cycle: the outputs are as they were."""
        self._commands.clear()
        self._known = cycle - 1

    def take_outputs(self, cycle: int, outputs: int) -> None:
        """Take the outputs of the MDT of a bus cycle, as bits."""
        if cycle > self._known:
            self._known = cycle
            self._commands.append((cycle, outputs))

    def knows(self, cycle: int) -> bool:
        """Whether the outputs are known that are there in a bus cycle."""
        return self._known >= cycle - 1

    def step(self, cycle: int, tcp_m: Sequence[float], turn_rad: float = 0.0) -> float | None:
        """Go on to a bus cycle, with the true place of the TCP [m] and angle of the tool [rad] at its begin.

        Returns
        -------
        float | None
            Mass that hangs at the robot from now on [kg]; None: the robot says it.

        """
        while self._commands and self._commands[0][0] < cycle:
            self.outputs = self._commands.popleft()[1]
        world = self._world
        # bus time may have gone on while the plant was not in it: the robot stood
        for now in range(self.cycle + 1 if self.cycle >= 0 else cycle, cycle + 1):
            world.step(now, tcp_m, self.outputs, turn_rad)
            self.cycle = now
            self._tell(now)
        if world.inputs:
            self._port.send_inputs(cycle, world.inputs)
        if world.belts:
            self._port.send_belts(cycle)
        return world.carried_kg

    def _tell(self, cycle: int) -> None:
        changed, misses = self._world.changed, self._world.misses
        if changed or misses:
            self._port.tell_parts(self._document(cycle, changed, misses))
        self._world.forget()  # a robot that is up for days has no end of parts

    def _document(self, cycle: int, parts: Sequence[PartRecord], misses: Sequence[Miss]) -> dict[str, Any]:
        return {
            'cycle': cycle,
            **self._world.about(),
            'parts': [one.to_document() for one in parts],
            'misses': [one.to_document() for one in misses],
        }

    def lose_part(self) -> None:
        """Let what hangs at the robot fall off: a fault is injected."""
        self._world.lose_part(self.cycle + 1)

    def force(self, name: str, value: bool | None) -> Reason | str:
        """Set an input from outside, or let it tell again what is true (None); returns why not, or since when."""
        inputs = self._world.inputs
        if name not in inputs:
            known = ', '.join(inputs) or 'none'
            return Reason(
                Code.CONTENT,
                f'unknown input {shown(name)}, the inputs are: {known}{nearest_of(name, tuple(inputs))}',
            )
        if value is None:
            self._world.forced.pop(name, None)
        else:
            self._world.forced[name] = value
        how = 'tells again what is true' if value is None else f'is {"on" if value else "off"}'
        return f'{name} {how} from bus cycle {self.cycle + 1} on'

    def to_dict(self) -> dict[str, Any]:
        """Return inputs and outputs of the last bus cycle, and what is not over yet, as ``tell_parts`` tells it."""
        forced = self._world.forced
        return {
            'cycle': self.cycle,
            'inputs': {
                name: {'value': value, 'forced': name in forced} for name, value in self._world.inputs.items()
            },
            'outputs': named_bits(self.outputs, self._outputs),
            'output_names': {name: asdict(one) for name, one in self._outputs.items()},
            'under_way': self._document(self.cycle, *self._world.under_way()),
        }
