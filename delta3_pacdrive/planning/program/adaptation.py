"""Run-time changes to a program: speed caps, start statement, approach move. No imports: messages contain it."""

from dataclasses import dataclass

Caps = tuple[float, float, float]
NO_CAPS: Caps = (0.0, 0.0, 0.0)
# speed [m/s], acceleration [m/s^2] and jerk [m/s^3] of the approach move
APPROACH_M_S, APPROACH_M_S2, APPROACH_M_S3 = 0.25, 2.0, 40.0


@dataclass(frozen=True)
class Adaptation:
    """Requested changes to a program."""

    caps: Caps = NO_CAPS  # limits for speed [m/s], acceleration [m/s^2], jerk [m/s^3] of all moves; 0: no cap
    first: int = 0  # index of the first executed statement
    approach_m_s: float = 0.0  # speed of a straight approach to the start; 0: the robot must be at the start


AS_IT_IS = Adaptation()
