"""Position of a part during a stay: on a belt, in the gripper, or at rest."""

import math

from delta3_pacdrive.belts.model import Place
from delta3_pacdrive.cell.cell import turned
from delta3_pacdrive.cell.parts import How, Stay


def place_m(
    stay: Stay, tcp_m: Place, way_m: float = 0.0, direction_rad: float = 0.0, turn_rad: float = 0.0
) -> Place | None:
    """Return the middle of the underside of a part [m]; None if the part is gone.

    Parameters
    ----------
    stay
        Latest stay of the part that has begun.
    tcp_m
        Position of the TCP [m].
    way_m, direction_rad
        Travel of the belt since the beginning of the stay [m], and its direction [rad].
    turn_rad
        Tool angle [rad].

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
    """Return the angle of a part about the vertical [rad], given the tool angle [rad]."""
    return stay.angle_rad + turn_rad if stay.how is How.IN_HAND else stay.angle_rad
