"""Faults that are injected into the machine on purpose: what there is, how it is written down, and what it does.

In a program file the time counts from the start of the program, in a request from now on:

faults:
- {fault: encoder_jump, axis: axis2, jump_rad: 0.05, after_s: 0.3}     # for good
- {fault: overload, axis: axis1, torque_n_m: 6.0, after_s: 0.2, for_s: 0.5}
- {fault: drop_mdt, axis: axis3, after_s: 0.25}                        # one cycle
- {fault: drop_at, axis: axis3, cycles: 2, after_s: 0.25}
- {fault: freeze, node: plant, seconds: 0.5, after_s: 0.4}

A fault takes effect at a bus cycle that is fixed when it is accepted, and ends at another one, by ``clear``, or never.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from delta3_pacdrive.configuration.checked import Errors, Section, nearest_of, refuse
from delta3_pacdrive.configuration.located import place_in, place_of
from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.sercos.bus_time import NEVER
from delta3_pacdrive.sercos.configuration_check import DRIVES, PLANT

AFTER_MAX_S = 1e5
CYCLES_MAX = 1000
UNIT_ROBOT, TASK = 'unit_robot', 'transformation_task'
NODES = (UNIT_ROBOT, TASK, *DRIVES, PLANT)


class Place(StrEnum):
    """What a fault befalls; the key that names it."""

    AXIS = 'axis'
    NODE = 'node'
    ROBOT = ''


@dataclass(frozen=True)
class Kind:
    """One kind of fault.

    Attributes
    ----------
    value
        Key of its number, empty if it has none.
    low, high
        Limits of the number.
    telegram
        Whether it befalls single telegrams: it lasts ``cycles`` instead of ``for_s``.
    at_once
        Whether it happens once, and cannot end.

    """

    place: Place
    text: str
    value: str = ''
    low: float = 0.0
    high: float = 0.0
    telegram: bool = False
    at_once: bool = False


KINDS = {
    'drop_mdt': Kind(Place.AXIS, 'MDT that a drive does not get', telegram=True),
    'delay_mdt': Kind(Place.AXIS, 'MDT that a drive gets cycles late', 'by_cycles', 1, 16, telegram=True),
    'duplicate_mdt': Kind(Place.AXIS, 'MDT that a drive gets twice', telegram=True),
    'corrupt_mdt': Kind(Place.AXIS, 'MDT that reaches a drive garbled', telegram=True),
    'drop_at': Kind(Place.AXIS, 'AT that the master does not get', telegram=True),
    'delay_at': Kind(Place.AXIS, 'AT that the master gets cycles late', 'by_cycles', 1, 16, telegram=True),
    'duplicate_at': Kind(Place.AXIS, 'AT that the master gets twice', telegram=True),
    'corrupt_at': Kind(Place.AXIS, 'AT that reaches the master garbled', telegram=True),
    'freeze': Kind(Place.NODE, 'process that hangs', 'seconds', 1e-3, 60.0, at_once=True),
    'kill': Kind(Place.NODE, 'process that dies', at_once=True),
    'encoder_failure': Kind(Place.AXIS, 'encoder without signals'),
    'encoder_jump': Kind(Place.AXIS, 'encoder that reads an angle too much', 'jump_rad', -100.0, 100.0),
    'encoder_drift': Kind(Place.AXIS, 'encoder whose mounting slips', 'drift_rad_s', -100.0, 100.0),
    'encoder_noise': Kind(Place.AXIS, 'encoder with noise of an amplitude', 'noise_rad', 0.0, 1.0),
    'winding_short': Kind(Place.AXIS, 'short between phases at the motor'),
    'dc_link': Kind(Place.AXIS, 'DC link at another voltage', 'voltage_v', 0.0, 1000.0),
    'brake_worn': Kind(Place.AXIS, 'brake that has lost a share of its torque', 'lost_share', 0.0, 1.0),
    'brake_stuck': Kind(Place.AXIS, 'brake that does not open any more'),
    'overload': Kind(Place.AXIS, 'load on the motor shaft', 'torque_n_m', -100.0, 100.0),
    'payload_lost': Kind(Place.ROBOT, 'payload that falls off', at_once=True),
    'emergency_stop': Kind(Place.ROBOT, 'emergency stop of the operator', at_once=True),
    'clear': Kind(Place.ROBOT, 'end of all injected faults', at_once=True),
}
NAMES = tuple(KINDS)
# whoever receives a telegram injects what befalls it; one that comes later than its cycle is as good as lost
LOSES_MDT = frozenset({'drop_mdt', 'delay_mdt', 'corrupt_mdt'})
LOSES_AT = frozenset({'drop_at', 'delay_at', 'corrupt_at'})
DUPLICATES = frozenset({'duplicate_mdt', 'duplicate_at'})
MDT_FAULTS, AT_FAULTS = LOSES_MDT | {'duplicate_mdt'}, LOSES_AT | {'duplicate_at'}
OF_PROCESSES = frozenset({'freeze', 'kill'})
_PLACES = ('', *NODES)  # by number, in messages


@dataclass(frozen=True)
class Fault:
    """A fault, and when it happens.

    Attributes
    ----------
    kind
        One of ``KINDS``.
    target
        Axis or node, empty for the robot.
    value
        The number that belongs to the kind.
    after_s
        Bus time from the start of the program, or from the request, to the fault [s].
    for_s
        How long it lasts [s], infinite: until it is cleared; for telegrams see ``cycles``.
    cycles
        How many telegrams it befalls.

    """

    kind: str
    target: str = ''
    value: float = 0.0
    after_s: float = 0.0
    for_s: float = math.inf
    cycles: int = 1

    @property
    def text(self) -> str:
        """What happens, in words."""
        row = KINDS[self.kind]
        number = f' {row.value} {self.value:g}' if row.value else ''
        return f'{self.kind}{" " + self.target if self.target else ""}{number}'

    def to_document(self) -> dict[str, Any]:
        """Return the fault as files write it."""
        kind = KINDS[self.kind]
        document: dict[str, Any] = {'fault': self.kind, 'after_s': self.after_s}
        if kind.place:
            document[kind.place.value] = self.target
        if kind.value:
            document[kind.value] = self.value
        if kind.telegram:
            document['cycles'] = self.cycles
        elif math.isfinite(self.for_s):
            document['for_s'] = self.for_s
        return document

    def to_row(self) -> list[float]:
        """Return the fault as numbers (for a message)."""
        place = _PLACES.index(self.target)
        for_s = -1.0 if math.isinf(self.for_s) else self.for_s
        return [
            float(NAMES.index(self.kind)),
            float(place),
            self.value,
            self.after_s,
            for_s,
            float(self.cycles),
        ]

    @staticmethod
    def from_row(row: Sequence[float]) -> 'Fault':
        """Read back what ``to_row`` wrote; raises ProgramError."""
        if len(row) != ROW_COLUMNS or not all(math.isfinite(value) for value in row):
            raise ProgramError(f'a fault must be a row of {ROW_COLUMNS} finite numbers')
        kind, place, value, after, for_s, cycles = row
        if kind not in range(len(NAMES)) or place not in range(len(_PLACES)) or cycles % 1.0:
            raise ProgramError(f'a fault of kind {kind:g} at place {place:g} is unknown')
        fault = Fault(
            NAMES[int(kind)],
            _PLACES[int(place)],
            value,
            after,
            for_s if for_s >= 0.0 else math.inf,
            int(cycles),
        )
        return parse(fault.to_document(), 'fault')


ROW_COLUMNS = 6


def parse(value: Any, where: str, *more_keys: str) -> Fault:
    """Read one fault of a request, of which ``more_keys`` belong to others.

    Raises
    ------
    ProgramError
        It breaks rules; names the places and the rules.

    """
    errors = Errors(getattr(value, 'source', ''))
    faults: list[Fault] = []
    with errors.raised_as(ProgramError), errors.noted(place_of(value)):
        faults.append(read_fault(value, where, errors, *more_keys))
    return faults[0]


def read_fault(value: Any, where: str, errors: Errors, *more_keys: str) -> Fault:
    """Read one fault, of which ``more_keys`` belong to others; it is good for nothing if there are errors.

    Raises
    ------
    Refusal
        It is no mapping, or of no known kind.

    """
    if not isinstance(value, dict):
        refuse(f'{where} must be a mapping, not {shown(value)}')
    name = value.get('fault')
    if not isinstance(name, str) or name not in KINDS:
        names = f'{", ".join(NAMES)}{nearest_of(name, NAMES)}'
        refuse(f'{where}.fault is {shown(name)}, but must be one of {names}', place_in(value, 'fault'))
    kind = KINDS[name]
    keys = {'fault', 'after_s', *more_keys}
    required = {key for key in (kind.place.value, kind.value) if key}
    if kind.telegram:
        keys.add('cycles')
    elif not kind.at_once:
        keys.add('for_s')
    fields = Section(value, where, errors, keys | required, sorted(required))
    known = DRIVES if kind.place == Place.AXIS else NODES
    return Fault(
        name,
        fields.read(kind.place.value, _one_of(known), '') if kind.place else '',
        fields.read(kind.value, _number(kind.low, kind.high), 0.0) if kind.value else 0.0,
        fields.read('after_s', _number(0.0, AFTER_MAX_S), 0.0),
        fields.read('for_s', _number(1e-3, AFTER_MAX_S), math.inf),
        fields.read('cycles', _cycles, 1),
    )


def _one_of(names: Sequence[str]) -> Callable[[Any, str], str]:
    def read(value: Any, where: str) -> str:
        if value not in names:
            nearest = nearest_of(value, names)
            refuse(f'{where} is {shown(value)}, but must be one of {", ".join(names)}{nearest}')
        return str(value)

    return read


def _number(low: float, high: float) -> Callable[[Any, str], float]:
    def read(value: Any, where: str) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
            refuse(f'{where} is {shown(value)}, but must be a number from {low:g} to {high:g}')
        return float(value)

    return read


def _cycles(value: Any, where: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= CYCLES_MAX:
        refuse(f'{where} is {shown(value)}, but must be between 1 and {CYCLES_MAX}')
    return value


@dataclass(frozen=True)
class Scheduled:
    """A fault with the bus cycles that it begins and ends with.

    Attributes
    ----------
    first
        First cycle that it befalls.
    end
        First cycle that it does not befall any more.

    """

    fault: Fault
    first: int
    end: int

    @staticmethod
    def of(fault: Fault, cycle: int, cycle_time_s: float) -> 'Scheduled':
        """Place a fault on the bus cycles from a cycle on that its time counts from."""
        first = cycle + round(fault.after_s / cycle_time_s)
        if KINDS[fault.kind].telegram:
            return Scheduled(fault, first, first + fault.cycles)
        return Scheduled(
            fault, first, NEVER if math.isinf(fault.for_s) else first + math.ceil(fault.for_s / cycle_time_s)
        )

    def to_document(self) -> dict[str, Any]:
        """Return it for a message."""
        return self.fault.to_document() | {'first': self.first, 'end': self.end}

    @staticmethod
    def from_document(value: Any) -> 'Scheduled':
        """Read back what ``to_document`` wrote; raises ProgramError."""
        fault = parse(value, 'fault', 'first', 'end')
        first, end = value.get('first'), value.get('end')
        if not isinstance(first, int) or not isinstance(end, int) or not 0 <= first < end:
            raise ProgramError(f'a fault from bus cycle {shown(first)} to {shown(end)} is none')
        return Scheduled(fault, first, end)


class Schedule:
    """Faults of one participant, in the order of bus time.

    Attributes
    ----------
    next_cycle
        Cycle of the next change, ``NEVER`` if none is due.
    active
        Faults that have begun and not ended, in the order in which they began.

    """

    def __init__(self) -> None:
        self.next_cycle = NEVER
        self.active: list[Fault] = []
        self._changes: list[tuple[int, bool, Scheduled]] = []  # cycle, whether it begins then
        self._telegrams: list[Scheduled] = []

    def add(self, scheduled: Scheduled) -> None:
        """Take a fault in."""
        if KINDS[scheduled.fault.kind].telegram:
            self._telegrams.append(scheduled)
            # what is lost cannot come twice
            self._telegrams.sort(key=lambda one: one.fault.kind in DUPLICATES)
            return
        self._changes.append((scheduled.first, True, scheduled))
        if scheduled.end < NEVER:
            self._changes.append((scheduled.end, False, scheduled))
        self._sort()

    def _sort(self) -> None:
        self._changes.sort(key=lambda change: change[:2])
        self.next_cycle = self._changes[0][0] if self._changes else NEVER

    def due(self, cycle: int) -> list[tuple[Fault, bool]]:
        """Return faults that begin (True) or end (False) up to a cycle, in their order, once."""
        due = [change for change in self._changes if change[0] <= cycle]
        self._changes = [change for change in self._changes if change[0] > cycle]
        self._sort()
        for _, begins, scheduled in due:
            if begins and not KINDS[scheduled.fault.kind].at_once:
                self.active.append(scheduled.fault)
            elif not begins:
                self.active.remove(scheduled.fault)
        if any(scheduled.fault.kind == 'clear' for _, _, scheduled in due):
            self._telegrams.clear()
            self._changes.clear()
            self.active.clear()
            self.next_cycle = NEVER
        return [(scheduled.fault, begins) for _, begins, scheduled in due]

    def telegram(self, kinds: frozenset[str], axis: str, cycle: int) -> Fault | None:
        """Return the fault of some kinds that befalls the telegram of an axis in a cycle."""
        for scheduled in self._telegrams:
            fault = scheduled.fault
            if scheduled.first <= cycle < scheduled.end and fault.kind in kinds and fault.target == axis:
                return fault
        return None

    def forget_telegrams_before(self, cycle: int) -> None:
        """Forget faults of telegrams that are over."""
        self._telegrams = [scheduled for scheduled in self._telegrams if scheduled.end > cycle]

    @property
    def disturbs_telegrams(self) -> bool:
        """Whether any fault of telegrams is to come, or not forgotten yet."""
        return bool(self._telegrams)


# what each fault does -------------------------------------------------------------------------------------------------


def change_drive(
    state: Any, axis: str, changes: Sequence[tuple[Fault, bool]], active: Sequence[Fault], dc_link_v: float
) -> None:
    """Bring the record of a drive up to date after faults have begun (True) or ended (False).

    ``active`` are the faults that last, ``dc_link_v`` is the nominal voltage of the DC link [V]. Where several of one
    kind last, jumps, drifts and noises add up, and the last voltage holds.
    """
    for fault, begins in changes:
        if fault.kind == 'clear':
            state['encoder_offset'] = 0.0
        elif fault.kind == 'encoder_jump' and fault.target == axis:
            state['encoder_offset'] += fault.value if begins else -fault.value
    values = _values(axis, active)
    state['encoder_broken'] = len(values('encoder_failure')) > 0
    state['encoder_drift'] = sum(values('encoder_drift'))
    state['encoder_noise'] = sum(values('encoder_noise'))
    state['winding_short'] = len(values('winding_short')) > 0
    state['dc_link'] = [dc_link_v, *values('dc_link')][-1]


def change_plant(state: Any, changes: Sequence[tuple[Fault, bool]], active: Sequence[Fault]) -> None:
    """Bring the record of the plant up to date, as ``change_drive`` does; torques add up, so do losses of a brake."""
    if any(fault.kind == 'payload_lost' for fault, _ in changes):
        state['payload_lost'] = 1
    for index, axis in enumerate(DRIVES):
        values = _values(axis, active)
        state['brake_share'][..., index] = math.prod(1.0 - lost for lost in values('brake_worn'))
        state['brake_stuck'][..., index] = len(values('brake_stuck')) > 0
        state['load_torque'][..., index] = sum(values('overload'))


def _values(axis: str, active: Sequence[Fault]) -> Callable[[str], list[float]]:
    """Return the function that gives the numbers of all active faults of a kind at an axis."""
    return lambda kind: [fault.value for fault in active if fault.kind == kind and fault.target == axis]


_OF_THE_PLANT = frozenset({'brake_worn', 'brake_stuck', 'overload'})


def befalls(fault: Fault, node: str) -> bool:
    """Whether a node has to do something about a fault."""
    if fault.kind in AT_FAULTS:
        return node == TASK
    if fault.kind in _OF_THE_PLANT:
        return node == PLANT
    if fault.target:
        return fault.target == node
    if fault.kind == 'payload_lost':
        return node == PLANT
    return fault.kind == 'clear' or node == TASK
