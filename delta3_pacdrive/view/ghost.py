"""The ghost of the robot: it stands off by what the TCP and the tool are off, magnified."""

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.view.values import Instant

FAR_M, FAR_RAD = 0.4, 1.5  # a ghost goes no further away, however much its error is magnified
NEAR_M, NEAR_RAD = 5e-4, 0.02  # nearer it would only tint the robot
COMMAND, TRUE = 'command', 'true'
KINDS = (COMMAND, TRUE, 'none')


def ghost_of(
    instant: Instant, tcp_m: Floats, error_m: Floats, kind: str, magnification: float
) -> tuple[Floats, float] | None:
    """Return the TCP of the ghost [m], shape (3,), and the angle of its tool [rad]; None: there is nothing to see.

    Parameters
    ----------
    instant
        What is known of the robot.
    tcp_m, error_m
        Its TCP, and the error of that: command minus actual [m], shape (3,).
    kind
        One of ``KINDS``: what the ghost is.
    magnification
        Of the error.

    """
    away, turn, off = None, instant.turn, 0.0
    if kind == COMMAND:
        away, off = error_m, 0.0 if turn is None else turn.error_rad
    elif kind == TRUE and instant.true_m is not None:
        away = instant.true_m - tcp_m
        if turn is not None and turn.true_rad is not None:
            off = turn.true_rad - turn.angle_rad
    if away is None or not np.isfinite(away).all():
        return None
    away, off = magnification * away, max(-FAR_RAD, min(magnification * off, FAR_RAD))
    length = float(np.linalg.norm(away))
    if length < NEAR_M and abs(off) < NEAR_RAD:
        return None
    share = min(1.0, FAR_M / length) if length > 0.0 else 0.0
    return np.asarray(tcp_m + away * share), off + (0.0 if turn is None else turn.angle_rad)
