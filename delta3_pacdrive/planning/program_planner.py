"""Planning of a program: its statements become moves that are timed and checked before the motion starts."""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import OVERRIDE_MAX
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.paths.move import MOVES_MAX, STANDING, Move
from delta3_pacdrive.planning.paths.rotations import JOINED_RAD
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.planning.planned_move import PlannedMove, grouped, key_of_kept_time, with_timed
from delta3_pacdrive.planning.program.model import (
    Cubic,
    JointPoint,
    Joints,
    PathMove,
    Program,
    Statement,
    point_text,
    turns_of,
)
from delta3_pacdrive.planning.program.parts import Part, parts
from delta3_pacdrive.planning.rotating_move import axis_text, require_rotary_axes, tool_text, turn_load
from delta3_pacdrive.planning.round_planner import Arches, PlanRequest, RoundPlanner
from delta3_pacdrive.planning.thermal_load import AppendedLoad, ThermalLoad
from delta3_pacdrive.planning.timing import time_parametrization
from delta3_pacdrive.planning.timing.move_grid import Stretches
from delta3_pacdrive.robot.faults.fault import require_targets

SAME_DECIMALS = 9  # of identical start positions [m]
# heat weights tried until time-optimal moves respect the rms current limit
HEAT_FIRST, HEAT_STEP, HEAT_TRIALS = 1.0, 5.0, 12
ARM_MOTORS = ('motor 1', 'motor 2', 'motor 3')
HEAT_KEPT = 0.998  # target relative to the nominal current, also its tolerance
ROUNDING_DEG = 1e-7
START_TOLERANCE_RAD = 1e-2  # of the tool angle at the start; the first turn begins at the actual angle
START_TOLERANCE_M = 1e-3  # of the robot position at the start; the first move begins at the actual position


@dataclass(frozen=True)
class Planned:
    """A planned and checked program."""

    name: str
    plan: Plan
    notices: tuple[
        str, ...
    ]  # moves that were slowed down (how much, where, by which limit), faults after the end
    rms_current_a: tuple[float, float, float]  # of each motor over the whole program
    override_max: float  # largest override within all motor limits
    repeat: int  # number of rounds in the plan
    names: tuple[str, ...]  # statements of each different move
    stretches: tuple[Stretches, ...]  # TCP limits along each different move
    rate: float  # by which all moves are slowed down to limit the rms current, 1 = none
    loads: tuple[ThermalLoad, ...]  # of each different move
    # for each statement in the last round: number of the move in the plan and distance at its end; None for an output
    ends: tuple[tuple[int, float] | None, ...]
    open_from: int | None  # first statement of the last move if it ends in a blend with a future move
    payload_kg: float  # after the last move
    first_round: int = 1  # number of moves in the first round, with one that a blend joins to the next round
    torque_rates_n_m_s: tuple[float, ...] = ()  # limits of each different move; inf: none
    # of each different move: names of blended statements with the distance at the end of their part, else empty
    parts: tuple[tuple[tuple[str, float], ...], ...] = ()


def plan(
    program: Program,
    position_m: ArrayLike,
    parameters: Parameters,
    returning: bool = False,
    open_end: bool = False,
    progress: Callable[[int, int], None] | None = None,
    before: ThermalLoad | None = None,
    arches: Arches | None = None,
    turns_rad: Sequence[float] = (),
    smoothed_from: JointPoint | None = None,
) -> Planned:
    """Plan and check every move of a program for a robot at ``position_m``.

    With ``returning`` the first move may start beyond limits if it leads back (see ``limits``). With ``open_end`` moves
    may be appended later: the last move may have a blend, and ends exactly until then. ``progress`` is called before
    each statement with the numbers of planned statements and of all. ``before`` is the load of moves that precede the
    program; it counts in the rms current. ``arches`` caches arch shapes of this robot. ``turns_rad`` are the angles of
    the rotary axes (default: those at the start of the program, or their home angles). ``smoothed_from`` is the start
    of a trajectory that the robot follows within its limits (see ``joint_trajectory.plan_joints``).

    Raises
    ------
    ProgramError
        The robot is not at the start of the program, or moves exceed limits; states which, how and where, up to ten.

    """
    require_start(program, position_m)
    require_targets(program.faults, parameters)
    turns = _start_turns(program, turns_rad, parameters)

    request = PlanRequest(
        program,
        parameters,
        returning,
        open_end=open_end,
        progress=progress,
        arches={} if arches is None else arches,
        smoothed_from=smoothed_from,
    )

    def rounds(heat: float) -> _Rounds:
        return _rounds(request, position_m, turns, heat)

    found = rounds(0.0)
    if any(isinstance(one, PathMove) and one.time_optimal for one in program.statements):
        found = _cooled(found, rounds, parameters.motor.nominal_current_a, before)
    return _whole(program, found, parameters, before)


