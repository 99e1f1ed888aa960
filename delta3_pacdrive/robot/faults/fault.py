"""Injected faults: kinds, notation and targets.

Times count from program start in a program file, and from now in a request:

faults:
- {fault: encoder_jump, axis: axis2, jump_rad: 0.05, after_s: 0.3}     # permanent
- {fault: overload, axis: axis1, torque_n_m: 6.0, after_s: 0.2, for_s: 0.5}
- {fault: drop_mdt, axis: axis3, after_s: 0.25}                        # one cycle
- {fault: drop_at, axis: axis3, cycles: 2, after_s: 0.25}
- {fault: freeze, node: plant, seconds: 0.5, after_s: 0.4}

A fault begins at a bus cycle that is fixed on acceptance. It ends at another cycle, by ``clear``, or never.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from delta3_pacdrive.configuration.fields import internal, quantity
from delta3_pacdrive.configuration.schema import RecordReader
from delta3_pacdrive.configuration.strict_reader import Errors, Section, chosen_kind, read_document
from delta3_pacdrive.configuration.value_readers import number_between, one_of
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.sercos.configuration_check import (
    ALL_DRIVES,
    DRIVES,
    PLANT,
    ROTARY_DRIVES,
    require_axis,
)

AFTER_MAX_S = 1e5
CYCLES_MAX = 1000
UNIT_ROBOT, TASK = 'unit_robot', 'transformation_task'
NODES = (UNIT_ROBOT, TASK, *DRIVES, PLANT)


class Target(StrEnum):
    """Kind of target; the value is its key."""

    AXIS = 'axis'
    NODE = 'node'
    ROBOT = ''


ITSELF, EVERYBODY = 'itself', 'everybody'


@dataclass(frozen=True)
class Kind:
    """One kind of fault."""

    target: Target
    text: str
    value: str = ''  # key of its parameter, empty without one
    low: float = 0.0  # limits of the parameter: low and high
    high: float = 0.0
    telegram: str = ''  # 'mdt' or 'at' if it affects telegrams: it lasts ``cycles`` instead of ``for_s``
    once: bool = False  # whether it is an event without an end
    injected_by: str = ITSELF  # node that executes it: a name, ``ITSELF`` for the target, or ``EVERYBODY``


_AXIS, _NODE, _ROBOT = Target.AXIS, Target.NODE, Target.ROBOT
# the receiver of a telegram injects its fault
_MDT: Any = {'telegram': 'mdt'}
_AT: Any = {'telegram': 'at', 'injected_by': TASK}
_OF_PLANT: Any = {'injected_by': PLANT}
KINDS = {
    'drop_mdt': Kind(_AXIS, 'MDT lost on the way to a drive', **_MDT),
    'delay_mdt': Kind(_AXIS, 'MDT received late by a drive', 'by_cycles', 1, 16, **_MDT),
    'duplicate_mdt': Kind(_AXIS, 'MDT received twice by a drive', **_MDT),
    'corrupt_mdt': Kind(_AXIS, 'MDT corrupted on the way to a drive', **_MDT),
    'drop_at': Kind(_AXIS, 'AT lost on the way to the master', **_AT),
    'delay_at': Kind(_AXIS, 'AT received late by the master', 'by_cycles', 1, 16, **_AT),
    'duplicate_at': Kind(_AXIS, 'AT received twice by the master', **_AT),
    'corrupt_at': Kind(_AXIS, 'AT corrupted on the way to the master', **_AT),
    'freeze': Kind(_NODE, 'process that hangs', 'seconds', 1e-3, 60.0, once=True),
    'kill': Kind(_NODE, 'process that dies', once=True),
    'encoder_failure': Kind(_AXIS, 'encoder without signals'),
    'encoder_jump': Kind(_AXIS, 'encoder reading with an offset', 'jump_rad', -100.0, 100.0),
    'encoder_drift': Kind(_AXIS, 'encoder whose mounting slips', 'drift_rad_s', -100.0, 100.0),
    'encoder_noise': Kind(_AXIS, 'encoder with noise', 'noise_rad', 0.0, 1.0),
    'winding_short': Kind(_AXIS, 'short between phases at the motor'),
    'dc_link': Kind(_AXIS, 'DC link at another voltage', 'voltage_v', 0.0, 1000.0),
    'brake_worn': Kind(
        _AXIS, 'brake that has lost a share of its torque', 'lost_share', 0.0, 1.0, **_OF_PLANT
    ),
    'brake_stuck': Kind(_AXIS, 'brake that no longer opens', **_OF_PLANT),
    'overload': Kind(_AXIS, 'load on the motor shaft', 'torque_n_m', -100.0, 100.0, **_OF_PLANT),
    'payload_lost': Kind(_ROBOT, 'payload that falls off', once=True, **_OF_PLANT),
    'emergency_stop': Kind(_ROBOT, 'emergency stop of the operator', once=True, injected_by=TASK),
    'clear': Kind(_ROBOT, 'end of all injected faults', once=True, injected_by=EVERYBODY),
    # last, so that the numbers of the others in messages do not change
    'deaf': Kind(_NODE, 'process that works, but no longer receives anything', once=True),
    'supply_dip': Kind(_ROBOT, 'mains at a share of their voltage', 'share', 0.0, 1.3, **_OF_PLANT),
    'resistor_open': Kind(_ROBOT, 'brake resistor without contact', **_OF_PLANT),
    'motor_hot': Kind(_AXIS, 'winding hotter than by its losses', 'excess_k', 0.0, 300.0, **_OF_PLANT),
    'fan_blocked': Kind(_AXIS, 'drive without the air of its fan', **_OF_PLANT),
}
NAMES = tuple(KINDS)
MDT_FAULTS = frozenset(name for name, kind in KINDS.items() if kind.telegram == 'mdt')
AT_FAULTS = frozenset(name for name, kind in KINDS.items() if kind.telegram == 'at')
DUPLICATES = frozenset({'duplicate_mdt', 'duplicate_at'})
GARBLED = frozenset({'corrupt_mdt', 'corrupt_at'})
# a telegram later than its cycle counts as lost
MDT_LOSSES, AT_LOSSES = MDT_FAULTS - DUPLICATES, AT_FAULTS - DUPLICATES
PROCESS_FAULTS = frozenset({'freeze', 'kill', 'deaf'})
SUPPLY_FAULTS = frozenset({'supply_dip', 'resistor_open'})
THERMAL_FAULTS = frozenset({'motor_hot', 'fan_blocked'})
_PLACES = ('', *NODES, *ROTARY_DRIVES)  # numbered in messages


@dataclass(frozen=True)
class Fault:
    """A fault with its time."""

    kind: str = internal()  # one of ``KINDS``
    target: str = internal(default='')  # axis or node, empty for the robot
    value: float = internal(default=0.0)  # parameter of the kind
    after_s: float = quantity(
        'bus time from program start, or from the request, to the fault', 0.0, AFTER_MAX_S, default=0.0
    )
    for_s: float = quantity(
        'duration, infinite: until cleared; for telegrams see ``cycles``', 1e-3, AFTER_MAX_S, default=math.inf
    )
    cycles: int = quantity('number of affected telegrams', 1, CYCLES_MAX, default=1)

    @property
    def text(self) -> str:
        """Description of the fault."""
        row = KINDS[self.kind]
        number = f' {row.value} {self.value:g}' if row.value else ''
        return f'{self.kind}{" " + self.target if self.target else ""}{number}'

    def to_document(self) -> dict[str, Any]:
        """Return the fault in the notation of files."""
        kind = KINDS[self.kind]
        document: dict[str, Any] = {'fault': self.kind, 'after_s': self.after_s}
        if kind.target:
            document[kind.target.value] = self.target
        if kind.value:
            document[kind.value] = self.value
        if kind.telegram:
            document['cycles'] = self.cycles
        elif math.isfinite(self.for_s):
            document['for_s'] = self.for_s
        return document

    def to_row(self) -> list[float]:
        """Return the fault as numbers for a message."""
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
        """Read the output of ``to_row``; raises ProgramError."""
        if len(row) != ROW_COLUMNS or not all(math.isfinite(value) for value in row):
            raise ProgramError(f'a fault must be a row of {ROW_COLUMNS} finite numbers')
        kind, place, value, after, for_s, cycles = row
        if kind not in range(len(NAMES)) or place not in range(len(_PLACES)) or cycles % 1.0:
            raise ProgramError(f'a fault of kind {kind:g} at place {place:g} is unknown')
        fault = Fault(
            kind=NAMES[int(kind)],
            target=_PLACES[int(place)],
            value=value,
            after_s=after,
            for_s=for_s if for_s >= 0.0 else math.inf,
            cycles=int(cycles),
        )
        return parse(fault.to_document(), 'fault')


ROW_COLUMNS = 6


def parse(value: Any, where: str, *more_keys: str) -> Fault:
    """Read one fault of a request; the caller handles ``more_keys``.

    Raises
    ------
    ProgramError
        The fault breaks rules; lists the places and the rules.

    """
    return read_document(
        value, '', ProgramError, lambda given, errors: read_fault(given, where, errors, *more_keys)
    )


def read_fault(value: Any, where: str, errors: Errors, *more_keys: str) -> Fault:
    """Read one fault; the caller handles ``more_keys``. The result is invalid if errors were recorded.

    Raises
    ------
    Refusal
        The value is not a mapping, or its kind is unknown.

    """
    name = chosen_kind(value, where, 'fault', KINDS)
    kind = KINDS[name]
    keys = {'fault', 'after_s', *more_keys}
    required = {key for key in (kind.target.value, kind.value) if key}
    if kind.telegram:
        keys.add('cycles')
    elif not kind.once:
        keys.add('for_s')
    fields = Section(value, where, errors, keys | required, sorted(required))
    known = ALL_DRIVES if kind.target == Target.AXIS else (*NODES, *ROTARY_DRIVES)
    return Fault(
        kind=name,
        target=fields.read(kind.target.value, one_of(known), '') if kind.target else '',
        value=fields.read(kind.value, number_between(kind.low, kind.high), 0.0) if kind.value else 0.0,
        **RecordReader(errors).values(Fault, fields),
    )


def require_targets(faults: Sequence[Fault], parameters: Parameters) -> None:
    """Reject faults of an axis that the robot does not have, and of a supply or temperatures without a model.

    Raises
    ------
    ProgramError
        Names the first such fault.

    """
    for fault in faults:
        require_axis(fault.target, parameters.axes, ProgramError, f'{fault.text}: ')
        if fault.kind in SUPPLY_FAULTS and not parameters.supply.enabled:
            raise ProgramError(
                f'{fault.text}: the voltage of the DC link is constant (supply.enabled is false)'
            )
        if fault.kind in THERMAL_FAULTS and not parameters.thermal.in_drives:
            raise ProgramError(f'{fault.text}: temperatures are constant (thermal.in_drives is false)')


def applies_to(fault: Fault, node: str) -> bool:
    """Whether a node must execute a fault."""
    by = KINDS[fault.kind].injected_by
    return by == EVERYBODY or node == (fault.target if by == ITSELF else by)
