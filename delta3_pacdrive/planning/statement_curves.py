"""Paths of statements from the current position."""

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.paths import curves
from delta3_pacdrive.planning.paths.curves import Curve
from delta3_pacdrive.planning.paths.move import MoveKind
from delta3_pacdrive.planning.program.model import (
    Dwell,
    Joints,
    MoveC,
    MoveL,
    MoveSB,
    Output,
    PathMove,
    Statement,
    Target,
    Turn,
)


def end_of(statement: Statement, start: Floats) -> Floats:
    """Return the position after a statement."""
    if isinstance(statement, MoveSB):
        for target in statement.through:
            start = resolve(target, start)
        return start
    if isinstance(statement, MoveC) and statement.angle_rad is not None:
        curve, _ = curve_of(start, statement)
        return np.asarray(curve.at(curve.length_m)[0])
    return start if isinstance(statement, Dwell | Joints | Output | Turn) else resolve(statement.to, start)


def resolve(target: Target, start: Floats) -> Floats:
    """Return the position of a target for a start position [m], shape (3,)."""
    return start + np.array(target.point_m) if target.relative else np.array(target.point_m)


def curve_of(start: Floats, statement: PathMove) -> tuple[Curve, MoveKind]:
    """Return the path of a statement from a start position [m], and the kind of its move."""
    match statement:
        case MoveL(to=to):
            return curves.line(start, resolve(to, start)), MoveKind.LINE
        case MoveC(via=via, to=to, angle_rad=angle_rad):
            return curves.arc(start, resolve(via, start), resolve(to, start), angle_rad), MoveKind.ARC
        case MoveSB(through=through):
            points = [start]
            for target in through:
                points.append(resolve(target, points[-1]))
            return curves.spline(np.array(points)), MoveKind.SPLINE
    raise TypeError(f'{type(statement).__name__} has no path')
