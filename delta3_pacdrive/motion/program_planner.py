"""Planning of a program: statements become moves that are timed and checked as a whole before anything moves."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.faults.fault import require_axes
from delta3_pacdrive.motion import time_parametrization
from delta3_pacdrive.motion.execution import OVERRIDE_MAX
from delta3_pacdrive.motion.limits import Limits
from delta3_pacdrive.motion.move import MOVES_MAX, STANDING, Move
from delta3_pacdrive.motion.move_grid import Stretches
from delta3_pacdrive.motion.plan import Plan
from delta3_pacdrive.motion.planned_move import PlannedMove, grouped, key_of_kept_time, with_timed
from delta3_pacdrive.motion.program import Cubic, Joints, PathMove, Program, Statement, Turn, point_text
from delta3_pacdrive.motion.program_parts import Part, parts
from delta3_pacdrive.motion.round_planner import Arches, RoundPlanner
from delta3_pacdrive.motion.thermal_load import LoadBehind, ThermalLoad
from delta3_pacdrive.motion.turning_move import NO_AXIS, turn_load
from delta3_pacdrive.motion.turns import JOINED_RAD
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

SAME_DECIMALS = 9  # of two starts [m] that are one
# weights of the warmth of the motors that are tried until time-optimal moves keep the rms current
HEAT_FIRST, HEAT_STEP, HEAT_TRIALS = 1.0, 5.0, 12
HEAT_KEPT = 0.998  # of the nominal current, within as much
OF_TOOL = 'of the motor of the rotary axis'
ROUNDING_DEG = 1e-7
START_TOLERANCE_RAD = 1e-2  # how far its tool may; the first turn begins where it stands
START_TOLERANCE_M = (
    1e-3  # how far the robot may stand from the start of a program; the first move begins there
)


@dataclass(frozen=True)
class Planned:
    """A program that is planned and checked.

    Attributes
    ----------
    name
        Of the program.
    plan
        Moves in the order in which they are driven.
    notices
        Sentences about moves that were slowed down (by how much, where, and by which limit) and about faults that
        are due after the end.
    rms_current_a
        Of each motor over the whole program.
    override_max
        Largest override at which every motor still keeps its limits.
    repeat
        How many rounds of its statements the plan holds.
    names
        Of the statements of each different move.
    stretches
        Of each different move, where on it which limits of the TCP hold: ends [m] and limits.
    rate
        At which all moves are driven for the rms current's sake, 1 = as each was planned.
    loads
        What each different move, as it is driven, asks of the motors.
    ends
        For each statement, in the last round, the number of the move in the plan with which it ends, and where on that
        [m]; None for an output.
    open_from
        First statement of the last move, if that has a blend with a move that may follow; else None.
    payload_kg
        Payload behind the last move.
    first_round
        How many moves the first round has, the one included that a blend joins with the next round.
    torque_rates_n_m_s
        Of each different move, the limit of the change of each motor's torque; inf where it has none.
    parts
        Of each different move, the name of each statement of a blended sequence, and the distance at which its part of
        the path ends [m]: with its blend. Empty for other moves.

    """

    name: str
    plan: Plan
    notices: tuple[str, ...]
    rms_current_a: tuple[float, float, float]
    override_max: float
    repeat: int
    names: tuple[str, ...]
    stretches: tuple[Stretches, ...]
    rate: float
    loads: tuple[ThermalLoad, ...]
    ends: tuple[tuple[int, float] | None, ...]
    open_from: int | None
    payload_kg: float
    first_round: int = 1
    torque_rates_n_m_s: tuple[float, ...] = ()
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
    turn_rad: float | None = None,
) -> Planned:
    """Plan and check every move of a program for a robot that stands at ``position_m``.

    With ``returning`` the first move may begin beyond limits, if it leads back (see ``checks``). With ``open_end``
    other moves may follow later: the last one may have a blend, and ends exactly as long as none does. ``progress`` is
    called before each statement that is planned with the number of those done and of all. ``before`` is what moves ask
    of the motors behind which the program is driven; their rms current counts with its own. ``arches`` are the shapes
    that are known of this robot; new ones are added. ``turn_rad`` is where the tool stands: None, where the program
    starts, else at its home.

    Raises
    ------
    ProgramError
        The robot stands elsewhere than the program starts, or moves break limits; says which, how and where, up to ten.

    """
    require_start(program, position_m)
    require_axes(program.faults, parameters.rotary.present)
    turn = _start_turn(program, turn_rad, parameters)

    shapes: Arches = {} if arches is None else arches

    def rounds(heat: float) -> _Rounds:
        return _rounds(program, position_m, parameters, returning, open_end, progress, heat, shapes, turn)

    found = rounds(0.0)
    if any(isinstance(one, PathMove) and one.time_optimal for one in program.statements):
        found = _cooled(found, rounds, parameters.motor.nominal_current_a, before)
    return _whole(program, found, parameters, before)


def _start_turn(program: Program, turn_rad: float | None, parameters: Parameters) -> float | None:
    """Return where the tool stands before a program [rad]; None where the program says nothing of it."""
    told, rotary = program.start_turn_rad, parameters.rotary
    if not rotary.present:
        if told is not None:
            raise ProgramError(f'program "{program.name}": {NO_AXIS}')
        return None  # a statement that turns it is refused by name
    turns = told is not None or any(
        isinstance(one, Turn) or (isinstance(one, PathMove) and one.turn is not None)
        for one in program.statements
    )
    if not turns:
        return None
    low, high = rotary.angle_min_deg, rotary.angle_max_deg
    if told is not None and not low - ROUNDING_DEG <= math.degrees(told) <= high + ROUNDING_DEG:
        raise ProgramError(
            f'program "{program.name}" starts with its tool at {math.degrees(told):.6g} deg, '
            f'the limits are {low:g} and {high:g} deg'
        )
    here = turn_rad if turn_rad is not None else rotary.home_rad if told is None else told
    if told is not None and abs(here - told) > START_TOLERANCE_RAD:
        raise ProgramError(
            f'program "{program.name}" starts with its tool at {math.degrees(told):.6g} deg, but it stands at '
            f'{math.degrees(here):.6g} deg'
        )
    # a start that is told in degrees is the same angle but for rounding
    return told if told is not None and abs(here - told) <= JOINED_RAD else here


def _rounds(
    program: Program,
    position_m: ArrayLike,
    parameters: Parameters,
    returning: bool,
    open_end: bool,
    progress: Callable[[int, int], None] | None,
    heat: float,
    arches: Arches,
    turn: float | None,
) -> '_Rounds':
    """Plan every round of a program; ``heat`` is what the warmth of the motors weighs in time-optimal moves."""
    here = np.array(position_m, dtype=np.float64)
    payload = parameters.dynamics.payload_mass_kg if program.payload_kg is None else program.payload_kg
    planned: list[PlannedMove] = []
    order: list[int] = []
    open_notices: list[str] = []
    open_from: int | None = None
    known: dict[
        tuple[Part, tuple[float, ...], float, float | None], tuple[list[int], Floats, float, float | None]
    ] = {}
    pieces = parts(program)
    left = set(range(len(program.statements)))  # of the first round
    first_round: int | None = None
    ends: list[tuple[int, float] | None] = [None] * len(program.statements)
    for piece_number, part in enumerate(pieces):
        # rounds that begin a rounding error apart are the same
        angle = None if turn is None else round(turn, SAME_DECIMALS)
        key = (part, tuple(np.round(here, SAME_DECIMALS).tolist()), payload, angle)
        if key not in known:
            last = open_end and piece_number + 1 == len(pieces)
            first = returning and not order
            round_ = RoundPlanner(
                program, here, payload, parameters, first, last, progress, heat, arches, part, turn
            )
            numbers = []
            for move in round_.planned():
                numbers.append(len(planned))
                planned.append(move)
            open_notices, open_from = round_.notices, round_.open_from
            known[key] = numbers, round_.here, round_.payload, round_.turn
        numbers, here, payload, turn = known[key]
        if piece_number + 2 >= len(
            pieces
        ):  # the last round, of which a part may be driven before the last piece
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
    """Return the fastest rounds whose rms current is kept, or nearly: what is left is taken from all moves alike."""

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
    """Where the statements of a plan end, and what may follow behind the last."""

    ends: tuple[tuple[int, float] | None, ...]
    open_from: int | None
    payload_kg: float


@dataclass(frozen=True)
class _Rounds:
    """Different moves of a program, the order in which they are driven, and notices about its open end."""

    planned: list[PlannedMove]
    order: list[int]
    open_notices: list[str]
    tail: _Tail
    first_round: int

    def load(self, before: ThermalLoad | None) -> ThermalLoad | LoadBehind:
        """Return what all moves ask of the motors, behind those ``before``; raises ProgramError if there are none."""
        counts = np.bincount(self.order, minlength=len(self.planned))
        used = [n for n in range(len(self.planned)) if counts[n]]
        if not used:
            raise ProgramError('the program moves nothing and takes no time')
        total = self.planned[used[0]].load.times(counts[used[0]])
        for n in used[1:]:
            total = total + self.planned[n].load.times(counts[n])
        return total if before is None else LoadBehind(total, before)


def require_start(program: Program, position_m: ArrayLike) -> None:
    """Refuse a program that starts elsewhere than the robot stands; raises ProgramError."""
    if program.start_m is None:
        return
    here = np.array(position_m, dtype=np.float64)
    distance = float(np.linalg.norm(here - program.start_m))
    if distance > START_TOLERANCE_M:
        raise ProgramError(
            f'program "{program.name}" starts at {point_text(program.start_m)} m, but the robot stands at '
            f'{point_text(here)} m, {distance * 1e3:.1f} mm away'
        )


def capped(program: Program, caps: tuple[float, float, float]) -> Program:
    """Return a program none of whose moves exceeds a speed, an acceleration and a jerk; 0: no cap.

    Raises
    ------
    ProgramError
        A cubic and arm angles have their times, which no cap can keep.

    """
    most = Limits(*(cap or math.inf for cap in caps))
    statements: list[Statement] = []
    for n, one in enumerate(program.statements):
        if isinstance(one, Cubic | Joints):
            raise ProgramError(f'{program.name_of(n)}: its duration is fixed, it takes no cap of speed')
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
    """Check what only the whole program shows, the rms current, and put the plan together."""
    planned, order, tail = found.planned, found.order, found.tail
    load = found.load(before)
    notices = [notice for move in planned for notice in move.notices] + found.open_notices
    nominal = parameters.motor.nominal_current_a
    moves = [move.move for move in planned]
    rate = 1.0
    if load.rms(1.0).max() > nominal:
        rate = _rate_for_rms(load, nominal, program)
        moves = [_slower(move, 1.0 / rate) for move in moves]
        axis = int(np.argmax(load.rms(1.0)))
        notices.append(
            f'all moves take {1.0 / rate:.3g} times as long: the rms current of motor {axis + 1} over the program '
            f'would be {load.rms(1.0)[axis]:.4g} A, the limit is {nominal:g} A'
        )
    tool, tool_nominal = _tool_load(found, parameters), parameters.rotary.nominal_current_a
    if tool is not None and tool.rms(rate).max() > tool_nominal:
        rms_a = float(tool.rms(rate)[0])
        rate = _rate_for_rms(tool, tool_nominal, program, of_tool=True)
        moves = [_slower(one.move, 1.0 / rate) for one in planned]
        notices.append(
            f'all moves take {1.0 / rate:.3g} times as long: the rms current {OF_TOOL} over the program would be '
            f'{rms_a:.4g} A, the limit is {tool_nominal:g} A'
        )
    override_max = min(load.override_max / rate, OVERRIDE_MAX)
    while override_max > 1.0 and (
        load.rms(rate, override_max).max() > nominal
        or (tool is not None and tool.rms(rate, override_max).max() > tool_nominal)
    ):
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
        program.name,
        plan_,
        tuple(grouped(notices)),
        (rms[0], rms[1], rms[2]),
        override_max,
        program.repeat,
        tuple(move.name for move in planned),
        tuple(move.stretches for move in planned),
        rate,
        tuple(move.load if rate == 1.0 else move.load.slowed(1.0 / rate) for move in planned),
        tail.ends,
        tail.open_from,
        tail.payload_kg,
        found.first_round,
        tuple(move.torque_rate_n_m_s for move in planned),
        tuple(move.parts for move in planned),
    )


def _tool_load(found: _Rounds, parameters: Parameters) -> ThermalLoad | None:
    """Return what all moves ask of the motor of the rotary axis; None if they say nothing of it."""
    total: ThermalLoad | None = None
    counts = np.bincount(found.order, minlength=len(found.planned))
    for one, count in zip(found.planned, counts.tolist(), strict=True):
        if count and len(one.move.turns):
            load = turn_load(one.move, parameters).times(count)
            total = load if total is None else total + load
    return total


def _rate_for_rms(
    load: ThermalLoad | LoadBehind, nominal: float, program: Program, of_tool: bool = False
) -> float:
    """Return the largest rate at which the rms current is kept."""
    still, rms = load.rms(0.0).max(), load.rms(1.0).max()
    if still >= nominal:
        alone = f'the friction alone {OF_TOOL}' if of_tool else 'the weight alone'
        raise ProgramError(
            f'program "{program.name}": {alone} asks for an rms current of {still:.4g} A, the limit is {nominal:g} A'
        )
    if kept := key_of_kept_time(one for one in program.statements if isinstance(one, PathMove | Joints)):
        whose = f' {OF_TOOL}' if of_tool else ''
        raise ProgramError(
            f'program "{program.name}": the rms current{whose} would be {rms:.4g} A, the limit is {nominal:g} A '
            f'({kept})'
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
