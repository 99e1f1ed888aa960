"""The cell as a bus participant: receives outputs with the MDT and sends inputs with the AT.

Messages leave through a ``WorldPort``, without ROS. Outputs of the MDT of one bus cycle take effect in the next.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Protocol

from delta3_pacdrive.cell.parts import Miss, PartRecord
from delta3_pacdrive.cell.world import World
from delta3_pacdrive.configuration.strict_reader import nearest_of
from delta3_pacdrive.errors import Code, Reason, shown
from delta3_pacdrive.planning.program.output_names import OWN, OutputNames, named_bits

COMMANDS_MAX = 64  # queued MDTs that are ahead of the plant


class WorldPort(Protocol):
    """Outgoing messages of a cell."""

    def send_inputs(self, cycle: int, inputs: Mapping[str, bool]) -> None:
        """Send the inputs of a bus cycle."""

    def send_belts(self, cycle: int) -> None:
        """Send the belt data of a bus cycle."""

    def publish_parts(self, document: dict[str, Any]) -> None:
        """Publish the part events of a bus cycle."""


class BusWorld:
    """Steps a cell with the plant and exchanges its inputs and outputs.

    Parameters
    ----------
    outputs
        Output names of the robot and the cell.

    Attributes
    ----------
    outputs
        Outputs in effect, as bits.
    cycle
        Last bus cycle processed, -1 before the first.

    """

    def __init__(self, world: World, port: WorldPort, outputs: OutputNames = OWN) -> None:
        self._world, self._port, self._outputs = world, port, outputs
        self._commands: deque[tuple[int, int]] = deque(maxlen=COMMANDS_MAX)
        self._known = -1  # latest bus cycle with received outputs
        self.outputs, self.cycle = 0, -1

    def begin(self, cycle: int) -> None:
        """Start cyclic operation at a bus cycle, with unchanged outputs."""
        self._commands.clear()
        self._known = cycle - 1

    def take_outputs(self, cycle: int, outputs: int) -> None:
        """Store the outputs of the MDT of a bus cycle, as bits."""
        if cycle > self._known:
            self._known = cycle
            self._commands.append((cycle, outputs))

    def knows(self, cycle: int) -> bool:
        """Whether the outputs in effect in a bus cycle have been received."""
        return self._known >= cycle - 1

    def step(self, cycle: int, tcp_m: Sequence[float], turn_rad: float = 0.0) -> float | None:
        """Advance to a bus cycle.

        Parameters
        ----------
        cycle
            Number of the bus cycle.
        tcp_m, turn_rad
            True TCP position [m] and tool angle [rad] at its beginning.

        Returns
        -------
        float | None
            Payload from now on [kg]; None: the robot's own value applies.

        """
        while self._commands and self._commands[0][0] < cycle:
            self.outputs = self._commands.popleft()[1]
        world = self._world
        # bus time may have advanced while the plant was not in cyclic operation: the robot was at rest
        for now in range(self.cycle + 1 if self.cycle >= 0 else cycle, cycle + 1):
            world.step(now, tcp_m, self.outputs, turn_rad)
            self.cycle = now
            self._report(now)
        if world.inputs:
            self._port.send_inputs(cycle, world.inputs)
        if world.belts:
            self._port.send_belts(cycle)
        return world.carried_kg

    def _report(self, cycle: int) -> None:
        changed, misses = self._world.changed, self._world.misses
        if changed or misses:
            self._port.publish_parts(self._document(cycle, changed, misses))
        self._world.clear_history()  # bounds the memory of a robot that runs for days

    def _document(self, cycle: int, parts: Sequence[PartRecord], misses: Sequence[Miss]) -> dict[str, Any]:
        return {
            'cycle': cycle,
            **self._world.about(),
            'parts': [one.to_document() for one in parts],
            'misses': [one.to_document() for one in misses],
        }

    def drop_part(self) -> None:
        """Let the gripped part fall (injected fault)."""
        self._world.drop_part(self.cycle + 1)

    def force(self, name: str, value: bool | None) -> Reason | str:
        """Force an input to a value, or no longer (None); return the error, or a confirmation."""
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
        change = 'is no longer forced' if value is None else f'is {"on" if value else "off"}'
        return f'{name} {change} from bus cycle {self.cycle + 1} on'

    def to_dict(self) -> dict[str, Any]:
        """Return inputs and outputs of the last bus cycle, and unfinished parts as in ``publish_parts``."""
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