def _start_turns(program: Program, turns_rad: Sequence[float], parameters: Parameters) -> tuple[float, ...]:
    """Return the angle of each rotary axis before a program [rad]; empty if the program does not define them."""
    given, axes = program.start_turns_rad, parameters.rotary_axes
    require_rotary_axes(len(given), len(axes), f'program "{program.name}": ')
    if not given and not any(map(turns_of, program.statements)):
        return ()
    # a robot whose angles are unknown is at the start of the program, or at home
    known = (*turns_rad, *given[len(turns_rad) :])
    actual = (*known, *(rotary.home_rad for rotary in axes[len(known) :]))
    starts = zip(given, actual, strict=False)
    checked = (_start_turn(program, *start, parameters, number) for number, start in enumerate(starts))
    return (*checked, *actual[len(given) :])


def _start_turn(program: Program, given: float, actual: float, parameters: Parameters, number: int) -> float:
    """Return the angle of rotary axis ``number`` before a program that requires an angle [rad]."""
    rotary, tool = parameters.rotary_axes[number], tool_text(parameters, number)
    low, high = rotary.angle_min_deg, rotary.angle_max_deg
    start = f'program "{program.name}" starts with {tool} at {math.degrees(given):.6g} deg'
    if not low - ROUNDING_DEG <= math.degrees(given) <= high + ROUNDING_DEG:
        raise ProgramError(f'{start}, the limits are {low:g} and {high:g} deg')
    if abs(actual - given) > START_TOLERANCE_RAD:
        raise ProgramError(f'{start}, but its angle is {math.degrees(actual):.6g} deg')
    # a start angle given in degrees may differ by rounding
    return given if abs(actual - given) <= JOINED_RAD else actual


def _rounds(request: PlanRequest, position_m: ArrayLike, turns: tuple[float, ...], heat: float) -> '_Rounds':
    """Plan all rounds of a program; ``heat`` is the weight of the motor losses in time-optimal moves."""
    program = request.program
    position = np.array(position_m, dtype=np.float64)
    payload = (
        request.parameters.dynamics.payload_mass_kg if program.payload_kg is None else program.payload_kg
    )
    planned: list[PlannedMove] = []
    order: list[int] = []
    open_notices: list[str] = []
    open_from: int | None = None
    known: dict[
        tuple[Part, tuple[float, ...], float, tuple[float, ...]],
        tuple[list[int], Floats, float, tuple[float, ...]],
    ] = {}
    pieces = parts(program)
    left = set(range(len(program.statements)))  # of the first round
    first_round: int | None = None
    ends: list[tuple[int, float] | None] = [None] * len(program.statements)
    for piece_number, part in enumerate(pieces):
        # rounds with starts that differ by rounding are identical
        angles = tuple(round(turn, SAME_DECIMALS) for turn in turns)
        key = (part, tuple(np.round(position, SAME_DECIMALS).tolist()), payload, angles)
        if key not in known:
            this_round = replace(
                request,
                returning=request.returning and not order,
                open_end=request.open_end and piece_number + 1 == len(pieces),
            )
            round_ = RoundPlanner(this_round, part, position, payload_kg=payload, turns_rad=turns, heat=heat)
            numbers = []
            for move in round_.planned():
                numbers.append(len(planned))
                planned.append(move)
            open_notices, open_from = round_.notices, round_.open_from
            known[key] = numbers, round_.position_m, round_.payload, round_.turns
        numbers, position, payload, turns = known[key]
        if piece_number + 2 >= len(pieces):  # the last round, which may start in the last piece but one
            for n, number in enumerate(numbers, start=len(order)):
                for statement, distance in planned[number].statements:
                    ends[statement] = n, distance
        order.extend(numbers)
        if len(order) > MOVES_MAX:
            raise ProgramError(f'the program has more than {MOVES_MAX} moves')
        left.difference_update(part.numbers)
        if not left and first_round is None:
            first_round = len(order)
    tail = _Tail(tuple(ends), open_from, payload)
    return _Rounds(planned, order, open_notices, tail, first_round or len(order))


