"""The robot as a script calls it: moves, outputs, waits and decisions, the same in a simulation and on a robot."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from delta3_pacdrive.cell.link import HeldError, Link, Seen
from delta3_pacdrive.cell.moves import (
    Batch,
    Moves,
    Start,
    Written,
    alone,
    is_move,
    unnumbered,
    without_wait,
)
from delta3_pacdrive.cell.place import NOWHERE, ScriptPlace, of_caller
from delta3_pacdrive.cell.state import State
from delta3_pacdrive.cell.statement_maker import StatementMaker, checked_frame, checked_tool
from delta3_pacdrive.cell.values import number
from delta3_pacdrive.configuration.checked import nearest_of
from delta3_pacdrive.controller.motion_state import MotionState
from delta3_pacdrive.controller.wait_condition import WaitCondition
from delta3_pacdrive.errors import (
    Code,
    Delta3Error,
    FaultCode,
    ProgramError,
    Reason,
    RefusedError,
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
from delta3_pacdrive.motion.resume import resume
from delta3_pacdrive.sercos.words import PAYLOAD_MAX_KG, payload_on_grid

BATCH_MAX = 100  # statements that are planned together
AHEAD_S = 1.0  # of motion may be left when a full batch is ordered behind it
CALLS_MAX = 10_000  # that take no bus time, one after the other
TIMEOUT_S = 10.0  # of a wait for an input
TIME_MAX_S = 3600.0  # of a wait
TRIES_MAX = 5  # of an order that comes too late on a bus with a clock


class Robot:
    """A robot of a script.

    Calls that move are noted, and return at once. What is noted is planned as a whole and ordered when the script asks
    for something that takes bus time. An order is decided on the answers of one bus cycle, and takes effect a fixed
    number of cycles later (``decision_cycles`` of the parameters). All calls raise ``ScriptError``.

    Parameters
    ----------
    link
        To the robot.
    name
        Of the script.

    Attributes
    ----------
    notices
        Sentences of the planner about what was slowed down or not rounded.
    late, late_cycles
        Decisions that have taken effect later than they should, as a bus with a clock waits for nobody; and by how many
        bus cycles at most.
    held_at
        Bus cycle from which on the robot stands on its path, where a script was given up; -1: it was not.

    """

    def __init__(self, link: Link, name: str) -> None:
        self._link, self.parameters = link, link.parameters
        self._moves = Moves(name, link.parameters)
        self._maker = StatementMaker(link.parameters.motion, link.outputs)
        self._batch: list[Written] = []
        self._begin = link.look().cycle  # times count from here
        self._effect = self._begin  # of the newest order
        self._looked, self._calls = self._begin, 0
        self._over = False
        self._ask: Callable[[ScriptPlace, str], None] | None = None
        self.late, self.late_cycles = 0, 0
        self.held_at = -1

    def on_planned(self, told: Callable[[Batch], None]) -> None:
        """Let somebody know each batch of statements that is planned."""
        self._moves.on_planned = told

    def step_by_step(self, ask: Callable[[ScriptPlace, str], None]) -> None:
        """Let somebody be asked before each move, which is then driven alone, to rest; corners are not rounded."""
        self._ask = ask

    @property
    def notices(self) -> tuple[str, ...]:
        """Sentences of the planner about what was slowed down or not rounded."""
        return tuple(self._moves.notices)

    # calls that move --------------------------------------------------------------------------------------------------

    def move_l(self, **keys: Any) -> None:
        """Move along a straight line to ``to_m`` or ``to_mm``; limits, ``blend_m``, ... are those of programs."""
        self._write('move_l', keys)

    def move_c(self, **keys: Any) -> None:
        """Move along a circle through ``via_m`` to ``to_m``."""
        self._write('move_c', keys)

    def move_sb(self, **keys: Any) -> None:
        """Move along a spline through the points ``through_m``."""
        self._write('move_sb', keys)

    def arch(self, **keys: Any) -> None:
        """Move over an arch to ``to_m``, straight up by ``up_m`` first and straight down by ``down_m`` in the end."""
        self._write('arch', keys)

    def turn(self, **keys: Any) -> None:
        """Turn the tool to ``to_deg`` or ``to_rad`` while the robot stands; a move does so on its way: ``turn_deg``."""
        self._write('turn', keys)

    def cubic(self, **keys: Any) -> None:
        """Move along a cubic polynomial in time to ``to_m`` within ``duration_s``, there with ``end_velocity_m_s``."""
        self._write('cubic', keys)

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

    def _write(self, kind: str, keys: dict[str, Any]) -> None:
        place = of_caller()
        with self._told(place):
            self._count()
            statement, waits = without_wait(self._read(kind, keys))
            if self._ask is not None and is_move(statement) and not self._together:
                statement, waits = alone(statement)
                self._ask(place, kind)
            self._batch.append((statement, place))
            if waits:
                self._order()
                self._wait_for(WaitCondition(self._effect, *self._to_the_end(), left_cycles=0))
            elif len(self._batch) >= BATCH_MAX:
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
                self._come_to_the_end()
                carried = self._moves.payload_kg + mass_kg - self._maker.tool_kg
                self._moves.payload_kg = payload_on_grid(
                    number('payload with this tool', carried, 0.0, PAYLOAD_MAX_KG, ' kg')
                )
            self._maker.frame, self._maker.tool = frame, tool

    # waits ------------------------------------------------------------------------------------------------------------

    def wait(self, left_s: float = 0.0) -> None:
        """Wait until the robot stands in position behind all moves, or at most ``left_s`` [s] of them are left."""
        with self._told(of_caller()):
            left = self._cycles('left_s', left_s)
            self._order()
            timeline = self._moves.timeline
            if timeline is not None and timeline.profile is not None and timeline.profile.held:
                raise _refused(
                    Code.STATE, 'wait: the robot is held, so that its moves never end: resume it first'
                )
            self._wait_for(WaitCondition(self._effect, *self._to_the_end(), left_cycles=left))

    def wait_time(self, time_s: float) -> None:
        """Wait for a time [s]."""
        with self._told(of_caller()):
            cycles = self._cycles('time_s', time_s)
            self._order()
            self._go_to(self._link.look().cycle + cycles)

    def wait_until(self, time_s: float) -> None:
        """Wait until a bus time since the script began [s]; if that is over, do not wait."""
        with self._told(of_caller()):
            self._order()
            self._go_to(self._begin + self._cycles('time_s', time_s))

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
            if not self._wait_for(WaitCondition(0, latest, inputs_on=on, inputs_off=off)):
                wanted = 'on' if value else 'off'
                sentence = f'wait_input: {shown(name)} was not {wanted} within {timeout_s:g} s'
                raise WaitTimeoutError(Reason(Code.TIMEOUT, sentence))

    def _wait_for(self, condition: WaitCondition) -> bool:
        cycles = self.parameters.in_position_cycles
        return self._link.wait(replace(condition, in_position_cycles=cycles))

    def _go_to(self, cycle: int) -> None:
        self._link.wait(WaitCondition(cycle, cycle))

    def _to_the_end(self) -> tuple[int]:
        """Return the latest bus cycle of a wait for moves, which end by themselves or with a fault."""
        timeline = self._moves.timeline
        late_s = TIME_MAX_S if timeline is None else TIME_MAX_S + timeline.plan.duration_s / OVERRIDE_MIN
        return (self._link.look().cycle + round(late_s / self.parameters.bus.cycle_time_s),)

    def _cycles(self, name: str, time_s: float) -> int:
        time_s = number(name, time_s, 0.0, TIME_MAX_S)
        return int(np.ceil(time_s / self.parameters.bus.cycle_time_s - 1e-9))

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
            seen = self._seen()
            return State(
                seen.cycle,
                (seen.cycle - self._begin) * self.parameters.bus.cycle_time_s,
                str(seen.motion),
                seen.position_m,
                seen.command_m,
                self._moves.seconds_left(seen.cycle),
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
            seen = self._ready()
            if self._moves.timeline is None:
                raise _refused(Code.STATE, f'hold: the robot is {seen.motion}')
            if self._held:
                return
            profile = self._link.hold(seen.cycle + self.parameters.decision_cycles)
            self._moves.follow(profile)
            self._effect = profile.cycle

    def resume(self) -> None:
        """Go on along the path after ``hold``."""
        with self._told(of_caller()):
            self._order()
            if not self._held:
                raise _refused(Code.STATE, 'resume: the robot is not held')
            self._change(self._moves.override)

    def override(self, percent: float) -> None:
        """Drive at so many percent of the planned speed from now on, 1 to 150."""
        with self._told(of_caller()):
            override = number('override', percent, 100.0 * OVERRIDE_MIN, 100.0 * OVERRIDE_MAX, ' %') / 100.0
            self._moves.require_override(override)
            self._order()
            self._moves.require_override(override)
            if not self._held:
                self._change(override)
            self._moves.override = override

    def payload(self, payload_kg: float) -> None:
        """Carry a payload [kg] beside the tool from the next move on; waits until what is ordered is over."""
        with self._told(of_caller()):
            tool_kg = self._maker.tool_kg
            carried_kg = tool_kg + number('payload', payload_kg, 0.0, PAYLOAD_MAX_KG - tool_kg, ' kg')
            self._order()
            self._come_to_the_end()
            self._moves.payload_kg = payload_on_grid(carried_kg)

    @property
    def _held(self) -> bool:
        timeline = self._moves.timeline
        return timeline is not None and timeline.profile is not None and timeline.profile.held

    def _change(self, override: float) -> None:
        seen = self._ready()
        timeline = self._moves.timeline
        if timeline is None:
            return
        held = self._held
        if held:
            self._go_to(timeline.end_cycle)  # on a robot that is up, who stands can go on
            self._come_to_rest()
            seen = self._seen()
        cycle = seen.cycle + self.parameters.decision_cycles
        if held:
            cycle = max(cycle, timeline.end_cycle)
        elif cycle >= timeline.end_cycle:
            return  # for the next program
        stands = self._way_back(cycle) if held else 0

        def change(late: int) -> int:
            self._seen()
            if self._moves.timeline is None:
                return seen.cycle  # over meanwhile: for the next program
            profile = resume(timeline, self._go_back(cycle + late) if held else cycle + late, override)
            effect = self._link.change(profile)
            self._moves.follow(replace(profile, cycle=effect))
            return effect

        self._take_effect(self._in_time(change, seen.cycle), seen.cycle, stands)

    def _come_to_rest(self) -> None:
        """Let the bus go on until a robot stands whose plan was held."""

    def _way_back(self, cycle: int) -> int:
        """Return the bus cycle in which the plan can go on, if a robot that was held begins to move in a cycle."""
        return cycle

    def _go_back(self, cycle: int) -> int:
        """Let the robot begin to move in a cycle if it goes on; return in which one the plan goes on."""
        return self._way_back(cycle)

    # orders -----------------------------------------------------------------------------------------------------------

    def _order(self) -> None:
        """Plan what is noted, and order it."""
        self._count()
        if self._batch:
            self._order_batch()

    def _order_batch(self) -> None:
        batch, self._batch = self._batch, []
        seen = self._ready()
        if len(batch) >= BATCH_MAX and self._moves.seconds_left(seen.cycle) > AHEAD_S and not self._held:
            left = round(AHEAD_S / self.parameters.bus.cycle_time_s)
            self._wait_for(WaitCondition(self._effect, *self._to_the_end(), left_cycles=left))
            seen = self._seen()
        timeline = self._moves.timeline
        stands = timeline.end_cycle if timeline is not None and self._held else 0

        def order(late: int) -> int:
            here = self._seen()
            moves = self._moves.copy()
            cycle = max(seen.cycle + self.parameters.decision_cycles, stands)
            if moves.timeline is not None:  # who stands starts as soon as he can
                cycle += late
            ordered = moves.order(self._on_time(batch, cycle), cycle, here.planned_m, here.turn_rad)
            if isinstance(ordered, Start):
                effect = self._link.start(ordered.planned, ordered.cycle, ordered.override)
                if effect != cycle:
                    moves.start_later(ordered, effect)
            else:
                effect = self._link.extend(ordered)
            self._moves = moves
            return effect

        self._take_effect(self._in_time(order, seen.cycle), seen.cycle, stands)

    def _on_time(self, batch: list[Written], cycle: int) -> list[Written]:
        """Return what is ordered if it takes effect in a bus cycle."""
        return batch

    def _in_time(self, order: Callable[[int], int], decided: int) -> int:
        """Give an order that was decided on in a bus cycle; return from which one on it counts.

        On a bus with a clock it may come too late, or the program that it should follow has ended meanwhile. Then it is
        given again, for a later cycle.
        """
        late = self._link.extra_cycles
        for _ in range(TRIES_MAX - 1 if late else 0):
            try:
                return order(late)
            except RefusedError as error:
                if error.reason.code not in (Code.LATE, Code.STATE):
                    raise
            late = max(self._link.look().cycle - decided, 0) + self._link.extra_cycles
        return order(late)

    def _take_effect(self, effect: int, decided: int, stands: int = 0) -> None:
        """Note from which bus cycle on the newest order counts, and whether that is late."""
        self._effect = effect
        late = effect - max(decided + self.parameters.decision_cycles, stands)
        if late > 0:
            self.late += 1
            self.late_cycles = max(self.late_cycles, late)

    def _ready(self) -> Seen:
        """Return what is seen once the order before has taken effect."""
        self._go_to(self._effect)
        return self._seen()

    def _seen(self) -> Seen:
        seen = self._link.look()
        if seen.motion is MotionState.IDLE:
            self._moves.end()
        return seen

    def _come_to_the_end(self) -> None:
        """Let the bus go on until nothing is under way."""
        if self._held:
            raise _refused(Code.STATE, 'the robot is held, so that its moves never end: resume it first')
        self._link.wait(WaitCondition(self._effect, *self._to_the_end(), over=True))
        self._seen()

    def finish(self) -> None:
        """Order what is noted, and let the bus go on until nothing is under way."""
        with self._told(NOWHERE):
            self._order()
            self._come_to_the_end()
            self._over = True

    def give_up(self) -> int:
        """Drop what is noted, stop on the path, and let the bus go on until the robot stands.

        Returns the bus cycle from which on it stands, -1 if nothing was under way.
        """
        self._batch.clear()
        self._over = True
        seen = self._ready()
        if self._moves.timeline is None:
            return -1
        if not self._held:
            self._moves.follow(self._link.hold(seen.cycle + self.parameters.decision_cycles))
        stands = self._moves.timeline.end_cycle
        self._go_to(stands + self.parameters.in_position_cycles)
        return stands

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
                self._moves.follow(error.profile)
            reason = Reason.of(error)
            raise ScriptError(replace(reason, sentence=unnumbered(reason.sentence)), str(place)) from None


def _refused(code: Code, sentence: str) -> ScriptError:
    return ScriptError(Reason(code, sentence))
