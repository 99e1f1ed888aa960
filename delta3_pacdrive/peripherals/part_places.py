"""Where a part is while it stays somewhere: with the belt that it rides on, at the TCP, or where it lies."""

import math

from delta3_pacdrive.peripherals.cell import Place, turned
from delta3_pacdrive.peripherals.parts import How, Stay


def place_m(
    stay: Stay, tcp_m: Place, way_m: float = 0.0, direction_rad: float = 0.0, turn_rad: float = 0.0
) -> Place | None:
    """Return where the middle of the underside of a part is [m]; None: it is gone.

    Parameters
    ----------
    stay
        Of the part, the last one that has begun.
    tcp_m
        Place of the TCP [m].
    way_m, direction_rad
        How far the belt that it rides on has gone since the begin of the stay [m], and its direction [rad].
    turn_rad
        Angle of the tool [rad].

    """
    x, y, z = stay.at_m
    if stay.how is How.GONE:
        return None
    if stay.how is How.IN_HAND:
        x, y, z = turned(stay.at_m, turn_rad)
        return (tcp_m[0] + x, tcp_m[1] + y, tcp_m[2] + z)
    if stay.how is How.RIDING:
        return (x + way_m * math.cos(direction_rad), y + way_m * math.sin(direction_rad), z)
    return stay.at_m


def angle_rad(stay: Stay, turn_rad: float = 0.0) -> float:
    """Return how a part is turned about the vertical [rad], with the tool at an angle [rad]."""
    return stay.angle_rad + turn_rad if stay.how is How.IN_HAND else stay.angle_rad
