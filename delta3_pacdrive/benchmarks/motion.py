"""``delta3 bench motion``: planning time, accuracy of paths and speeds, and distance from the time optimum."""

import math
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive import simulation
from delta3_pacdrive.benchmarks.case import in_child, times_text
from delta3_pacdrive.benchmarks.planning_load import LIMITS, random_pick
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.paths.curves import Curve
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.plan import sample_plan
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.timing.move_planner import MovePlanner

ROUNDS = 40
PICKS, PICK_ROUNDS = 100, 3  # random picks, and repetitions of each planning
PICKS_BY = ('jerk of the TCP limited', 'torque rate limited')
PACKAGING = ('packaging', 'packaging_stops', 'packaging_fast')
PLANS_PER_S = 20.0


def measure(seconds: float | None) -> dict[str, Any]:
    """Measure planning, cost per cycle, errors and cycle times, and a robot for some seconds unless None."""
    robot = core.load()
    simulation.precompile(robot)
    result: dict[str, Any] = {
        'planning_ms': _planning_times(robot),
        'picks_ms': _pick_times(robot),
        'cycle_us': _cycle_costs(robot),
        'errors': _errors(robot),
        'packaging': _packaging(robot),
    }
    if seconds is not None:
        result['plans_arriving'] = {
            'without': _under_planning_load(seconds, 0.0),
            'with': _under_planning_load(seconds, PLANS_PER_S),
        }
    return result


def spline_points(count: int = 100) -> list[list[float]]:
    """Return points of a smooth curve through the workspace."""
    points = []
    for n in range(1, count + 1):
        t = 2.0 * math.pi * n / count
        points.append([0.25 * math.sin(t), 0.2 * math.sin(2.0 * t), -0.80 - 0.04 * (1.0 - math.cos(3.0 * t))])
    return points


def _statements() -> dict[str, dict[str, Any]]:
    return {
        'MoveL': {'move_l': {'to_m': [0.3, 0.1, -0.85]}},
        'MoveL, time-optimal': {'move_l': {'to_m': [0.3, 0.1, -0.85], 'time_optimal': True}},
        'MoveC': {'move_c': {'via_m': [0.2, 0.2, -0.8], 'to_m': [0.3, 0.0, -0.8]}},
        'MoveSB, 100 points': {'move_sb': {'through_m': spline_points()}},
        'MoveSB, 100 points, 4 m/s, 100 m/s2': {
            'move_sb': {
                'through_m': spline_points(),
                'speed_m_s': 4.0,
                'acceleration_m_s2': 100.0,
                'jerk_m_s3': 5000.0,
            }
        },
    }


def _timed(action: Callable[[], Any], rounds: int = ROUNDS) -> dict[str, float]:
    action()
    spent = []
    for _ in range(rounds):
        started = time.perf_counter()
        action()
        spent.append(time.perf_counter() - started)
    return {'p50': float(np.median(spent)), 'max': max(spent), 'min': min(spent)}


START = (0.0, 0.0, -0.80)


def _planning_times(robot: Any) -> dict[str, dict[str, float]]:
    times = {}
    for name, statement in _statements().items():
        program = programs.parse({'moves': [statement]}, robot.motion)
        spent = _timed(lambda program=program: program_planner.plan(program, START, robot))  # type: ignore[misc]
        times[name] = {key: 1e3 * value for key, value in spent.items()}
    return times


def _pick_times(robot: Any) -> dict[str, dict[str, float]]:
    """Return percentiles of the planning time of random time-optimal picks."""
    times: dict[str, list[float]] = {name: [] for name in PICKS_BY}
    for number in range(PICKS):
        program = programs.parse(random_pick(number), robot.motion)
        start = program.start_m or START
        spent = _timed(partial(program_planner.plan, program, start, robot), PICK_ROUNDS)
        times[PICKS_BY[number % len(LIMITS)]].append(1e3 * spent['p50'])
    return {
        name: {f'p{share}': float(np.percentile(spent, share)) for share in (50, 90)} | {'max': max(spent)}
        for name, spent in times.items()
    }


