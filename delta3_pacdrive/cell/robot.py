"""The robot as a script calls it: moves, outputs, waits and decisions, the same in a simulation and on a robot."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from delta3_pacdrive.cell.link import HeldError, Link
from delta3_pacdrive.cell.moves import Batch, alone, is_move, unnumbered, without_wait
from delta3_pacdrive.cell.place import NOWHERE, ScriptPlace, of_caller
from delta3_pacdrive.cell.script_orders import BATCH_MAX, ScriptOrders
from delta3_pacdrive.cell.state import State
from delta3_pacdrive.cell.statement_maker import StatementMaker, checked_frame, checked_tool
from delta3_pacdrive.cell.values import TIME_MAX_S, TIMEOUT_S, number
from delta3_pacdrive.configuration.checked import nearest_of
from delta3_pacdrive.controller.wait_condition import WaitCondition
from delta3_pacdrive.errors import (
    Code,
    Delta3Error,
    FaultCode,
    ProgramError,
    Reason,
    RobotFault,
    RunError,
    ScriptError,
    WaitTimeoutError,
    shown,
)
from delta3_pacdrive.motion.execution import OVERRIDE_MAX, OVERRIDE_MIN
from delta3_pacdrive.motion.frames import Frame, Tool
from delta3_pacdrive.motion.output_names import named_bits
from delta3_pacdrive.motion.program import Point, Statement
from delta3_pacdrive.sercos.words import PAYLOAD_MAX_KG, payload_on_grid

CALLS_MAX = 10_000  # that take no bus time, one after the other


class Robot:
    """A robot of a script.

    Calls that move are noted, and return at once. What is noted is planned as a whole and ordered when the script asks
    for something that takes bus time. All calls raise ``ScriptError``.

    Parameters
    ----------
    link
        To the robot.
    name
        Of the script.
    orders
        Of the script, if they are of another kind than ``ScriptOrders``.

    Attributes
    ----------
    held_at
        Bus cycle from which on the robot stands on its path, where a script was given up; -1: it was not.

    """

    def __init__(self, link: Link, name: str, orders: ScriptOrders | None = None) -> None:
        self._link, self.parameters = link, link.parameters
        self._orders = orders or ScriptOrders(link, name)
        self._maker = StatementMaker(link.parameters.motion, link.outputs)
        self._begin = self._orders.effect  # times count from here
        self._looked, self._calls = self._begin, 0
        self._over = False
        self._ask: Callable[[ScriptPlace, str], None] | None = None
        self.held_at = -1

    def on_planned(self, told: Callable[[Batch], None]) -> None:
        """Let somebody know each batch of statements that is planned."""
        self._orders.moves.on_planned = told

    def step_by_step(self, ask: Callable[[ScriptPlace, str], None]) -> None:
        """Let somebody be asked before each move, which is then driven alone, to rest; corners are not rounded."""
        self._ask = ask

    @property
    def notices(self) -> tuple[str, ...]:
        """Sentences of the planner about what was slowed down or not rounded."""
        return tuple(self._orders.moves.notices)

    @property
    def late(self) -> int:
        """How many decisions took effect later than they should, as a bus with a clock waits for nobody."""
        return self._orders.late

    @property
    def late_cycles(self) -> int:
        """By how many bus cycles at most a decision took effect too late."""
        return self._orders.late_cycles

    # calls that move --------------------------------------------------------------------------------------------------

    def move_l(self, *values: Any, **keys: Any) -> None:
        """Move along a straight line to ``to_m`` or ``to_mm``; limits, ``blend_m``, ... are those of programs."""
        self._write('move_l', keys, values)

    def move_c(self, *values: Any, **keys: Any) -> None:
        """Move along a circle through ``via_m`` to ``to_m``, or over ``angle_deg`` on that circle, 360 a turn."""
        self._write('move_c', keys, values)

    def move_sb(self, *values: Any, **keys: Any) -> None:
        """Move along a spline through the points ``through_m``."""
        self._write('move_sb', keys, values)

    def arch(self, *values: Any, **keys: Any) -> None:
        """Move over an arch to ``to_m``, straight up by ``up_m`` first and straight down by ``down_m`` in the end."""
        self._write('arch', keys, values)

    def turn(self, **keys: Any) -> None:
        """Turn the tool to ``to_deg`` or ``to_rad`` while the robot stands; a move does so on its way: ``turn_deg``."""
        self._write('turn', keys)

    def cubic(self, *values: Any, **keys: Any) -> None:
        """Move along a cubic polynomial in time to ``to_m`` within ``duration_s``, there with ``end_velocity_m_s``."""
        self._write('cubic', keys, values)

    def joints(self, points: Any) -> None:
        """Move the arms through points, each with ``time_s`` and ``angles_rad``, ``speeds_rad_s``, ... ."""
        self._write('joints', {'points': points})

    def dwell(self, time_s: float) -> None:
        """Rest for a time [s] between moves."""
        self._write('dwell', {'time_s': time_s})

    def output(self, name: str, value: bool, **keys: Any) -> None:
        """Switch an output at the end of the move before it, or ``before_m`` earlier; it may grip ``payload_kg``.

        ``in_time`` switches it so much earlier that what hangs there has followed: a valve of the cell.
        """
        self._write('output', {'name': name, 'value': value, **keys})

    def _write(self, kind: str, keys: dict[str, Any], values: tuple[Any, ...] = ()) -> None:
        place = of_caller()
        with self._told(place):
            self._count()
            if values:
                name = 'through' if kind == 'move_sb' else 'to'
                raise ProgramError(
                    f'{kind}: {shown(values[0])} has no unit: name it, {name}_m=... in metres or {name}_mm=... in '
                    'millimetres'
                )
            statement, waits = without_wait(self._read(kind, keys))
            if self._ask is not None and is_move(statement) and not self._together:
                statement, waits = alone(statement)
                self._ask(place, kind)
            self._orders.batch.append((statement, place))
            if waits:
                self._order()
                self._orders.wait_for_moves(left_cycles=0)
            elif len(self._orders.batch) >= BATCH_MAX:
                self._order()

    @property
    def _together(self) -> bool:
        """Whether moves belong together, so that none can be driven alone."""
        return False

    def _read(self, kind: str, keys: dict[str, Any]) -> Statement:
        return self._maker.make(kind, keys)

    def use(self, *, frame: Frame | None = None, tool: Tool | None = None) -> None:
        """Take points in a frame, for a tool, from the next move on, where a move tells no other.

        Without a frame they are in ``base`` again, without a tool those of the plate. What the tool weighs counts to
        the payload; if that changes, the call waits until what is ordered is over.
        """
        with self._told(of_caller()):
            self._count()
            if self._together:
                raise _refused(Code.STATE, 'use: moves on a belt are in the frame of their part')
            frame, tool = checked_frame(frame), checked_tool(tool)
            mass_kg = 0.0 if tool is None else tool.mass_kg
            if mass_kg != self._maker.tool_kg:
                self._order()
                self._orders.come_to_the_end()
                carried = self._orders.moves.payload_kg + mass_kg - self._maker.tool_kg
                self._orders.moves.payload_kg = payload_on_grid(
                    number('payload with this tool', carried, 0.0, PAYLOAD_MAX_KG, ' kg')
                )
            self._maker.frame, self._maker.tool = frame, tool

    # waits ------------------------------------------------------------------------------------------------------------

    def wait(self, left_s: float = 0.0) -> None:
        """Wait until the robot stands in position behind all moves, or at most ``left_s`` [s] of them are left."""
        with self._told(of_caller()):
            left = self._cycles('left_s', left_s)
            self._order()
            if self._orders.held:
                raise _refused(
                    Code.STATE, 'wait: the robot is held, so that its moves never end: resume it first'
                )
            self._orders.wait_for_moves(left)

    def wait_time(self, time_s: float) -> None:
        """Wait for a time [s]."""
        with self._told(of_caller()):
            cycles = self._cycles('time_s', time_s)
            self._order()
            self._orders.go_to(self._link.look().cycle + cycles)

    def wait_until(self, time_s: float) -> None:
        """Wait until a bus time since the script began [s]; if that is over, do not wait."""
        with self._told(of_caller()):
            self._order()
            self._orders.go_to(self._begin + self._cycles('time_s', time_s))

    def wait_input(self, name: str, value: bool = True, timeout_s: float = TIMEOUT_S) -> None:
        """Wait until an input has a value; raises ``WaitTimeoutError`` if that has not come in time."""
        with self._told(of_caller()):
            bit = 1 << self._number_of(name)
            if not isinstance(value, bool | np.bool_):
                raise ProgramError(f'wait_input: value is {shown(value)}, but must be True or False')
            latest = self._cycles('timeout_s', timeout_s)
            self._order()
            latest += self._link.look().cycle
            on, off = (bit, 0) if value else (0, bit)
            if not self._orders.wait_for(WaitCondition(0, latest, inputs_on=on, inputs_off=off)):
                wanted = 'on' if value else 'off'
                sentence = f'wait_input: {shown(name)} was not {wanted} within {timeout_s:g} s'
                raise WaitTimeoutError(Reason(Code.TIMEOUT, sentence))

    def _cycles(self, name: str, time_s: float) -> int:
        return self._orders.cycles_of(number(name, time_s, 0.0, TIME_MAX_S))

    # what is known ----------------------------------------------------------------------------------------------------

    def position(self) -> Point:
        """Return where the TCP is [m], by the newest answers; takes no bus time."""
        with self._told(of_caller()):
            self._count()
            return self._link.look().position_m

    def input(self, name: str) -> bool:
        """Return an input, by the newest answers; takes no bus time."""
        with self._told(of_caller()):
            self._count()
            return bool(self._link.look().inputs >> self._number_of(name) & 1)

    def state(self) -> State:
        """Return the robot by the newest answers; takes no bus time, and orders nothing."""
        with self._told(of_caller()):
            self._count()
            seen = self._orders.seen()
            return State(
                seen.cycle,
                (seen.cycle - self._begin) * self.parameters.bus.cycle_time_s,
                str(seen.motion),
                seen.position_m,
                seen.command_m,
                math.inf if self._orders.held else self._orders.moves.seconds_left(seen.cycle),
                named_bits(seen.outputs, self._link.outputs),
                {name: bool(seen.inputs >> n & 1) for n, name in enumerate(self._link.inputs)},
                seen.payload_kg,
                self.late,
            )

    def _number_of(self, name: str) -> int:
        names = self._link.inputs
        if name not in names:
            known = ', '.join(names) or 'none'
            raise ProgramError(
                f'unknown input {shown(name)}, the inputs are: {known}{nearest_of(name, names)}'
            )
        return names.index(name)

    # how it is driven -------------------------------------------------------------------------------------------------

    def hold(self) -> None:
        """Stop on the path; what is ordered stays, and ``resume`` goes on with it."""
        with self._told(of_caller()):
            self._order()
            self._orders.hold()

    def resume(self) -> None:
        """Go on along the path after ``hold``."""
        with self._told(of_caller()):
            self._order()
            if not self._orders.held:
                raise _refused(Code.STATE, 'resume: the robot is not held')
            self._orders.change(self._orders.moves.override)

    def override(self, percent: float) -> None:
        """Drive at so many percent of the planned speed from now on, 1 to 150."""
        with self._told(of_caller()):
            override = number('override', percent, 100.0 * OVERRIDE_MIN, 100.0 * OVERRIDE_MAX, ' %') / 100.0
            self._orders.require_override(override)
            self._order()
            self._orders.require_override(override)
            if not self._orders.held:
                self._orders.change(override)
            self._orders.moves.override = override

    def payload(self, payload_kg: float) -> None:
        """Carry a payload [kg] beside the tool from the next move on; waits until what is ordered is over."""
        with self._told(of_caller()):
            tool_kg = self._maker.tool_kg
            carried_kg = tool_kg + number('payload', payload_kg, 0.0, PAYLOAD_MAX_KG - tool_kg, ' kg')
            self._order()
            self._orders.come_to_the_end()
            self._orders.moves.payload_kg = payload_on_grid(carried_kg)

    # the end ----------------------------------------------------------------------------------------------------------

    def finish(self) -> None:
        """Order what is noted, and let the bus go on until nothing is under way."""
        with self._told(NOWHERE):
            self._count()
            self._orders.finish()
            self._over = True

    def give_up(self) -> int:
        """Drop what is noted, stop on the path, and let the bus go on until the robot stands.

        Returns the bus cycle from which on it stands, -1 if nothing was under way.
        """
        self._over = True
        return self._orders.give_up()

    # how calls are made -----------------------------------------------------------------------------------------------

    def _order(self) -> None:
        """Plan what is noted, and order it."""
        self._count()
        self._orders.order()

    def _count(self) -> None:
        """Count calls that take no bus time: a loop of them alone never ends."""
        if self._over:
            raise _refused(Code.STATE, 'the script has ended: its robot takes no more calls')
        cycle = self._link.look().cycle
        if cycle != self._looked:
            self._looked, self._calls = cycle, 0
        self._calls += 1
        if self._calls > CALLS_MAX:
            self._calls = 0  # who catches the refusal may wait for something now
            raise _refused(
                Code.CONTENT,
                f'{CALLS_MAX} calls took no bus time: a loop has to wait for something, for example wait_time(0.01)',
            )

    @contextmanager
    def _told(self, place: ScriptPlace) -> Iterator[None]:
        """Say where in the script a call stands that is refused."""
        try:
            yield
        except WaitTimeoutError as error:
            raise WaitTimeoutError(error.reason, str(place)) from None
        except RunError as error:
            fault = RobotFault(FaultCode.DRIVE, str(error))
            raise ScriptError(Reason(Code.FAULT, str(error), fault), str(place)) from error
        except Delta3Error as error:
            if isinstance(error, HeldError):
                self._orders.moves.follow(error.profile)
            reason = Reason.of(error)
            raise ScriptError(replace(reason, sentence=unnumbered(reason.sentence)), str(place)) from None


def _refused(code: Code, sentence: str) -> ScriptError:
    return ScriptError(Reason(code, sentence))
