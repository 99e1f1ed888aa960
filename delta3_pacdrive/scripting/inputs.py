"""Inputs of a simulated robot: scheduled, computed or from a cell."""

import math
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from delta3_pacdrive.cell.world import World
from delta3_pacdrive.errors import ProgramError, shown

INPUTS_MAX = 32

Change = tuple[float, bool]
Given = Mapping[str, Sequence[Change]] | Callable[[int], Mapping[str, bool]] | None


class Inputs(NamedTuple):
    """Source of the inputs in every bus cycle."""

    names: tuple[str, ...]  # in the order of the bits
    bits: Callable[[int], int]  # returns the inputs in the AT of a bus cycle


def scheduled_inputs(schedule: Mapping[str, Sequence[Change]], begin: int, cycle_time_s: float) -> Inputs:
    """Return inputs that change at known times.

    Parameters
    ----------
    schedule
        Changes of each input: time since the start of the script [s] and value; off before the first change.
    begin
        Bus cycle at time 0.
    cycle_time_s
        Bus cycle time [s].

    Raises
    ------
    ProgramError
        Times do not ascend, or a value is invalid.

    """
    names = _checked_names(schedule)
    changes: list[tuple[list[int], list[bool]]] = []  # bus cycles and values
    for name, given in schedule.items():
        times = [_time_s(name, change) for change in given]
        if times != sorted(times):
            raise ProgramError(f'input {shown(name)}: times {shown(times)} do not ascend')
        cycles = [begin + math.ceil(time / cycle_time_s - 1e-9) for time in times]
        changes.append((cycles, [_value(name, change[1]) for change in given]))

    def bits(cycle: int) -> int:
        found = 0
        for n, (cycles, values) in enumerate(changes):
            changed = bisect_right(cycles, cycle)
            found |= (changed > 0 and values[changed - 1]) << n
        return found

    return Inputs(names, bits)


def computed_inputs(function: Callable[[int], Mapping[str, bool]], begin: int) -> Inputs:
    """Return inputs computed by a function of the bus cycle, which must always return the same names."""
    names = _checked_names(function(begin))

    def bits(cycle: int) -> int:
        found = function(cycle)
        if tuple(found) != names:
            raise ProgramError(
                f'inputs of bus cycle {cycle} are {shown(list(found))}, at first they were {shown(list(names))}'
            )
        return sum(_value(name, value) << n for n, (name, value) in enumerate(found.items()))

    return Inputs(names, bits)


def cell_inputs(world: World) -> Inputs:
    """Return the inputs of a cell, which are known for the latest bus cycle only."""
    return Inputs(
        tuple(world.inputs), lambda _: sum(value << n for n, value in enumerate(world.inputs.values()))
    )


def inputs_of(given: Given, world: World | None, begin: int, cycle_time_s: float) -> Inputs:
    """Return the inputs of a schedule, a function of the bus cycle, or a cell; raises ProgramError."""
    if world is not None:
        if given is not None:
            raise ProgramError('inputs= and cell= exclude each other: a cell has its own inputs')
        return cell_inputs(world)
    if given is None or isinstance(given, Mapping):
        return scheduled_inputs(given or {}, begin, cycle_time_s)
    if callable(given):
        return computed_inputs(given, begin)
    raise ProgramError(
        f'inputs are {shown(given)}, but must be changes by name, or a function of the bus cycle'
    )


def _checked_names(names: Mapping[str, object]) -> tuple[str, ...]:
    if not isinstance(names, Mapping) or not all(isinstance(name, str) and name for name in names):
        raise ProgramError(f'inputs are {shown(names)}, but must have a name each')
    if len(names) > INPUTS_MAX:
        raise ProgramError(f'there are {len(names)} inputs, the limit is {INPUTS_MAX}')
    return tuple(names)


def _time_s(name: str, change: object) -> float:
    if not isinstance(change, Sequence) or isinstance(change, str) or len(change) != 2:
        raise ProgramError(f'input {shown(name)}: a change is a time [s] and a value, not {shown(change)}')
    time = change[0]
    if isinstance(time, bool) or not isinstance(time, (int, float)) or not 0.0 <= time < math.inf:
        raise ProgramError(
            f'input {shown(name)}: a time is {shown(time)}, but must be a number of at least 0 s'
        )
    return float(time)


def _value(name: str, value: object) -> bool:
    if value is not True and value is not False:
        raise ProgramError(f'input {shown(name)} is {shown(value)}, but must be True or False')
    return value
