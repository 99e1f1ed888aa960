"""Arches for pick and place: search for the fastest shape within the clearances.

An arch has two shape parameters: the height of its top, and the share of the horizontal distance that each bend takes.
Both bends are quintics with zero curvature at their ends; with a share of one half the arch has no straight top.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from delta3_pacdrive.errors import ProgramError, UnreachableError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.paths import curves
from delta3_pacdrive.planning.paths.curves import COINCIDENT_M, Curve
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.program.model import KeepOut, point_text

LEG_MIN_M = 2e-3  # minimum height of a bend
SHARE_MIN, SHARE_MAX = 0.05, 0.5  # of the horizontal distance, for each bend
RISE_FIRST_M, SHARE_FIRST = 0.02, 0.4  # start of the search: height above the lowest top, and share
RISE_STEP_M, SHARE_STEP = 0.02, 0.1  # initial step sizes
STEPS_SMALLER = 4  # number of halvings of the step sizes
CORNER_SHARES = (1.0, 0.75, 0.5)  # bends of plain corners relative to the widest possible bend
KEEP_OUT_SAMPLES = 257
ACROSS_MIN_M = 1e-2  # minimum horizontal distance
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Clearances:
    """End points of an arch [m] and the clearances to respect."""

    start_m: Floats
    end_m: Floats
    up_m: float
    down_m: float
    keep_out: KeepOut | None = None

    @property
    def lowest_top_m(self) -> float:
        """Minimum height z [m] of the top of an arch."""
        floor = max(float(self.start_m[2]) + self.up_m, float(self.end_m[2]) + self.down_m) + LEG_MIN_M
        return floor if self.keep_out is None else max(floor, self.keep_out.height_m)


def arch(room: Clearances, top_m: float, share: float) -> Curve:
    """Return the arch with its top at a height z [m] and bends that take a share of the horizontal distance each."""
    start, end = room.start_m, room.end_m
    across = (end - start) * np.array([1.0, 1.0, 0.0])
    way = float(np.linalg.norm(across))
    direction, still = across / way, np.zeros(3)
    left, landed = start + room.up_m * UP, end + room.down_m * UP
    over = np.array([start[0], start[1], top_m]) + share * across
    behind = np.array([end[0], end[1], top_m]) - share * across
    rise, fall, reach = top_m - float(left[2]), top_m - float(landed[2]), share * way
    turn = 0.5 * math.pi
    pieces = [
        curves.line(start, left),
        curves.rounded(
            np.stack([left, UP, still]), np.stack([over, direction, still]), (rise, reach), turn, 'arch'
        ),
        curves.line(over, behind),
        curves.rounded(
            np.stack([behind, direction, still]), np.stack([landed, -UP, still]), (reach, fall), turn, 'arch'
        ),
        curves.line(landed, end),
    ]
    return curves.joined([piece for piece in pieces if piece.length_m > COINCIDENT_M])


def best_arch(room: Clearances, cost: Callable[[Curve], float], corners: bool = False) -> Curve:
    """Return the arch with the lowest cost, found by pattern search from a medium height.

    ``cost`` may raise ProgramError for an arch that is not feasible. With ``corners`` the search also compares plain
    corners within the clearances: straight up, across and down, with bends as high as wide.

    Raises
    ------
    ProgramError
        The end points are above each other, or no arch is feasible; states the reason of the first failure.

    """
    if float(np.linalg.norm((room.end_m - room.start_m)[:2])) < ACROSS_MIN_M:
        raise ProgramError(
            f'an arch leads to {point_text(room.end_m)} m, which is above or below its start: use move_l'
        )
    lowest = room.lowest_top_m
    known: dict[tuple[float, float], float] = {}
    why: list[ProgramError | UnreachableError] = []

    def cost_of(curve: Curve) -> float:
        try:
            _require_kept_out(room, curve)
            return cost(curve)
        except (ProgramError, UnreachableError) as error:
            why.append(error)
            return math.inf

    def tried(rise: float, share: float) -> float:
        key = (round(rise, 9), round(share, 9))
        if key not in known:
            known[key] = cost_of(arch(room, lowest + rise, share))
        return known[key]

    best = _first(tried)
    if best is None:
        raise ProgramError(f'no arch within the clearances can be driven: {why[0]}')
    steps = (RISE_STEP_M, SHARE_STEP)
    for _ in range(STEPS_SMALLER + 1):
        moved = True
        while moved:
            moved = False
            for axis, sign in ((0, -1.0), (0, 1.0), (1, 1.0), (1, -1.0)):
                rise = max(best[0] + (sign * steps[0] if axis == 0 else 0.0), 0.0)
                share = min(max(best[1] + (sign * steps[1] if axis == 1 else 0.0), SHARE_MIN), SHARE_MAX)
                if tried(rise, share) < tried(*best):
                    best, moved = (rise, share), True
        steps = (0.5 * steps[0], 0.5 * steps[1])
    found = [(tried(*best), arch(room, lowest + best[0], best[1]))]
    if corners:
        tops = dict.fromkeys((lowest, lowest + best[0]))
        found += [(cost_of(curve), curve) for top_m in tops for curve in plain_corners(room, top_m)]
    return min(found, key=lambda one: one[0])[1]


def plain_corners(room: Clearances, top_m: float) -> list[Curve]:
    """Return arches with plain corners and a top at a height z [m], with the widest possible bends and smaller ones."""
    start_z, end_z = float(room.start_m[2]), float(room.end_m[2])
    way = float(np.linalg.norm((room.end_m - room.start_m)[:2]))
    widest = min(top_m - max(start_z + room.up_m, end_z + room.down_m), SHARE_MAX * way)
    return [
        arch(replace(room, up_m=top_m - start_z - bend, down_m=top_m - end_z - bend), top_m, bend / way)
        for bend in (share * widest for share in CORNER_SHARES)
    ]


def _first(tried: Callable[[float, float], float]) -> tuple[float, float] | None:
    """Return height and share of the first feasible arch; lower arches and shorter bends are tried later."""
    for share in (SHARE_FIRST, 0.5 * SHARE_FIRST, SHARE_MIN):
        for rise in (RISE_FIRST_M, 0.25 * RISE_FIRST_M, 0.0):
            if math.isfinite(tried(rise, share)):
                return rise, share
    return None


def _require_kept_out(room: Clearances, curve: Curve) -> None:
    """Raise ProgramError if an arch enters the keep-out zone."""
    if room.keep_out is None:
        return
    p = sample_path(np.linspace(0.0, curve.length_m, KEEP_OUT_SAMPLES), curve.segments)[:, 0]
    beyond = _beyond(p, room)
    # add the points where it crosses the margin between two samples
    (n,) = np.nonzero((beyond[:-1] * beyond[1:] < 0.0) & (np.abs(beyond[:-1]) > COINCIDENT_M))
    share = (beyond[n] / (beyond[n] - beyond[n + 1]))[:, None]
    places = np.concatenate([p[beyond > COINCIDENT_M], p[n] + share * (p[n + 1] - p[n])])
    if not len(places):  # the margins of both ends meet
        return
    lowest = places[np.argmin(places[:, 2])]
    if lowest[2] < room.keep_out.height_m - COINCIDENT_M:
        raise ProgramError(
            f'it is at z = {lowest[2]:.4g} m, {_beyond(lowest[None], room)[0] + room.keep_out.margin_m:.4g} m from '
            f'its nearer end, where the limit is {room.keep_out.height_m:g} m'
        )


def _beyond(p: Floats, room: Clearances) -> Floats:
    """Return the horizontal distance of points (n, 3) from the nearer end, less the margin [m]."""
    margin = 0.0 if room.keep_out is None else room.keep_out.margin_m
    distances = (np.linalg.norm((p - one)[:, :2], axis=1) for one in (room.start_m, room.end_m))
    return np.asarray(np.minimum(*distances) - margin)
