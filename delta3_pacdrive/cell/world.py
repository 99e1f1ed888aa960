"""Simulation of the cell around a robot, one bus cycle at a time.

The module is long because parts pass between supplies, belts, cup and boxes within one bus cycle, in a fixed order.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any
from zlib import crc32

import numpy as np

from delta3_pacdrive.belts.camera import CameraState, Sighting
from delta3_pacdrive.belts.model import BeltState, OnBelt, Place
from delta3_pacdrive.cell import cell_scene
from delta3_pacdrive.cell.binary_signal import BinarySignal
from delta3_pacdrive.cell.cell import Box, Cell, CellFault, Delays, Input
from delta3_pacdrive.cell.gripper import Gripper
from delta3_pacdrive.cell.parts import How, Landing, Miss, Outcome, Part, PartRecord, landing
from delta3_pacdrive.cell.parts_report import report_of
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.planning.paths.move import OUTPUTS
from delta3_pacdrive.recording.signals import CELL_BELTS, CELL_INPUTS

DROPPED_BY_FAULT = 'it fell off by an injected fault'


class World:
    """State of a cell; ``step`` is called once per bus cycle, in order.

    Equal cells and robots give bit-identical results: every random effect has its own generator, seeded by the seed of
    the cell and the name of the affected object.

    Attributes
    ----------
    records
        Records of all parts in order of appearance, since ``clear_history``.
    changed
        Records changed in this bus cycle.
    sightings
        Parts reported in this bus cycle by the camera of each belt.
    scene
        Document of ``cell_scene`` for displays.

    """

    def __init__(self, cell: Cell, cycle_time_s: float, start_cycle: int = 0) -> None:
        self._cell, self._cycle_time_s, self._start = cell, cycle_time_s, start_cycle
        self.inputs: dict[str, bool] = dict.fromkeys(cell.input_names, False)
        self.forced: dict[str, bool] = {}
        self.records: list[PartRecord] = []
        self._parts_so_far = 0
        self.changed: list[PartRecord] = []
        self._lying: dict[int, Part] = {}  # all parts that are not in hand, by number
        self._clearing: list[tuple[int, int]] = []  # parts to be removed from boxes: bus cycle, number
        self._tcp_history: list[Place] = []  # positions of the last three bus cycles
        self._cycle = -1
        self._stepped = False
        self._lost: list[PartRecord] = []  # parts lost between two bus cycles
        self._signals = {
            name: BinarySignal(one.delays, cycle_time_s, self._generator(name))
            for name, one in cell.inputs.items()
        }
        self._gripper: Gripper | None = None
        self._switch: BinarySignal | None = None
        self._switch_raw = False
        cup = cell.cup
        if cup is not None:
            self._gripper = Gripper(cup, cycle_time_s, self._generator('valve'))
            self._output = 1 << OUTPUTS.index(cup.output)
            if cup.switch is not None:
                self._switch = BinarySignal(
                    cup.switch.delays, cycle_time_s, self._generator(cup.switch.input)
                )
        # outputs that inputs follow, with the delays of their devices
        followed = {one.follows for one in cell.inputs.values() if one.follows}
        delays = {one.output: one.delays for one in cell.outputs.values()}
        if cup is not None:
            delays[cup.output] = cup.valve
        self._followed = {
            name: BinarySignal(delays.get(name, Delays()), cycle_time_s, self._generator(name))
            for name in sorted(followed)
        }
        self._left = {name: supply.count for name, supply in cell.supplies.items()}
        self._next = dict.fromkeys(cell.supplies, 0)  # earliest bus cycle of the next part
        self._waiting: dict[str, Part] = {}
        self._places = [
            *cell.boxes.values(),
            *(Box(supply.name, supply.at_m) for supply in cell.supplies.values()),
        ]
        self.belts = {
            name: BeltState(belt, cycle_time_s, start_cycle, self._generator(name))
            for name, belt in cell.belts.items()
        }
        self._cameras = {
            name: CameraState(belt.camera, cycle_time_s, self._generator(f'camera {name}'))
            for name, belt in cell.belts.items()
            if belt.camera is not None
        }
        self.sightings: dict[str, list[Sighting]] = {name: [] for name in self._cameras}
        self._on_belts: dict[str, dict[int, tuple[OnBelt, Part]]] = {name: {} for name in cell.belts}
        self.scene = cell_scene.document_of(cell)
        self._refill(0)

    def _generator(self, name: str) -> np.random.Generator:
        return np.random.default_rng([self._cell.seed, crc32(name.encode())])

    def _cycle_of(self, after_s: float) -> int:
        return self._start + math.ceil(after_s / self._cycle_time_s - 1e-9)

    @property
    def carried_kg(self) -> float | None:
        """Payload [kg]; None: the cell has no gripper, so that the robot's own value applies."""
        return None if self._gripper is None else self._gripper.carried_kg

    def step(
        self, cycle: int, tcp_m: Sequence[float], outputs: int, turn_rad: float = 0.0
    ) -> Mapping[str, bool]:
        """Advance to a bus cycle; return the inputs at its beginning.

        Parameters
        ----------
        cycle
            Number of the bus cycle.
        tcp_m, turn_rad
            True TCP position [m], shape (3,), and tool angle [rad] at its beginning.
        outputs
            Outputs in effect, bit n = output n; those of an MDT take effect one bus cycle later.

        Returns
        -------
        Mapping[str, bool]
            Inputs by name, sent with the AT of this bus cycle.

        Raises
        ------
        RunError
            The bus cycle does not follow the last one.

        """
        if self._cycle >= 0 and cycle != self._cycle + 1:
            raise RunError(
                f'the cell is in bus cycle {self._cycle}, and bus cycle {cycle} does not follow it'
            )
        self._cycle = cycle
        tcp = (float(tcp_m[0]), float(tcp_m[1]), float(tcp_m[2]))
        self._tcp_history = [*self._tcp_history[-2:], tcp]
        if self._stepped:  # records from before the first bus cycle are reported with it
            self.changed = []
        self._stepped = True
        self.changed += self._lost
        self._lost.clear()
        self._clear(cycle)
        self._refill(cycle)
        for name in self.belts:
            self._move_belt(name, cycle)
        gripper = self._gripper
        if gripper is not None:
            pump = self._active('vacuum_failure', cycle) is None
            output = bool(outputs & self._output)
            released = gripper.step(
                cycle,
                tcp,
                self._acceleration(),
                output=output,
                pump=pump,
                lying=self._lying.values(),
                turn_rad=turn_rad,
            )
            if gripper.part is not None:
                self._pick_up(gripper.part, cycle, tcp, turn_rad)
            if released is not None:
                self._land(released, cycle)
                self.changed.append(released.record)
        for name, signal in self._followed.items():
            signal.step(bool(outputs >> OUTPUTS.index(name) & 1))
        self._update_inputs(cycle)
        return self.inputs

    def pictures(self, belt: str) -> int:
        """Return the number of pictures taken by the camera of a belt; 0 without a camera."""
        camera = self._cameras.get(belt)
        return 0 if camera is None else camera.pictures

    def picture_cycle(self, belt: str) -> int:
        """Return the bus cycle of the picture whose parts the camera of a belt reports now."""
        return self._cycle - self._cameras[belt].latency_cycles

    def drop_part(self, cycle: int) -> None:
        """Let the gripped part fall (injected fault)."""
        lost = None if self._gripper is None else self._gripper.drop(cycle, DROPPED_BY_FAULT)
        if lost is not None:
            lost.stay(cycle, How.GONE)
            self._lost.append(lost.record)

    def under_way(self) -> tuple[list[PartRecord], list[Miss]]:
        """Return the records of gripped parts, and the miss that closing the valve now would cause."""
        missing = [] if self._gripper is None else self._gripper.missing(self._cycle)
        return [part.record for part in self._in_hand()], missing

    def clear_history(self) -> None:
        """Clear records and misses that have been reported."""
        self.records.clear()
        self.misses.clear()

    def finish(self) -> None:
        """Record a pending miss at the end of a run."""
        if self._gripper is not None:
            self._gripper.finish(self._cycle)

    def _acceleration(self) -> Place:
        """TCP acceleration [m/s^2] of the previous bus cycle, from the last three positions."""
        if len(self._tcp_history) < 3:
            return (0.0, 0.0, 0.0)
        a, b, c = self._tcp_history
        factor = 1.0 / self._cycle_time_s**2
        return (
            (a[0] - 2.0 * b[0] + c[0]) * factor,
            (a[1] - 2.0 * b[1] + c[1]) * factor,
            (a[2] - 2.0 * b[2] + c[2]) * factor,
        )

    def _active(self, kind: str, cycle: int, target: str = '') -> CellFault | None:
        """Return the latest fault of a kind that is active in a bus cycle."""
        for fault in reversed(self._cell.faults):
            if fault.kind == kind and fault.target == target:
                first = self._cycle_of(fault.after_s)
                if first <= cycle and (
                    math.isinf(fault.for_s) or cycle < self._cycle_of(fault.after_s + fault.for_s)
                ):
                    return fault
        return None

    def _refill(self, cycle: int) -> None:
        """Put the next part of each empty supply in its place once the refill time is over."""
        for name, supply in self._cell.supplies.items():
            if name not in self._waiting and self._left[name] > 0 and cycle >= self._next[name]:
                self._left[name] -= 1
                part = self._new_part(supply.part, name, supply.at_m, supply.angle_rad)
                part.stay(cycle, How.LYING)
                self._waiting[name] = part

    def _move_belt(self, name: str, cycle: int) -> None:
        """Advance a belt with its parts and its camera."""
        state, on_it = self.belts[name], self._on_belts[name]
        for entered in state.step(cycle):
            stream = state.belt.stream
            if stream is not None:
                part = self._new_part(
                    entered.type,
                    name,
                    state.place_m(entered),
                    state.belt.direction_rad + entered.angle_rad,
                )
                part.stay(cycle, How.RIDING, belt=name, count=state.count)
                on_it[part.record.number] = entered, part
        for on_belt, part in on_it.values():
            part.at_m = state.place_m(on_belt)
        for gone in state.leave():
            number = next(number for number, (one, _) in on_it.items() if one is gone)
            _, part = on_it.pop(number)
            self._lying.pop(number, None)
            part.stay(cycle, How.GONE)
            if part.record.outcome is Outcome.WAITING:
                part.record.outcome = Outcome.PASSED
            self.changed.append(part.record)
        jump = self._active('encoder_jump', cycle, name)
        state.jump(0.0 if jump is None else jump.value)
        camera = self._cameras.get(name)
        if camera is not None:
            camera.dead = self._active('camera_dead', cycle, name) is not None
            self.sightings[name] = camera.step(cycle, state)

    def _new_part(self, kind: str, source: str, at_m: Place, angle_rad: float) -> Part:
        record = PartRecord(self._parts_so_far, kind, source, size_m=self._cell.parts[kind].size_m)
        part = Part(self._cell.parts[kind], at_m, angle_rad, record)
        self._parts_so_far += 1
        self.records.append(record)
        self.changed.append(record)
        self._lying[record.number] = part
        return part

    def _pick_up(self, part: Part, cycle: int, tcp_m: Place, turn_rad: float) -> None:
        """Remove a gripped part from its support."""
        if self._lying.pop(part.record.number, None) is None:
            return
        part.stay(cycle, How.IN_HAND, tcp_m, turn_rad=turn_rad)
        self.changed.append(part.record)
        source = part.record.source
        if self._waiting.get(source) is part:
            del self._waiting[source]
            refill = self._cell.supplies[source].refill_s
            self._next[source] = cycle + math.ceil(refill / self._cycle_time_s - 1e-9)
        for name, on_it in self._on_belts.items():
            found = on_it.pop(part.record.number, None)
            if found is not None:
                self.belts[name].take(found[0].number)

    def _land(self, part: Part, cycle: int) -> None:
        """Put a released part on its support, or remove it if it was lost on the way or has no support."""
        record = part.record
        if record.outcome is Outcome.LOST:
            part.stay(cycle, How.GONE)
            return
        found = landing(part, self._places, self._lying.values())
        on_belt = None
        if found is None:
            found, on_belt = self._belt_below(part)
        if found is None:
            record.outcome, record.reason = Outcome.DROPPED, 'there was nothing below it'
            part.stay(cycle, How.GONE)
            return
        x, y, z = part.at_m
        drop = z - found.height_m
        record.where, record.place = found.where, found.place
        record.place_error_m = (*found.error_m, drop)
        box = self._cell.boxes.get(found.where)
        if box is not None:
            layer = round((found.height_m - box.at_m[2]) / part.type.size_m[2])
            record.place += layer * box.columns * box.rows
        if drop > self._cell.drop_max_m:
            record.outcome, record.reason = Outcome.DROPPED, f'it fell {1e3 * drop:.1f} mm'
        elif self._cell.cup is not None and drop < -self._cell.cup.height_tolerance_m:
            record.outcome = Outcome.PRESSED
            record.reason = f'it was {-1e3 * drop:.1f} mm below the height of its support'
        else:
            record.outcome = Outcome.PLACED
        part.at_m = (x, y, found.height_m)
        self._lying[record.number] = part
        if on_belt is not None and record.outcome is not Outcome.DROPPED:
            self.belts[found.where].put(on_belt)
            self._on_belts[found.where][record.number] = on_belt, part
            part.stay(cycle, How.RIDING, belt=found.where, count=self.belts[found.where].count)
        else:
            part.stay(cycle, How.LYING)
        if box is not None and math.isfinite(box.clears_s):
            self._clearing.append(
                (cycle + math.ceil(box.clears_s / self._cycle_time_s - 1e-9), record.number)
            )

    def _belt_below(self, part: Part) -> tuple[Landing | None, OnBelt | None]:
        """Return the belt surface below a part, and the part as an object on that belt."""
        for name, state in self.belts.items():
            there = state.surface_place(part.at_m)
            if there is not None:
                along, across = there
                angle = part.angle_rad - state.belt.direction_rad
                # negative numbers are not used by its stream
                on_belt = OnBelt(-1 - part.record.number, along, across, angle, part.type.name)
                return Landing(state.belt.origin_m[2], name), on_belt
        return None, None

    def _clear(self, cycle: int) -> None:
        """Remove the parts whose time in their box is over."""
        if self._clearing:
            for due, number in self._clearing:
                part = self._lying.pop(number, None) if due <= cycle else None
                if part is not None:
                    part.stay(cycle, How.GONE)
                    self.changed.append(part.record)
            self._clearing = [one for one in self._clearing if one[0] > cycle]

    def _update_inputs(self, cycle: int) -> None:
        for name, one in self._cell.inputs.items():
            self.inputs[name] = self._signals[name].step(self._raw(one, cycle))
        cup = self._cell.cup
        if self._switch is not None and cup is not None and cup.switch is not None:
            pressure = self.pressure_pa
            self._switch_raw = pressure >= (cup.switch.off_pa if self._switch_raw else cup.switch.on_pa)
            self.inputs[cup.switch.input] = self._switch.step(self._switch_raw)
        if self._cell.faults:
            for name in self.inputs:
                stuck = self._active('input_stuck', cycle, name)
                if stuck is not None:
                    self.inputs[name] = bool(stuck.value)
        self.inputs.update(self.forced)

    def _raw(self, one: Input, cycle: int) -> bool:
        """Return the value of an input without its delays."""
        if one.follows:
            return self._followed[one.follows].value
        if one.sensor is not None:
            x, y, _ = one.sensor.at_m
            seen = [*self._lying.values(), *self._in_hand()]
            return any(math.hypot(part.at_m[0] - x, part.at_m[1] - y) <= one.sensor.radius_m for part in seen)
        value = False
        for change in one.changes:
            if self._cycle_of(change.after_s) > cycle:
                break
            value = change.value
        return value

    def _in_hand(self) -> list[Part]:
        return [] if self._gripper is None or self._gripper.part is None else [self._gripper.part]

    @property
    def pressure_pa(self) -> float:
        """Vacuum in the cup relative to ambient pressure [Pa]."""
        return 0.0 if self._gripper is None else self._gripper.vacuum.pressure_pa

    def signals(self) -> dict[str, list[float]]:
        """Return the trace signals ``cell_...`` (``recording/signals.py``) of this bus cycle."""
        gripper = self._gripper
        inputs = [float(value) for value in self.inputs.values()]
        ways = [belt.way_m for belt in self.belts.values()]
        forces = (0.0, 0.0) if gripper is None else (gripper.holding_force_n, gripper.needed_force_n)
        return {
            'cell_inputs': [*inputs, *[0.0] * (CELL_INPUTS - len(inputs))],
            'cell_vacuum': [self.pressure_pa],
            'cell_payload': [self.carried_kg or 0.0],
            'cell_belts': [*ways, *[0.0] * (CELL_BELTS - len(ways))],
            'cell_force': list(forces),
        }

    @property
    def misses(self) -> list[Miss]:
        """Valve openings without a part, since ``clear_history``."""
        return [] if self._gripper is None else self._gripper.misses

    def report(self) -> dict[str, Any]:
        """Return the report on all parts."""
        return report_of(
            self.about(),
            [one.to_document() for one in self.records],
            [one.to_document() for one in self.misses],
        )

    def about(self) -> dict[str, Any]:
        """Return the names of the cell, its inputs and its belts."""
        return {'cell': self._cell.name, 'inputs': list(self.inputs), 'belts': list(self.belts)}
