"""Random programs with random faults, determined by seed, pace and number."""

import random
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from delta3_pacdrive.robot.faults.fault import KINDS, NODES, SUPPLY_FAULTS, THERMAL_FAULTS, Target
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES

RADIUS_M, TOP_M, BOTTOM_M = 0.35, -0.74, -0.92
MOVES_MAX = 5
DISTURBED = 0.7  # share of programs with faults
QUICK = ('freeze', 'kill')  # process faults with a short recovery
PROCESSES = 0.1  # share of process faults
HANGING = 0.2  # share of freezes that exceed the timeouts of some partners
# supply and temperatures of the soak test's robot have no model
OF_THE_ROBOT = [
    name
    for name, kind in KINDS.items()
    if kind.target != Target.NODE and name not in ('clear', *SUPPLY_FAULTS, *THERMAL_FAULTS)
]


@dataclass(frozen=True)
class Drawn:
    """A random program of a sequence; moves and faults as in a program file."""

    number: int
    moves: list[dict[str, Any]]
    faults: list[dict[str, Any]]

    @property
    def end_m(self) -> list[float]:
        """End point of the last move [m]."""
        (move,) = self.moves[-1].values()
        end: list[float] = move['to_m'] if 'to_m' in move else move['through_m'][-1]
        return end

    @property
    def kinds(self) -> list[str]:
        """Kinds of its faults."""
        return [fault['fault'] for fault in self.faults]

    @property
    def last_fault_s(self) -> float:
        """Bus time from the start to the last fault [s]."""
        return max((fault['after_s'] for fault in self.faults), default=0.0)

    def lost(self, kinds: frozenset[str], axis: str = '') -> tuple[int, bool]:
        """Return the number of telegrams lost by faults of some kinds, and whether no two losses can coincide."""
        rows = [f for f in self.faults if f['fault'] in kinds and axis in ('', f['axis'])]
        return sum(fault['cycles'] for fault in rows), len(rows) < 2

    def to_yaml(self) -> str:
        """Return the content of a program file."""
        return str(yaml.safe_dump({'moves': self.moves, 'faults': self.faults}, sort_keys=False))


def draw(seed: int, pace: str, number: int) -> Drawn:
    """Draw a program of a sequence."""
    chance = random.Random(f'{seed} {pace} {number}')  # noqa: S311 (repeatable, not secret)
    moves = [_move(chance) for _ in range(chance.randint(1, MOVES_MAX))]
    count = chance.choice((1, 1, 2, 3)) if chance.random() < DISTURBED else 0
    return Drawn(number, moves, [_fault(chance) for _ in range(count)])


def _point(chance: random.Random) -> list[float]:
    radius, angle = RADIUS_M * chance.random() ** 0.5, chance.uniform(0.0, 2.0 * np.pi)
    x, y = float(radius * np.cos(angle)), float(radius * np.sin(angle))
    return [x, y, chance.uniform(BOTTOM_M, TOP_M)]


def _move(chance: random.Random) -> dict[str, Any]:
    limits = {
        'speed_m_s': chance.uniform(0.3, 3.0),
        'acceleration_m_s2': chance.uniform(5.0, 40.0),
        'jerk_m_s3': chance.uniform(500.0, 8000.0),
    }
    kind = chance.choice(('l', 'l', 'l', 'c', 'sb'))
    if kind == 'l':
        blend = chance.choice((0.0, 0.0, chance.uniform(0.002, 0.03)))
        return {'move_l': {'to_m': _point(chance), 'blend_m': blend, **limits}}
    if kind == 'c':
        return {'move_c': {'via_m': _point(chance), 'to_m': _point(chance), **limits}}
    return {'move_sb': {'through_m': [_point(chance) for _ in range(chance.randint(2, 6))], **limits}}


def _fault(chance: random.Random) -> dict[str, Any]:
    """Draw a fault after which the robot can still be moved."""
    hangs = chance.random() < HANGING
    values = {
        'jump_rad': chance.choice((0.05, -0.1, 3.0)),
        'drift_rad_s': chance.uniform(-0.5, 0.5),
        'noise_rad': chance.uniform(0.0, 1e-3),
        'voltage_v': chance.uniform(0.0, 900.0),
        'lost_share': 0.5,
        'torque_n_m': chance.uniform(-2.0, 2.0),
        'by_cycles': chance.randint(1, 8),
        'seconds': chance.uniform(0.4, 4.0) if hangs else chance.uniform(0.01, 0.4),
    }
    name = chance.choice(QUICK if chance.random() < PROCESSES else OF_THE_ROBOT)
    kind = KINDS[name]
    fault: dict[str, Any] = {'fault': name, 'after_s': chance.uniform(0.0, 0.8)}
    if kind.target == Target.AXIS:
        fault['axis'] = chance.choice(DRIVES)
    elif kind.target == Target.NODE:
        fault['node'] = chance.choice(NODES)
    if kind.value:
        fault[kind.value] = values[kind.value]
    if kind.telegram:
        fault['cycles'] = chance.choice((1, 1, 2, 5))
    return fault
