"""Press-and-hold jogging: a button that is held says so again and again, and the robot stops when it does not.

Nothing tells reliably that a button was let go: the page may be closed, the browser may hang, the network may be gone.
So the button beats like a heart while it is held, and silence is the release.
"""

from enum import Enum

import numpy as np

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Kinematics

BEATS_HZ = 20.0
JOG_ACCELERATION_M_S2, JOG_JERK_M_S3 = 2.0, 40.0  # gentle: people look at what they move
SILENT_S = 0.25  # without a beat, after which the button is taken for released
EDGE_M = 1e-4  # by which a jog stays away from the edge of the workspace
DIRECTIONS = {
    '+x': (1.0, 0.0, 0.0),
    '-x': (-1.0, 0.0, 0.0),
    '+y': (0.0, 1.0, 0.0),
    '-y': (0.0, -1.0, 0.0),
    '+z': (0.0, 0.0, 1.0),
    '-z': (0.0, 0.0, -1.0),
}


class Turn(Enum):
    """What a look at the button says."""

    NOTHING = 'nothing'
    PRESSED = 'pressed'
    RELEASED = 'released'


class Button:
    """The buttons of all directions, of which one counts at a time.

    Attributes
    ----------
    direction
        That is driven, empty for none.

    """

    def __init__(self) -> None:
        self.direction = ''
        self._wanted, self._beat_s = '', -np.inf
        self._dropped = False

    def beat(self, direction: str, now_s: float) -> None:
        """Take note that a button is held; another one counts only when this one is released."""
        if self._wanted in ('', direction):
            self._wanted, self._beat_s = direction, now_s

    def look(self, now_s: float) -> Turn:
        """Say what is new."""
        if now_s - self._beat_s > SILENT_S:
            self._wanted, self._dropped = '', False
            if self.direction:
                self.direction = ''
                return Turn.RELEASED
        elif not self.direction and not self._dropped:
            self.direction = self._wanted
            return Turn.PRESSED
        return Turn.NOTHING

    def drop(self) -> None:
        """Give the motion up: the button has to be let go before it counts again."""
        self.direction, self._dropped = '', True


def edge(tcp_m: Floats, direction: str, kinematics: Kinematics) -> Floats:
    """Return where a straight line from the TCP leaves the workspace.

    Parameters
    ----------
    tcp_m
        Where the robot stands [m], shape (3,).
    direction
        One of ``DIRECTIONS``.
    kinematics
        Has the cylinder.

    Returns
    -------
    Floats
        The last point inside [m], shape (3,).

    Raises
    ------
    ProgramError
        The robot stands at the edge, or beyond it, already.

    """
    way = np.array(DIRECTIONS[direction])
    x, y, z = np.asarray(tcp_m, dtype=np.float64).tolist()
    if way[2]:
        limit = kinematics.workspace_top_m if way[2] > 0.0 else kinematics.workspace_bottom_m
        distance = (limit - z) * way[2]
    else:
        along, across = (x, y) if way[0] else (y, x)
        radius = 0.5 * kinematics.workspace_diameter_m
        chord = np.sqrt(max(radius**2 - across**2, 0.0))
        distance = chord - along * (way[0] + way[1])
    distance -= EDGE_M
    if distance <= 0.0:
        raise ProgramError(
            f'the robot stands at the edge of its workspace: it cannot go further to {direction}'
        )
    return np.asarray(np.array([x, y, z]) + distance * way)
