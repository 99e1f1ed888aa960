"""Robot interface for scripts: moves, outputs, waits and state, identical in simulation and on a running robot."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import astuple, dataclass, replace
from typing import Any

import numpy as np

from delta3_pacdrive.configuration.strict_reader import nearest_of
from delta3_pacdrive.control.cycle.servo import checked_limits, default_limits
from delta3_pacdrive.control.operation.wait_condition import WaitCondition
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
from delta3_pacdrive.planning.execution import OVERRIDE_MAX, OVERRIDE_MIN
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.program.frames import Frame, Tool
from delta3_pacdrive.planning.program.model import Point, Statement
from delta3_pacdrive.planning.program.output_names import named_bits
from delta3_pacdrive.robot.sercos.words import PAYLOAD_MAX_KG, payload_on_grid
from delta3_pacdrive.scripting.arguments import (
    TIME_MAX_S,
    TIMEOUT_S,
    StatementMaker,
    checked_frame,
    checked_tool,
    number,
    script_error,
)
from delta3_pacdrive.scripting.link import HeldError, Link
from delta3_pacdrive.scripting.moves import Batch, alone, is_move, unnumbered, without_wait
from delta3_pacdrive.scripting.script_orders import BATCH_MAX, ScriptOrders
from delta3_pacdrive.scripting.source_position import NOWHERE, ScriptPlace, of_caller
from delta3_pacdrive.scripting.steering import Steering

CALLS_MAX = 10_000  # consecutive calls without bus time


@dataclass(frozen=True)
class State:
    """State of the robot in the latest evaluated bus cycle.

    Attributes
    ----------
    cycle, time_s
        Number of the bus cycle, and bus time since the start of the script [s].
    motion
        ``idle``, ``moving``, ``stopping`` or ``stopped``.
    position_m, command_m
        Actual and commanded TCP position [m].
    left_s
        Remaining time of the moves sent so far [s]; inf while the robot is held.
    outputs, inputs
        Values by name.
    payload_kg
        Payload set by the outputs [kg].
    late
        Number of decisions that took effect late; 0 if bus time waits for the script (no clock).

    """

    cycle: int
    time_s: float
    motion: str
    position_m: Point
    command_m: Point
    left_s: float
    outputs: Mapping[str, bool]
    inputs: Mapping[str, bool]
    payload_kg: float
    late: int = 0


class Robot:
    """A robot controlled by a script.

    Move calls are queued and return immediately. The queue is planned and sent as one batch when the script makes a
    call that takes bus time. All calls raise ``ScriptError``.

    Parameters
    ----------
    link
        Connection to the robot.
    name
        Name of the script.
    orders
        Order queue; default: a new ``ScriptOrders``.

    """

    def __init__(self, link: Link, name: str, orders: ScriptOrders | None = None) -> None:
        self._link, self.parameters = link, link.parameters
        self._orders = orders or ScriptOrders(link, name)
        self._maker = StatementMaker(link.parameters.motion, link.outputs)
        self._start_cycle = self._orders.effect  # script time counts from this bus cycle
        self._counted_cycle, self._calls = self._start_cycle, 0
        self._ended = False
        self._ask: Callable[[ScriptPlace, str], None] | None = None  # called before each single step
        # bus cycle from which the robot is at rest on its path, after an abort of the script; -1: no abort
        self.held_at = -1

    def on_planned(self, callback: Callable[[Batch], None]) -> None:
        """Set a callback for each planned batch of statements."""
        self._orders.moves.on_planned = callback

    def step_by_step(self, ask: Callable[[ScriptPlace, str], None]) -> None:
        """Call ``ask`` before each move, and execute moves one at a time to rest, without blending."""
        self._ask = ask

    @property
    def notices(self) -> tuple[str, ...]:
        """Notices of the planner on moves that were slowed down or not blended."""
        return tuple(self._orders.moves.notices)

    @property
    def late(self) -> int:
        """Number of decisions that took effect late; 0 without a clock, because bus time then waits for the script."""
        return self._orders.late

    @property
    def late_cycles(self) -> int:
        """Maximum delay of a late decision in bus cycles."""
        return self._orders.late_cycles

    # moves ------------------------------------------------------------------------------------------------------------

    def move_l(self, *values: Any, **keys: Any) -> None:
        """Move along a straight line to ``to_m`` or ``to_mm``; further keys as in programs: limits, ``blend_m``, ..."""
        self._append('move_l', keys, values)

    def move_c(self, *values: Any, **keys: Any) -> None:
        """Move along a circle through ``via_m`` to ``to_m``, or by ``angle_deg`` on that circle."""
        self._append('move_c', keys, values)

    def move_sb(self, *values: Any, **keys: Any) -> None:
        """Move along a spline through the points ``through_m``."""
        self._append('move_sb', keys, values)

    def arch(self, *values: Any, **keys: Any) -> None:
        """Move along an arch to ``to_m`` that starts with a vertical line ``up_m`` and ends with ``down_m``."""
        self._append('arch', keys, values)

    def turn(self, **keys: Any) -> None:
        """Rotate the tool to ``to_deg`` or ``to_rad`` at standstill; ``turn_deg`` of a move rotates it on the path."""
        self._append('turn', keys)

    def cubic(self, *values: Any, **keys: Any) -> None:
        """Move along a cubic polynomial in time to ``to_m`` within ``duration_s``, ending with ``end_velocity_m_s``."""
        self._append('cubic', keys, values)

    def joints(self, points: Any) -> None:
        """Move the arms through points, each with ``time_s`` and ``angles_rad``, ``speeds_rad_s``, ..."""
        self._append('joints', {'points': points})

    def dwell(self, time_s: float) -> None:
        """Rest for a time [s] between moves."""
        self._append('dwell', {'time_s': time_s})

    def output(self, name: str, value: bool, **keys: Any) -> None:
        """Switch an output at the end of the preceding move, or ``before_m`` earlier; ``payload_kg`` sets the payload.

        ``in_time`` advances the switching by the delay of the connected device, such as a valve of the cell.
        """
        self._append('output', {'name': name, 'value': value, **keys})

    def _append(self, kind: str, keys: dict[str, Any], values: tuple[Any, ...] = ()) -> None:
        place = of_caller()
        with self._errors_at(place):
            self._count()
            if values:
                name = 'through' if kind == 'move_sb' else 'to'
                raise ProgramError(
                    f'{kind}: {shown(values[0])} has no unit: name it, {name}_m=... in metres or {name}_mm=... in '
                    'millimetres'
                )
            statement, waits = without_wait(self._read(kind, keys))
            if self._ask is not None and is_move(statement) and not self._on_belt:
                statement, waits = alone(statement)
                self._ask(place, kind)
            self._orders.batch.append((statement, place))
            if waits:
                self._order()
                self._orders.wait_for_moves(left_cycles=0)
            elif len(self._orders.batch) >= BATCH_MAX:
                self._order()

    @property
    def _on_belt(self) -> bool:
        """Whether the moves are part of work on a belt, so that single-stepping is not possible."""
        return False

    def _read(self, kind: str, keys: dict[str, Any]) -> Statement:
        return self._maker.make(kind, keys)

    def use(self, *, frame: Frame | None = None, tool: Tool | None = None) -> None:
        """Set the default frame and tool of the following moves.

        None resets the frame to ``base`` and the tool to the plate. The tool mass is part of the payload; if it
        changes, the call waits until all moves have finished.
        """
        with self._errors_at(of_caller()):
            self._count()
            if self._on_belt:
                raise script_error(Code.STATE, 'use: moves on a belt are in the frame of their part')
            frame, tool = checked_frame(frame), checked_tool(tool)
            mass_kg = 0.0 if tool is None else tool.mass_kg
            if mass_kg != self._maker.tool_kg:
                self._order()
                self._orders.finish_motion()
                carried = self._orders.moves.payload_kg + mass_kg - self._maker.tool_kg
                self._orders.moves.payload_kg = payload_on_grid(
                    number('payload with this tool', carried, 0.0, PAYLOAD_MAX_KG, ' kg')
                )
            self._maker.frame, self._maker.tool = frame, tool

    @contextmanager
    def servo(
        self,
        speed_m_s: float | None = None,
        acceleration_m_s2: float | None = None,
        jerk_m_s3: float | None = None,
    ) -> Iterator[Steering]:
        """Steer the robot on line within the block, by set points between waits; at its end the robot stops.

        Parameters
        ----------
        speed_m_s, acceleration_m_s2, jerk_m_s3
            Limits of the TCP; default: those of a move.

        """
        given = speed_m_s, acceleration_m_s2, jerk_m_s3

        def call(act: Callable[[], None]) -> None:
            with self._errors_at(of_caller()):
                self._count()
                act()

        with self._errors_at(of_caller()):
            self._order()
            self._orders.finish_motion()
            usual = astuple(default_limits(self.parameters))
            limits = checked_limits(
                Limits(*(own if value is None else value for value, own in zip(given, usual, strict=True)))
            )
            cycle = self._orders.ready().cycle + self.parameters.decision_cycles
            self._link.steer(cycle, limits)
            self._orders.effect = cycle
        try:
            yield Steering(self._link, call, self.wait_time)
        finally:
            with self._errors_at(NOWHERE):
                self._link.cancel(max(cycle, self._link.poll().cycle + self.parameters.decision_cycles))
                self._orders.effect = self._link.poll().cycle

    # waits ------------------------------------------------------------------------------------------------------------

    def wait(self, left_s: float = 0.0) -> None:
        """Wait until all moves have finished and the robot is in position, or until at most ``left_s`` [s] remain."""
        with self._errors_at(of_caller()):
            left = self._cycles('left_s', left_s)
            self._order()
            if self._orders.held:
                raise script_error(
                    Code.STATE, 'wait: the robot is held, so its moves cannot finish: resume it first'
                )
            self._orders.wait_for_moves(left)

    def wait_time(self, time_s: float) -> None:
        """Wait for a time [s]."""
        with self._errors_at(of_caller()):
            cycles = self._cycles('time_s', time_s)
            self._order()
            self._orders.go_to(self._link.poll().cycle + cycles)

    def wait_until(self, time_s: float) -> None:
        """Wait until a bus time since the start of the script [s]; return at once if it has passed."""
        with self._errors_at(of_caller()):
            self._order()
            self._orders.go_to(self._start_cycle + self._cycles('time_s', time_s))

    def wait_input(self, name: str, value: bool = True, timeout_s: float = TIMEOUT_S) -> None:
        """Wait until an input has a value; raises ``WaitTimeoutError`` after ``timeout_s``."""
        with self._errors_at(of_caller()):
            bit = 1 << self._input_number(name)
            if not isinstance(value, bool | np.bool_):
                raise ProgramError(f'wait_input: value is {shown(value)}, but must be True or False')
            latest = self._cycles('timeout_s', timeout_s)
            self._order()
            latest += self._link.poll().cycle
            on, off = (bit, 0) if value else (0, bit)
            if not self._orders.wait_for(WaitCondition(0, latest, inputs_on=on, inputs_off=off)):
                expected = 'on' if value else 'off'
                sentence = f'wait_input: {shown(name)} was not {expected} within {timeout_s:g} s'
                raise WaitTimeoutError(Reason(Code.TIMEOUT, sentence))

    def _cycles(self, name: str, time_s: float) -> int:
        return self._orders.cycles_of(number(name, time_s, 0.0, TIME_MAX_S))

    # state ------------------------------------------------------------------------------------------------------------

    def position(self) -> Point:
        """Return the TCP position from the latest AT [m]; takes no bus time."""
        with self._errors_at(of_caller()):
            self._count()
            return self._link.poll().position_m

    def input(self, name: str) -> bool:
        """Return an input from the latest AT; takes no bus time."""
        with self._errors_at(of_caller()):
            self._count()
            return bool(self._link.poll().inputs >> self._input_number(name) & 1)

    def state(self) -> State:
        """Return the state of the robot from the latest AT; takes no bus time and sends no moves."""
        with self._errors_at(of_caller()):
            self._count()
            seen = self._orders.seen()
            return State(
                seen.cycle,
                (seen.cycle - self._start_cycle) * self.parameters.bus.cycle_time_s,
                motion=str(seen.motion),
                position_m=seen.position_m,
                command_m=seen.command_m,
                left_s=math.inf if self._orders.held else self._orders.moves.seconds_left(seen.cycle),
                outputs=named_bits(seen.outputs, self._link.outputs),
                inputs={name: bool(seen.inputs >> n & 1) for n, name in enumerate(self._link.inputs)},
                payload_kg=seen.payload_kg,
                late=self.late,
            )

    def _input_number(self, name: str) -> int:
        names = self._link.inputs
        if name not in names:
            known = ', '.join(names) or 'none'
            raise ProgramError(
                f'unknown input {shown(name)}, the inputs are: {known}{nearest_of(name, names)}'
            )
        return names.index(name)

    # execution --------------------------------------------------------------------------------------------------------

    def hold(self) -> None:
        """Stop on the path; ``resume`` continues the moves."""
        with self._errors_at(of_caller()):
            self._order()
            self._orders.hold()

    def resume(self) -> None:
        """Continue along the path after ``hold``."""
        with self._errors_at(of_caller()):
            self._order()
            if not self._orders.held:
                raise script_error(Code.STATE, 'resume: the robot is not held')
            self._orders.change(self._orders.moves.override)

    def override(self, percent: float) -> None:
        """Set the speed in percent of the planned speed, 1 to 150."""
        with self._errors_at(of_caller()):
            override = number('override', percent, 100.0 * OVERRIDE_MIN, 100.0 * OVERRIDE_MAX, ' %') / 100.0
            self._orders.require_override(override)
            self._order()
            self._orders.require_override(override)
            if not self._orders.held:
                self._orders.change(override)
            self._orders.moves.override = override

    def payload(self, payload_kg: float) -> None:
        """Set the payload without the tool [kg] for the following moves; waits until all moves have finished."""
        with self._errors_at(of_caller()):
            tool_kg = self._maker.tool_kg
            carried_kg = tool_kg + number('payload', payload_kg, 0.0, PAYLOAD_MAX_KG - tool_kg, ' kg')
            self._order()
            self._orders.finish_motion()
            self._orders.moves.payload_kg = payload_on_grid(carried_kg)

    # the end ----------------------------------------------------------------------------------------------------------

    def finish(self) -> None:
        """Send the queued moves and run the bus until all motion has finished."""
        with self._errors_at(NOWHERE):
            self._count()
            self._orders.finish()
            self._ended = True

    def abort(self) -> int:
        """Clear the queue and stop on the path; return the bus cycle from which the robot is at rest.

        Returns -1 if no motion was active.
        """
        self._ended = True
        return self._orders.abort()

    # internals --------------------------------------------------------------------------------------------------------

    def _order(self) -> None:
        """Plan and send the queued statements."""
        self._count()
        self._orders.order()

    def _count(self) -> None:
        """Count consecutive calls without bus time; raise ScriptError for an endless loop of them."""
        if self._ended:
            raise script_error(Code.STATE, 'the script has ended: no further calls are possible')
        cycle = self._link.poll().cycle
        if cycle != self._counted_cycle:
            self._counted_cycle, self._calls = cycle, 0
        self._calls += 1
        if self._calls > CALLS_MAX:
            self._calls = 0  # a script that catches the error may continue with a wait
            raise script_error(
                Code.CONTENT,
                f'{CALLS_MAX} calls took no bus time: a loop must contain a wait, for example wait_time(0.01)',
            )

    @contextmanager
    def _errors_at(self, place: ScriptPlace) -> Iterator[None]:
        """Convert errors of a call to ScriptError with file and line of the call."""
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
