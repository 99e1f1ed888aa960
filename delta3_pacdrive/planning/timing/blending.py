"""Path segments of a move: the curves of its statements, joined with rounded corners."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from delta3_pacdrive.errors import ProgramError, UnreachableError
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.paths import curves
from delta3_pacdrive.planning.paths.curves import COINCIDENT_M, Curve
from delta3_pacdrive.planning.paths.move import MoveKind

ROUNDING_M = (
    1e-9  # shorter remainders of a segment between two blends are skipped; below the allowed path jump
)


class StatementError(ProgramError):
    """A statement of a program cannot be planned; ``number`` is its index."""

    def __init__(self, number: int, sentence: str) -> None:
        super().__init__(sentence)
        self.number = number


@contextmanager
def attributed_to(number: int, name: str) -> Iterator[None]:
    """Attribute errors to a statement, unless they already name one; raises StatementError."""
    try:
        yield
    except StatementError:
        raise
    except (ProgramError, UnreachableError) as error:
        raise StatementError(number, f'{name}: {error}') from None


@dataclass(frozen=True)
class PathSegment:
    """Part of a move that belongs to one statement: curve, limits, and number and name of the statement."""

    curve: Curve
    limits: Limits
    blend_m: float
    strict: bool
    kind: MoveKind
    number: int
    name: str
    time_optimal: bool = False
    torque_rate_n_m_s: float = math.inf
    # start and end angle of each rotary axis [rad]; empty: not defined by the plan
    turns_rad: tuple[tuple[float, float], ...] = ()
    heat: float = 0.0  # weight of the motor losses relative to the time, for time-optimal moves
    is_arch: bool = False
    constant_speed: bool = False


def blended(
    segments: list[PathSegment],
) -> tuple[Curve, list[float], list[float], list[tuple[float, Limits]]]:
    """Join segments and round their corners.

    Returns the curve, the distance of each segment's end (middle of its blend), the distance at the end of each
    segment's part (after its blend), and stretches (end, limits).
    """
    pieces: list[Curve] = []
    ends: list[float] = []
    parts: list[float] = []
    stretches: list[tuple[float, Limits]] = []
    length, cut = 0.0, 0.0
    for n, segment in enumerate(segments):
        radius = segment.blend_m if n + 1 < len(segments) else 0.0
        free = segment.curve.length_m - cut - radius
        with attributed_to(segment.number, segment.name):
            if free < -COINCIDENT_M:
                raise ProgramError(
                    f'its blends overlap: {cut:g} m at its start and {radius:g} m at its end on a length of '
                    f'{segment.curve.length_m:.4g} m'
                )
            if radius > 0.0 and radius > segments[n + 1].curve.length_m:
                raise ProgramError(
                    f'blend_m is {radius:g}, but the next move is only {segments[n + 1].curve.length_m:.4g} m long'
                )
        if free > ROUNDING_M or len(segments) == 1:
            pieces.append(segment.curve.part(cut, segment.curve.length_m - radius))
            length += pieces[-1].length_m
            stretches.append((length, segment.limits))
        if radius > 0.0:
            with attributed_to(segment.number, segment.name):
                corner = curves.blend(segment.curve, segments[n + 1].curve, radius)
            pieces.append(corner)
            ends.append(length + 0.5 * corner.length_m)
            length += corner.length_m
            stretches.append((length, segment.limits.lower(segments[n + 1].limits)))
        else:
            ends.append(length)
        parts.append(length)
        cut = radius
    curve = curves.joined(pieces) if len(pieces) > 1 else pieces[0]
    return curve, ends, parts, stretches


def name_of(segments: Sequence[PathSegment]) -> str:
    """Return the name of a move of these segments for messages."""
    return segments[0].name if len(segments) == 1 else f'{segments[0].name} to {segments[-1].name}'
