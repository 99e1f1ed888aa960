"""Paths of statements from the point at which the robot stands."""

import numpy as np

from delta3_pacdrive.motion import curves
from delta3_pacdrive.motion.curves import Curve
from delta3_pacdrive.motion.move import MoveKind
from delta3_pacdrive.motion.program import (
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
from delta3_pacdrive.numerics.types import Floats


def end_of(statement: Statement, here: Floats) -> Floats:
    """Return where a robot stands behind a statement."""
    if isinstance(statement, MoveSB):
        for target in statement.through:
            here = resolve(target, here)
        return here
    if isinstance(statement, MoveC) and statement.angle_rad is not None:
        curve, _ = curve_of(here, statement)
        return np.asarray(curve.at(curve.length_m)[0])
    return here if isinstance(statement, Dwell | Joints | Output | Turn) else resolve(statement.to, here)


def resolve(target: Target, here: Floats) -> Floats:
    """Return the point that a target means from another on [m], shape (3,)."""
    return here + np.array(target.point_m) if target.relative else np.array(target.point_m)


def curve_of(here: Floats, statement: PathMove) -> tuple[Curve, MoveKind]:
    """Return the path of a statement from a point [m] on, and what kind of move it is."""
    match statement:
        case MoveL(to=to):
            return curves.line(here, resolve(to, here)), MoveKind.LINE
        case MoveC(via=via, to=to, angle_rad=angle_rad):
            return curves.arc(here, resolve(via, here), resolve(to, here), angle_rad), MoveKind.ARC
        case MoveSB(through=through):
            points = [here]
            for target in through:
                points.append(resolve(target, points[-1]))
            return curves.spline(np.array(points)), MoveKind.SPLINE
    raise TypeError(f'{type(statement).__name__} has no path')
