"""Planning of one move: timing, limit checks, slow-down where a motor requires it, and thermal load."""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import MODES, UNSHAPED, Parameters
from delta3_pacdrive.planning.limits.energy import Energy, energy
from delta3_pacdrive.planning.limits.limits import Limits, legal_coefficients
from delta3_pacdrive.planning.limits.violations import limit_violation, require_holdable
from delta3_pacdrive.planning.paths import curves
from delta3_pacdrive.planning.paths.curves import Curve
from delta3_pacdrive.planning.paths.move import EVENT_COLUMNS, UNCHANGED, Move, MoveKind
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.paths.path_dynamics import PathDynamics, timed_dynamics
from delta3_pacdrive.planning.paths.virtual_master import (
    master_at_distances,
    plan_master,
    rest,
    sample_master,
)
from delta3_pacdrive.planning.program.model import Joints, PathMove
from delta3_pacdrive.planning.thermal_load import ThermalLoad, dwell_load, thermal_load
from delta3_pacdrive.planning.timing import constant_speed
from delta3_pacdrive.planning.timing.blending import PathSegment, name_of
from delta3_pacdrive.planning.timing.move_grid import GRID_MAX, GRID_MIN, Stretches
from delta3_pacdrive.planning.timing.move_planner import MovePlanner, require_duration
from delta3_pacdrive.planning.timing.shaping import Shaper, excited_mode, mean_modes
from delta3_pacdrive.planning.timing.time_optimal_planner import TimeOptimalPlanner
from delta3_pacdrive.planning.timing.time_parametrization import slowed

DIRECTIONS = 33  # samples of the path direction that select the vibration mode for shaping
SHAPED_ROUNDS_MAX = 20  # of slowing a shaped move down
KEPT = 1.0 + 1e-3  # a larger time stretch counts as a violated limit
SAMPLE_S = 2e-3  # sample time of the check of a cubic
NUMBER = re.compile(r'-?\d[\d.]*(e[-+]?\d+)?')
COUNTED = re.compile(r' \((\d+) times\)$')  # end of a grouped notice
ROUNDING_S = 1e-9  # tolerance for equal times


@dataclass(frozen=True)
class Event:
    """Change of an output or payload at a distance on a move."""

    distance_m: float
    output: int
    value: float
    payload_kg: float | None


@dataclass(frozen=True)
class TimedEvent:
    """Change of an output at a time relative to the passing of a position."""

    anchor_m: float  # position as distance on the move
    shift_s: float  # time after passing it at override 1; negative: before
    output: int
    value: float

    def time_s(self, move: Move) -> float:
        """Return the time from the start of the move [s]."""
        if self.anchor_m >= move.length_m:
            passed = move.duration_s
        elif self.anchor_m <= 0.0:
            passed = 0.0
        else:
            passed = float(master_at_distances([self.anchor_m], move.master)[0, 0])
        return passed + self.shift_s


@dataclass
class PlannedMove:
    """A planned move with the data that the planning of the whole program needs."""

    move: Move
    load: ThermalLoad
    name: str  # of its statements, for messages
    stretches: Stretches = ()  # TCP limits along the move; empty if the program prescribes the time
    notices: list[str] = field(default_factory=list)  # deviations from the program
    statements: tuple[
        tuple[int, float], ...
    ] = ()  # index of each statement and distance of its end on the move [m]
    energy: Energy = field(default_factory=Energy)
    timed: tuple[TimedEvent, ...] = ()  # placed on the final move by ``with_timed``
    torque_rate_n_m_s: float = math.inf  # limit for each motor
    # statements of a blended sequence with the distance at the end of their part of the path [m]
    parts: tuple[tuple[str, float], ...] = ()


def with_timed(move: Move, timed: Sequence[TimedEvent]) -> Move:
    """Return a move with timed outputs placed at the master position of their times."""
    if not timed:
        return move
    times: list[float] = []
    for event in timed:
        time_s = min(max(event.time_s(move), 0.0), move.duration_s)
        times.append(next((one for one in times if abs(one - time_s) <= ROUNDING_S), time_s))
    places = sample_master(times, move.master)[:, 0]
    rows = event_rows([Event(s, one.output, one.value, None) for s, one in zip(places, timed, strict=True)])
    events = np.vstack([move.events, rows])
    return replace(move, events=events[np.argsort(events[:, 0], kind='stable')])


def event_rows(events: Sequence[Event]) -> Floats:
    """Return events in order of distance as event rows of a move."""
    rows = [
        (e.distance_m, e.output, e.value, UNCHANGED if e.payload_kg is None else e.payload_kg) for e in events
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, EVENT_COLUMNS)