def _cooled(
    hottest: '_Rounds', rounds: Callable[[float], '_Rounds'], nominal: float, before: ThermalLoad | None
) -> '_Rounds':
    """Return the fastest rounds within the rms current, or close to it: the remainder slows down all moves."""

    def excess(found: _Rounds) -> float:
        return math.log(found.load(before).rms(1.0).max() / (HEAT_KEPT * nominal))

    low, over = 0.0, excess(hottest)
    if over <= 0.0:
        return hottest
    best, high, heat = hottest, math.inf, HEAT_FIRST
    for _ in range(HEAT_TRIALS):
        found = rounds(heat)
        found_over = excess(found)
        best = found
        if abs(found_over) <= 1.0 - HEAT_KEPT:
            break
        if found_over > 0.0:
            low = heat
        else:
            high = heat
        heat = heat * HEAT_STEP if math.isinf(high) else math.sqrt(max(low, HEAT_FIRST / HEAT_STEP) * high)
    return best


@dataclass(frozen=True)
class _Tail:
    """End of a plan: its statements, and data for appending moves."""

    ends: tuple[tuple[int, float] | None, ...]
    open_from: int | None
    payload_kg: float


@dataclass(frozen=True)
class _MotorLoad:
    """Load of motors of one kind during a program, and their limit."""

    load: ThermalLoad | AppendedLoad
    nominal_a: float
    motors: tuple[str, ...]  # in messages
    alone: str  # cause of the current at rest

    def exceeds(self, rate: float, override: float = 1.0) -> bool:
        """Whether the rms current at a rate and an override exceeds the limit."""
        return bool(self.load.rms(rate, override).max() > self.nominal_a)

    def slowing(self, rate: float, new_rate: float) -> str:
        """Return the notice that all moves are slowed down to a new rate."""
        rms = self.load.rms(rate)
        axis = int(np.argmax(rms))
        return (
            f'all moves take {1.0 / new_rate:.3g} times as long: the rms current of {self.motors[axis]} over the '
            f'program would be {rms[axis]:.4g} A, the limit is {self.nominal_a:g} A'
        )


@dataclass(frozen=True)
class _Rounds:
    """Different moves of a program, their order, and notices about an open end."""

    planned: list[PlannedMove]
    order: list[int]
    open_notices: list[str]
    tail: _Tail
    first_round: int

    def load(self, before: ThermalLoad | None) -> ThermalLoad | AppendedLoad:
        """Return the load of all moves after those ``before``; raises ProgramError if there are no moves."""
        counts = np.bincount(self.order, minlength=len(self.planned))
        used = [n for n in range(len(self.planned)) if counts[n]]
        if not used:
            raise ProgramError('the program moves nothing and takes no time')
        total = self.planned[used[0]].load.times(counts[used[0]])
        for n in used[1:]:
            total = total + self.planned[n].load.times(counts[n])
        return total if before is None else AppendedLoad(total, before)


def require_start(program: Program, position_m: ArrayLike) -> None:
    """Raise ProgramError if the robot is not at the start of a program."""
    if program.start_m is None:
        return
    position = np.array(position_m, dtype=np.float64)
    distance = float(np.linalg.norm(position - program.start_m))
    if distance > START_TOLERANCE_M:
        raise ProgramError(
            f'program "{program.name}" starts at {point_text(program.start_m)} m, but the robot is at '
            f'{point_text(position)} m, {distance * 1e3:.1f} mm away'
        )


def capped(program: Program, caps: tuple[float, float, float]) -> Program:
    """Return a program with limits on speed, acceleration and jerk of all moves; 0: no limit.

    Raises
    ------
    ProgramError
        It contains cubics or joint trajectories, whose duration is fixed.

    """
    most = Limits(*(cap or math.inf for cap in caps))
    statements: list[Statement] = []
    for n, one in enumerate(program.statements):
        if isinstance(one, Cubic | Joints):
            raise ProgramError(f'{program.name_of(n)}: its duration is fixed, its speed cannot be limited')
        if isinstance(one, PathMove):
            statements.append(replace(one, limits=one.limits.lower(most)))
        else:
            statements.append(one)
    return replace(program, statements=tuple(statements))