def _cycle_costs(robot: Any) -> dict[str, dict[str, float]]:
    """Measure the cost of a command: plan, path and inverse kinematics of three arms."""
    costs = {}
    for name, statement in _statements().items():
        program = programs.parse({'moves': [statement]}, robot.motion)
        plan = program_planner.plan(program, START, robot).plan
        task = Transformation(robot)
        task.load(plan)
        task.start(0)
        cycles = math.ceil(plan.duration_s / robot.bus.cycle_time_s)
        started = time.perf_counter()
        for cycle in range(cycles):
            task.command(cycle)
        costs[name] = {'mean': 1e6 * (time.perf_counter() - started) / cycles}
    return costs


def _errors(robot: Any) -> dict[str, float]:
    """Return deviations of paths from the true circle and from their points, and of the cruise from its speed."""

    def plan(statement: dict[str, Any], start: Any) -> Any:
        return program_planner.plan(programs.parse({'moves': [statement]}, robot.motion), start, robot).plan

    circle = plan({'move_c': {'via_m': [0.0, 0.3, -0.8], 'to_m': [-0.3, 0.0, -0.8]}}, (0.3, 0.0, -0.8))
    s = np.linspace(0.0, circle.move(0).length_m, 20_001)
    radius = np.linalg.norm(sample_path(s, circle.move(0).segments)[:, 0, :2], axis=1)
    errors = {'circle_m': float(np.abs(radius - 0.3).max())}
    speed = 0.5
    spline = plan({'move_sb': {'through_m': spline_points(), 'speed_m_s': speed}}, START)
    step = 0.25e-3
    positions, master, _ = sample_plan(spline, np.arange(0.0, spline.duration_s, step))
    cruise = np.abs(master[1:-1, 1] - speed) < 1e-9
    tcp_speed = np.linalg.norm(positions[2:] - positions[:-2], axis=1) / (2.0 * step)
    errors['cruise_speed'] = float(np.abs(tcp_speed[cruise] / speed - 1.0).max())
    errors['cruise_share'] = float(cruise.mean())
    knots = spline.move(0).segments[:, 1::6]
    points = np.array(spline_points()[:-1])
    errors['points_m'] = float(np.linalg.norm(points[:, None] - knots, axis=2).min(axis=1).max())
    return errors


def _packaging(robot: Any) -> dict[str, Any]:
    """Return the time of the packaging cycle, and bounds without jerk limit or with motor limits only."""
    result: dict[str, Any] = {}
    for name in PACKAGING:
        program = programs.load(name, robot.motion)
        planned = program_planner.plan(program, program.start_m or START, robot)
        result[name] = {
            'cycle_s': planned.plan.duration_s / planned.repeat,
            'per_minute': 60.0 * planned.repeat / planned.plan.duration_s,
            'rms_current_a': max(planned.rms_current_a),
        }
    result['bounds'] = _bounds(robot)
    return result


def _bounds(robot: Any) -> dict[str, float]:
    """Return lower bounds [s] of the rounded half cycle: as planned, without jerk limit, and with the motors alone."""
    program = programs.load('packaging', robot.motion)
    moves = program_planner.plan(program, program.start_m or START, robot).plan.moves
    move = max(moves, key=lambda one: one.length_m)
    limits = program.statements[2].limits  # type: ignore[union-attr]
    bounds = {'planned': move.duration_s}
    curve = Curve(move.segments, move.length_m)
    for name, wish in (
        ('free jerk', Limits(limits.speed_m_s, limits.acceleration_m_s2, np.inf)),
        ('motors alone', Limits(100.0, 1e6, np.inf)),
    ):
        case = MovePlanner(curve, [(move.length_m, wish)], [(0.0, move.payload_kg)], robot)
        bounds[name] = case.bound_s()
    bounds |= _toppra(curve, limits, robot)
    return bounds