def plan_move(
    segments: list[PathSegment],
    curve: Curve,
    stretches: Stretches,
    events: list[Event],
    payload_kg: float,
    parameters: Parameters,
    returning: bool = False,
    heat: float = 0.0,
) -> PlannedMove:
    """Time and check one move; a ``returning`` one may start beyond limits.

    ``heat`` is the weight of the motor losses relative to the time in a time-optimal move.
    """
    ordered = sorted(events, key=lambda event: event.distance_m)
    changes = [(event.distance_m, event.payload_kg) for event in ordered if event.payload_kg is not None]
    payloads = [(0.0, payload_kg), *changes]
    name = name_of(segments)
    notices: list[str] = []
    optimal, even, rate = _time_optimal(segments), constant_speed.is_requested(segments), math.inf
    if optimal:
        rate = min(segment.torque_rate_n_m_s for segment in segments)
        fastest = TimeOptimalPlanner(
            curve, stretches, payloads, parameters=parameters, torque_rate_n_m_s=rate, returning=returning
        )
        planner: MovePlanner = fastest
        phases = fastest.fastest_of_third_order(heat + max(segment.heat for segment in segments))
    else:
        planner = MovePlanner(curve, stretches, payloads, parameters, returning)
        phases, notices = _as_asked(planner, segments, parameters)
        if even:
            constant_speed.require(phases, segments[0].limits.speed_m_s)
    if parameters.control.shaping != UNSHAPED:
        arriving = next((kg for at_m, kg in reversed(payloads) if at_m < curve.length_m), payload_kg)
        shaper = shaper_at_end(curve, arriving, parameters)
        phases = _shaped(planner, phases, shaper, segments)
    require_duration(float(phases[-1, 0]))
    acceleration = min(one.acceleration_m_s2 for _, one in stretches)
    jerk = min(one.jerk_m_s3 for _, one in stretches)
    if optimal:  # without other limits, a stop may be as hard as the braking of the move
        acceleration = min(acceleration, float(np.abs(phases[:, 3]).max()))
        jerk = min(jerk, float(np.abs(phases[:, 4]).max()))
    move = Move(
        segments[0].kind if len(segments) == 1 else MoveKind.BLENDED,
        master=phases,
        segments=curve.segments,
        stop_acceleration=acceleration,
        stop_jerk=jerk,
        payload_kg=payload_kg,
        events=event_rows(ordered),
    )
    return PlannedMove(
        move,
        planner.load(phases),
        name,
        stretches,
        notices,
        energy=energy(planner.dynamics(phases), parameters),
        torque_rate_n_m_s=rate,
    )


def _time_optimal(segments: Sequence[PathSegment]) -> bool:
    """Whether a move is time-optimal; raises ProgramError if only some of its segments are."""
    asked = [segment.time_optimal for segment in segments]
    if any(asked) and not all(asked):
        first = segments[asked.index(not asked[0])]
        raise ProgramError(
            f'moves that are joined by blends must be time-optimal all of them or none: {first.name} differs from '
            f'{segments[0].name}'
        )
    return asked[0]


def _as_asked(
    planner: MovePlanner, segments: Sequence[PathSegment], parameters: Parameters
) -> tuple[Floats, list[str]]:
    """Return the phases of a move within its limits, slowed down where a motor requires it, and the notices."""
    name, limits = name_of(segments), segments[0].limits
    if len(segments) == 1:
        phases = plan_master(
            planner.curve.length_m, limits.speed_m_s, limits.acceleration_m_s2, limits.jerk_m_s3
        )
    else:
        phases = planner.fastest(with_motors=False)
    asked = float(phases[-1, 0])
    notices: list[str] = []
    found = planner.limit_violation(planner.dynamics(phases))
    if found.worst > KEPT:
        if any(segment.strict for segment in segments):
            raise ProgramError(f'{found.text} (strict)')
        phases = planner.fastest(with_motors=True)
        motion = parameters.motion
        defaults = Limits(motion.speed_max_m_s, motion.acceleration_max_m_s2, motion.jerk_max_m_s3)
        # arches are shaped by the planner: with default limits the user did not request a speed
        if not all(segment.is_arch and segment.limits == defaults for segment in segments):
            notices.append(slowed_down(name, float(phases[-1, 0]), asked, found.text))
    return phases, notices


def key_of_kept_time(segments: Iterable[PathSegment | PathMove | Joints]) -> str:
    """Return the key that forbids slowing a move down; empty if it may be slowed down."""
    return next((key for one in segments for key in ('strict', 'constant_speed') if getattr(one, key)), '')


def shaper_at_end(curve: Curve, payload_kg: float, parameters: Parameters) -> Shaper:
    """Return the shaper of a move: for the configured vibration, or the modes at its end with this payload."""
    control = parameters.control
    frequency, damping = control.shaping_frequency_hz, control.shaping_damping
    if frequency == 0.0 and control.shaping == MODES:
        return Shaper.of_each(MODES, mean_modes(curve.at(curve.length_m)[0], payload_kg, parameters))
    if frequency == 0.0:
        samples = sample_path(np.linspace(0.0, curve.length_m, DIRECTIONS), curve.segments)
        frequency, damping = excited_mode(samples[-1, 0], samples[:, 1], payload_kg, parameters)
    return Shaper.of(control.shaping, frequency, damping)