def _whole(
    program: Program,
    found: _Rounds,
    parameters: Parameters,
    before: ThermalLoad | None,
) -> Planned:
    """Limit the rms current over the whole program and assemble the plan."""
    planned, order, tail = found.planned, found.order, found.tail
    load = found.load(before)
    notices = [notice for move in planned for notice in move.notices] + found.open_notices
    arms = _MotorLoad(load, parameters.motor.nominal_current_a, ARM_MOTORS, 'the weight alone')
    motors = [arms, *_tool_loads(found, parameters)]
    moves = [move.move for move in planned]
    rate = 1.0
    for of_motors in motors:
        if of_motors.exceeds(rate):
            before_rate, rate = rate, _rate_for_rms(of_motors, program)
            notices.append(of_motors.slowing(before_rate, rate))
            moves = [_slower(one.move, 1.0 / rate) for one in planned]
    override_max = min(load.override_max / rate, OVERRIDE_MAX)
    while override_max > 1.0 and any(one.exceeds(rate, override_max) for one in motors):
        override_max = max(1.0, override_max - 0.01)
    rms = load.rms(rate).tolist()
    moves = [with_timed(move, one.timed) for move, one in zip(moves, planned, strict=True)]
    plan_ = Plan.of(moves, order)
    notices += [
        f'{fault.text} is due {fault.after_s:g} s after the start, the program takes {plan_.duration_s:.4g} s at 100 %'
        for fault in program.faults
        if fault.after_s > plan_.duration_s
    ]
    return Planned(
        name=program.name,
        plan=plan_,
        notices=tuple(grouped(notices)),
        rms_current_a=(rms[0], rms[1], rms[2]),
        override_max=override_max,
        repeat=program.repeat,
        names=tuple(move.name for move in planned),
        stretches=tuple(move.stretches for move in planned),
        rate=rate,
        loads=tuple(move.load if rate == 1.0 else move.load.slowed(1.0 / rate) for move in planned),
        ends=tail.ends,
        open_from=tail.open_from,
        payload_kg=tail.payload_kg,
        first_round=found.first_round,
        torque_rates_n_m_s=tuple(move.torque_rate_n_m_s for move in planned),
        parts=tuple(move.parts for move in planned),
    )


def _tool_loads(found: _Rounds, parameters: Parameters) -> list[_MotorLoad]:
    """Return the loads of the motors of the rotary axes; empty if the moves do not define their angles."""
    counts = np.bincount(found.order, minlength=len(found.planned)).tolist()
    used = [(one.move, count) for one, count in zip(found.planned, counts, strict=True) if count]
    axes = [parameters.rotary_axes[number] for number in range(len(used[0][0].turns))]
    loads = []
    for number, rotary in enumerate(axes):
        parts = [turn_load(move, number, parameters).times(count) for move, count in used]
        total = functools.reduce(ThermalLoad.__add__, parts)
        motor = f'the motor of {axis_text(parameters, number)}'
        loads.append(_MotorLoad(total, rotary.nominal_current_a, (motor,), f'the friction alone of {motor}'))
    return loads


def _rate_for_rms(of_motors: _MotorLoad, program: Program) -> float:
    """Return the largest rate at which the rms current is within its limit."""
    load, nominal = of_motors.load, of_motors.nominal_a
    still, rms = load.rms(0.0).max(), load.rms(1.0)
    if still >= nominal:
        raise ProgramError(
            f'program "{program.name}": {of_motors.alone} requires an rms current of {still:.4g} A, the limit is '
            f'{nominal:g} A'
        )
    if kept := key_of_kept_time(one for one in program.statements if isinstance(one, PathMove | Joints)):
        raise ProgramError(
            f'program "{program.name}": the rms current of {of_motors.motors[int(np.argmax(rms))]} would be '
            f'{rms.max():.4g} A, the limit is {nominal:g} A ({kept})'
        )
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if load.rms(middle).max() <= nominal else (low, middle)
    return low


def _slower(move: Move, factor: float) -> Move:
    if move.kind in STANDING:
        return move
    return replace(move, master=time_parametrization.slowed(move.master, factor))