def _toppra(curve: Any, limits: Any, robot: Any) -> dict[str, float]:
    """Return the time [s] of toppra for the same path and acceleration, if it is installed."""
    try:
        import toppra
        import toppra.algorithm
        import toppra.constraint
    except ImportError:
        return {}
    toppra.setup_logging('ERROR')
    s = np.linspace(0.0, curve.length_m, 401)
    path = toppra.SplineInterpolator(s, sample_path(s, curve.segments)[:, 0])
    a = limits.acceleration_m_s2
    # |acceleration| <= a as a polygon in the plane of the motion (x, z), with 32 sides
    angles = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
    normals = np.stack([np.cos(angles), np.zeros(32), np.sin(angles)], axis=1)
    norm = toppra.constraint.SecondOrderConstraint(
        lambda q, qd, qdd: qdd, lambda q: normals, lambda q: np.full(32, a), 3
    )
    speed = toppra.constraint.JointVelocityConstraint(np.tile([-limits.speed_m_s, limits.speed_m_s], (3, 1)))
    instance = toppra.algorithm.TOPPRA(
        [speed, norm], path, gridpoints=s, parametrizer='ParametrizeConstAccel'
    )
    trajectory = instance.compute_trajectory(0.0, 0.0)
    return {} if trajectory is None else {'toppra, free jerk, no motors': float(trajectory.duration)}


def _under_planning_load(seconds: float, plans_per_s: float) -> dict[str, Any]:
    """Return cycle statistics of a robot at rest while plans of 100 points arrive continuously."""
    return in_child(partial(_measure_planning_load, seconds, plans_per_s))


def _measure_planning_load(seconds: float, plans_per_s: float) -> dict[str, Any]:
    from delta3_pacdrive.benchmarks.planning_load import measure

    robot = core.load()
    statement = _statements()['MoveSB, 100 points']
    program = programs.parse({'moves': [statement]}, robot.motion)
    return measure(seconds, plans_per_s, program_planner.plan(program, robot.motion.home_m, robot).plan)


def text(result: dict[str, Any]) -> Iterator[str]:
    """Yield the results as lines of text."""
    yield 'planning with all checks, and cost of a command per cycle (plan, path, inverse kinematics)'
    for name, spent in result['planning_ms'].items():
        cost = result['cycle_us'][name]['mean']
        yield f'  {name:>36}  {spent["p50"]:6.2f} ms (max {spent["max"]:.2f}), {cost:.2f} us per cycle'
    yield f'planning of {PICKS} random picks, up, over and down, time-optimal: p50 / p90 / max'
    for name, spent in result['picks_ms'].items():
        yield f'  {name:>36}  {" / ".join(f"{spent[key]:.1f}" for key in ("p50", "p90", "max"))} ms'
    errors = result['errors']
    yield 'errors'
    yield f'  {"MoveC from the true circle":>36}  {errors["circle_m"] * 1e9:.2f} nm'
    yield f'  {"MoveSB from its points":>36}  {errors["points_m"] * 1e9:.2f} nm'
    yield (
        f'  {"MoveSB, TCP speed on the cruise":>36}  within {errors["cruise_speed"]:.4%} '
        f'({errors["cruise_share"]:.0%} of the time)'
    )
    yield 'packaging cycle 25/305/25 mm, there with 0.5 kg and back'
    for name in PACKAGING:
        facts = result['packaging'][name]
        yield (
            f'  {name:>36}  {facts["cycle_s"]:.4f} s, {facts["per_minute"]:.1f} per minute, '
            f'{facts["rms_current_a"]:.2f} A rms'
        )
    bounds = result['packaging']['bounds']
    for name, value in bounds.items():
        yield f'  {"half cycle, " + name:>36}  {value:.4f} s ({bounds["planned"] / value:.3f})'
    for name, case in result.get('plans_arriving', {}).items():
        yield (
            f'task {name} plans arriving: {case["plans"]} of {case["plan_bytes"]} bytes in {case["cycles"]} cycles; '
            'times as p50 / p99 / p99.9 / max'
        )
        yield f'  {"overruns":>36}  {case["overruns"]}'
        yield f'  {"cycle start late":>36}  {times_text(case["lateness_ms"])}'
        yield f'  {"MDT to last AT":>36}  {times_text(case["mdt_to_last_at_ms"])}'
