"""``delta3 bench shaping``: vibration of the built robot after random moves, with each kind of input shaping."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive import simulation
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import RATED_PAYLOAD_KG, Parameters
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.studies.framework.residual_vibration import swing_after
from delta3_pacdrive.studies.framework.study import OnProgress, silent

MOVES, SEED = 100, 1
SHORTEST_M = 0.05
LIMITS = {'speed_m_s': 3.0, 'acceleration_m_s2': 100.0, 'jerk_m_s3': 20_000.0}
PROMISED_DB = 20.0
BUILT, WITHOUT_PLAY = ROBOTS = ('built', 'without play')
MM, MS = 1e3, 1e3


def random_moves(count: int, robot: Parameters, seed: int = SEED) -> list[tuple[Floats, float]]:
    """Return straight moves between random points of the workspace [m], shape (2, 3), each with a payload [kg].

    Parameters
    ----------
    count
        Number of moves.
    robot
        Defines the workspace.
    seed
        Seed of the random numbers.

    """
    random, k = np.random.default_rng(seed), robot.kinematics
    found: list[tuple[Floats, float]] = []
    while len(found) < count:
        radius = 0.5 * k.workspace_diameter_m * np.sqrt(random.random(2))
        azimuth = math.tau * random.random(2)
        z = random.uniform(k.workspace_bottom_m, k.workspace_top_m, 2)
        payload_kg = float(random.uniform(0.0, RATED_PAYLOAD_KG))
        ends = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=-1)
        if np.linalg.norm(ends[1] - ends[0]) >= SHORTEST_M:
            found.append((ends, payload_kg))
    return found


def measure(
    count: int = MOVES,
    kinds: Sequence[str] = core.SHAPINGS,
    robots: Sequence[str] = ROBOTS,
    show: OnProgress = silent,
) -> dict[str, Any]:
    """Return the vibration of every kind of shaping on each robot, and its reduction.

    Parameters
    ----------
    count
        Number of random moves.
    kinds
        Of shaping; the first one is the reference.
    robots
        Names of robots.
    show
        Called with stage, number done and total number.

    """
    known = core.load('rich+model')
    moves, result = random_moves(count, known), {}
    for n, name in enumerate(robots):
        robot = known.replace(rich__gear_backlash_rad=0.0) if name == WITHOUT_PLAY else known
        swings, times = np.empty((len(kinds), count)), np.empty((len(kinds), count))
        for i, (ends, payload_kg) in enumerate(moves):
            show(name, n * count + i, len(robots) * count)
            for j, kind in enumerate(kinds):
                swings[j, i], times[j, i] = _driven(ends, payload_kg, robot.replace(control__shaping=kind))
        result[name] = {
            kind: _figures(swings[j], swings[0], times[j] - times[0]) for j, kind in enumerate(kinds)
        }
    return {
        'moves': count,
        'seed': SEED,
        'limits': LIMITS,
        'payload_max_kg': RATED_PAYLOAD_KG,
        'robots': result,
    }


def _driven(ends: Floats, payload_kg: float, robot: Parameters) -> tuple[float, float]:
    """Return the vibration after a move [m], and its duration [s]."""
    document = {
        'start_m': ends[0].tolist(),
        'payload_kg': payload_kg,
        'limits': LIMITS,
        'moves': [{'move_l': {'to_m': ends[1].tolist()}}],
    }
    program = program_file.parse(document, robot.motion, 'random')
    planned = simulation.plan_of(program, simulation.placed(robot, program))
    move = planned.plan.move(0)
    return swing_after(move, program, planned, robot), move.duration_s


def _figures(swing_m: Floats, unshaped_m: Floats, longer_s: Floats) -> dict[str, float]:
    less_db = 20.0 * np.log10(unshaped_m / swing_m)
    return {
        'longer_s': float(np.median(longer_s)),
        'swing_median_m': float(np.median(swing_m)),
        'swing_max_m': float(swing_m.max()),
        'less_min_db': float(less_db.min()),
        'less_5_percent_db': float(np.percentile(less_db, 5.0)),
        'less_median_db': float(np.median(less_db)),
        'promised_share': float((less_db >= PROMISED_DB).mean()),
    }


def text(result: dict[str, Any]) -> Iterator[str]:
    """Yield the results as lines of text, one line per robot and kind."""
    yield (
        f'{result["moves"]} random moves (seed {result["seed"]}), 0 to {result["payload_max_kg"]:g} kg: swing of the '
        f'true TCP after the stop'
    )
    yield (
        f'{"robot":>14} {"shaping":>8} {"longer":>8} {"median":>9} {"largest":>9} {"reduced by: least":>18} '
        f'{"5 %":>8} {"median":>8} {f"{PROMISED_DB:g} dB":>8}'
    )
    for robot, kinds in result['robots'].items():
        for kind, one in kinds.items():
            yield (
                f'{robot:>14} {kind:>8} {MS * one["longer_s"]:5.0f} ms {MM * one["swing_median_m"]:6.3f} mm '
                f'{MM * one["swing_max_m"]:6.3f} mm {one["less_min_db"]:15.1f} dB {one["less_5_percent_db"]:5.1f} dB '
                f'{one["less_median_db"]:5.1f} dB {100.0 * one["promised_share"]:6.0f} %'
            )
