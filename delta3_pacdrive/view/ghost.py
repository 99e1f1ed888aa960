"""The ghost of the robot: a second figure, displaced by the magnified error of TCP and tool."""

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.view.values import Instant

FAR_M, FAR_RAD = 0.4, 1.5  # maximum displacement, whatever the magnification
NEAR_M, NEAR_RAD = 5e-4, 0.02  # minimum displacement: a nearer ghost would only tint the robot
COMMAND, TRUE = 'command', 'true'
KINDS = (COMMAND, TRUE, 'none')


def ghost_of(
    instant: Instant, tcp_m: Floats, error_m: Floats, kind: str, magnification: float
) -> tuple[Floats, float] | None:
    """Return TCP [m], shape (3,), and tool angle [rad] of the ghost; None without a visible error.

    Parameters
    ----------
    instant
        State of the robot.
    tcp_m, error_m
        Its TCP, and the TCP error, command minus actual [m], shape (3,).
    kind
        One of ``KINDS``: the pose that the ghost shows.
    magnification
        Factor of the error.

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