def _shaped(
    planner: MovePlanner,
    phases: Floats,
    shaper: Shaper,
    segments: Sequence[PathSegment],
) -> Floats:
    """Return the phases of a shaped master within the limits.

    On a straight line shaping respects the limits of the original master. In a bend the shaped master may be faster at
    the same position; the original is then slowed down.
    """
    allowed = max(KEPT, planner.stretch(phases)[0])
    for _ in range(SHAPED_ROUNDS_MAX):
        shaped = shaper.shaped(phases)
        factor, why = planner.stretch(shaped)
        if factor <= allowed:
            return shaped
        if kept := key_of_kept_time(segments):
            raise ProgramError(f'shaped against vibration, {why} ({kept})')
        phases = slowed(phases, factor)
    raise ProgramError(f'it cannot be shaped against vibration within its limits: {why}')


def slowed_down(name: str, taken: float, asked: float, why: str) -> str:
    """Return the notice for a move that takes longer [s] than requested."""
    return f'{name} is slowed down, {taken:.4g} s instead of {asked:.4g} s: {why}'


def grouped(notices: Iterable[str]) -> list[str]:
    """Group notices that differ in numbers only, and append their count; grouped notices keep their counts."""
    counts: dict[str, int] = {}
    firsts: dict[str, str] = {}
    for notice in notices:
        text, count = notice, 1
        if (found := COUNTED.search(notice)) is not None:
            text, count = notice[: found.start()], int(found[1])
        cause = NUMBER.sub('', text)
        firsts.setdefault(cause, text)
        counts[cause] = counts.get(cause, 0) + count
    return [
        text if counts[cause] == 1 else f'{text} ({counts[cause]} times)' for cause, text in firsts.items()
    ]


def plan_cubic(
    curve: Curve, payload_kg: float, name: str, parameters: Parameters, returning: bool = False
) -> PlannedMove:
    """Check a sequence of cubics in time (chapter 5), and slow it down as a whole if a motor requires it."""
    duration = curve.length_m
    times = np.linspace(0.0, duration, min(max(GRID_MIN, int(duration / SAMPLE_S)), GRID_MAX))
    d = _even(curve, times, 1.0, payload_kg=payload_kg, parameters=parameters, returning=returning)
    found = limit_violation(d, parameters)
    require_holdable(found)
    load = thermal_load(d, np.gradient(times), duration, parameters)
    factor, notices = 1.0, []
    if found.worst > KEPT:
        factor = found.worst
        load = load.slowed(factor)
        notices.append(slowed_down(name, duration * factor, duration, found.text))
    phases = slowed(np.array([[0.0, 0.0, 1.0, 0.0, 0.0], [duration, duration, 0.0, 0.0, 0.0]]), factor)
    stop = parameters.motion.acceleration_max_m_s2 / max(float(d.tcp_speed_m_s.max()), 1e-6)
    move = Move(
        MoveKind.CUBIC,
        phases,
        curve.segments,
        stop_acceleration=stop,
        stop_jerk=math.inf,
        payload_kg=payload_kg,
    )
    return PlannedMove(move, load, name, (), notices)


def plan_dwell(
    start: Floats,
    time_s: float,
    payload_kg: float,
    name: str,
    parameters: Parameters,
    kind: MoveKind = MoveKind.DWELL,
) -> PlannedMove:
    """Plan a dwell at a point [m] for a time [s]; raises ProgramError if a motor cannot hold its arm there."""
    curve = curves.point(start)
    d = _even(curve, np.zeros(1), 0.0, payload_kg, parameters)
    require_holdable(limit_violation(d, parameters))
    move = Move(kind, rest(time_s), curve.segments, payload_kg=payload_kg)
    return PlannedMove(move, dwell_load(d, time_s), name)


def _even(
    curve: Curve,
    times: Floats,
    speed: float,
    payload_kg: float,
    parameters: Parameters,
    returning: bool = False,
) -> PathDynamics:
    """Return the demand for a master at constant speed, 0 or 1 s/s; raises ProgramError if the path is not legal."""
    samples, payload = sample_path(times, curve.segments), np.zeros(len(times), np.int64)
    coefficients = legal_coefficients(
        times, samples, payload, payloads_kg=(payload_kg,), parameters=parameters, returning=returning
    )
    master = np.zeros((len(times), 4))
    master[:, 0], master[:, 1] = times, speed
    carried = np.full(len(times), payload_kg)
    return timed_dynamics(times, master, samples, coefficients, parameters, carried)
