"""What is asked for of a program, otherwise than it says. Light: messages hold it."""

from dataclasses import dataclass

Caps = tuple[float, float, float]
NO_CAPS: Caps = (0.0, 0.0, 0.0)
APPROACH_M_S, APPROACH_M_S2, APPROACH_M_S3 = (
    0.25,
    2.0,
    40.0,
)  # of going to the start, if nothing else is asked for


@dataclass(frozen=True)
class Adaptation:
    """What is asked for otherwise than a program says.

    Attributes
    ----------
    caps
        Largest speed [m/s], acceleration [m/s^2] and jerk [m/s^3] of its moves; 0: no cap.
    first
        The statement with which it begins; those before are left out.
    approach_m_s
        How fast the robot goes to its start before, straight; 0: it has to stand there.

    """

    caps: Caps = NO_CAPS
    first: int = 0
    approach_m_s: float = 0.0


AS_IT_IS = Adaptation()
