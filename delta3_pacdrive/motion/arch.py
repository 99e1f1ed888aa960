"""Arches from a pick to a place: the shape that is best within the clearances.

A shape has two numbers: the height of its top, and how much of the way across each of its bends takes. Both bends are
quintics without curvature at their ends; with half of the way each the arch has no straight top.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from delta3_pacdrive.errors import ProgramError, UnreachableError
from delta3_pacdrive.motion import curves
from delta3_pacdrive.motion.curves import COINCIDENT_M, Curve
from delta3_pacdrive.motion.path import sample_path
from delta3_pacdrive.motion.program import KeepOut, point_text
from delta3_pacdrive.numerics.types import Floats

LEG_MIN_M = 2e-3  # height of a bend
SHARE_MIN, SHARE_MAX = 0.05, 0.5  # of the way across, of each bend
RISE_FIRST_M, SHARE_FIRST = 0.02, 0.4  # where the search begins: how far above the lowest top
RISE_STEP_M, SHARE_STEP = 0.02, 0.1  # its first steps
STEPS_SMALLER = 4  # how often the steps are halved
CORNER_SHARES = (1.0, 0.75, 0.5)  # bends of plain corners, of the widest
KEEP_OUT_SAMPLES = 257
ACROSS_MIN_M = 1e-2  # shortest way across
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Clearances:
    """What an arch from one point [m] to another has to keep."""

    start_m: Floats
    end_m: Floats
    up_m: float
    down_m: float
    keep_out: KeepOut | None = None

    @property
    def lowest_top_m(self) -> float:
        """Height z [m] that the top of every arch has at least."""
        floor = max(float(self.start_m[2]) + self.up_m, float(self.end_m[2]) + self.down_m) + LEG_MIN_M
        return floor if self.keep_out is None else max(floor, self.keep_out.height_m)


def arch(room: Clearances, top_m: float, share: float) -> Curve:
    """Return the arch whose top is at a height z [m], each of whose bends takes a share of the way across."""
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
    """Return the arch with the lowest cost, by a pattern search from an arch of medium height on.

    ``cost`` may raise ProgramError for an arch that the robot cannot drive. With ``corners`` the search also compares
    the plain corners that the clearances allow: straight up, across and down again, with bends as high as wide.

    Raises
    ------
    ProgramError
        The points are above each other, or none of the arches that were tried can be driven; tells why.

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

    here = _first(tried)
    if here is None:
        raise ProgramError(f'no arch within the clearances can be driven: {why[0]}')
    steps = (RISE_STEP_M, SHARE_STEP)
    for _ in range(STEPS_SMALLER + 1):
        moved = True
        while moved:
            moved = False
            for axis, sign in ((0, -1.0), (0, 1.0), (1, 1.0), (1, -1.0)):
                rise = max(here[0] + (sign * steps[0] if axis == 0 else 0.0), 0.0)
                share = min(max(here[1] + (sign * steps[1] if axis == 1 else 0.0), SHARE_MIN), SHARE_MAX)
                if tried(rise, share) < tried(*here):
                    here, moved = (rise, share), True
        steps = (0.5 * steps[0], 0.5 * steps[1])
    found = [(tried(*here), arch(room, lowest + here[0], here[1]))]
    if corners:
        tops = dict.fromkeys((lowest, lowest + here[0]))
        found += [(cost_of(curve), curve) for top_m in tops for curve in plain_corners(room, top_m)]
    return min(found, key=lambda one: one[0])[1]


def plain_corners(room: Clearances, top_m: float) -> list[Curve]:
    """Return plain corners whose top is at a height z [m], with the widest bends that the clearances allow and less."""
    start_z, end_z = float(room.start_m[2]), float(room.end_m[2])
    way = float(np.linalg.norm((room.end_m - room.start_m)[:2]))
    widest = min(top_m - max(start_z + room.up_m, end_z + room.down_m), SHARE_MAX * way)
    return [
        arch(replace(room, up_m=top_m - start_z - bend, down_m=top_m - end_z - bend), top_m, bend / way)
        for bend in (share * widest for share in CORNER_SHARES)
    ]


def _first(tried: Callable[[float, float], float]) -> tuple[float, float] | None:
    """Return the first arch that can be driven; lower ones and ones with shorter bends come later."""
    for share in (SHARE_FIRST, 0.5 * SHARE_FIRST, SHARE_MIN):
        for rise in (RISE_FIRST_M, 0.25 * RISE_FIRST_M, 0.0):
            if math.isfinite(tried(rise, share)):
                return rise, share
    return None


def _require_kept_out(room: Clearances, curve: Curve) -> None:
    """Refuse an arch that is too low somewhere; raises ProgramError."""
    if room.keep_out is None:
        return
    p = sample_path(np.linspace(0.0, curve.length_m, KEEP_OUT_SAMPLES), curve.segments)[:, 0]
    beyond = _beyond(p, room)
    # where it passes the margin between two samples
    (n,) = np.nonzero((beyond[:-1] * beyond[1:] < 0.0) & (np.abs(beyond[:-1]) > COINCIDENT_M))
    share = (beyond[n] / (beyond[n] - beyond[n + 1]))[:, None]
    places = np.concatenate([p[beyond > COINCIDENT_M], p[n] + share * (p[n + 1] - p[n])])
    if not len(places):  # the margins of both ends meet
        return
    lowest = places[np.argmin(places[:, 2])]
    if lowest[2] < room.keep_out.height_m - COINCIDENT_M:
        raise ProgramError(
            f'it is at z = {lowest[2]:.4g} m, {_beyond(lowest[None], room)[0] + room.keep_out.margin_m:.4g} m beside '
            f'its nearer end, where the limit is {room.keep_out.height_m:g} m'
        )


def _beyond(p: Floats, room: Clearances) -> Floats:
    """Return how far points (n, 3) are beside the nearer end, horizontally, beyond the margin [m]."""
    margin = 0.0 if room.keep_out is None else room.keep_out.margin_m
    beside = (np.linalg.norm((p - one)[:, :2], axis=1) for one in (room.start_m, room.end_m))
    return np.asarray(np.minimum(*beside) - margin)
