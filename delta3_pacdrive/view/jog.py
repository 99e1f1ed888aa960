"""Press-and-hold jogging: a button that is held says so again and again, and the robot stops when it does not.

Nothing tells reliably that a button was let go: the page may be closed, the browser may hang, the network may be gone.
So the button beats like a heart while it is held, and silence is the release. What was set off is then stopped until
the robot has answered that, whatever else goes wrong meanwhile.
"""

import math
from enum import Enum, StrEnum

import numpy as np

from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Kinematics

BEATS_HZ = 20.0
JOG_ACCELERATION_M_S2, JOG_JERK_M_S3 = 2.0, 40.0  # gentle: people look at what they move
SILENT_S = 0.25  # without a beat, after which the button is taken for released
STOP_AGAIN_S = 0.1  # between two stops of what may be about to start
EDGE_M = 1e-4  # by which a jog stays away from the edge of the workspace
DIRECTIONS = {
    '+x': (1.0, 0.0, 0.0),
    '-x': (-1.0, 0.0, 0.0),
    '+y': (0.0, 1.0, 0.0),
    '-y': (0.0, -1.0, 0.0),
    '+z': (0.0, 0.0, 1.0),
    '-z': (0.0, 0.0, -1.0),
}


class JogState(StrEnum):
    """How far a jog is."""

    FREE = 'free'  # nothing was set off
    PRESSED = 'pressed'  # a button is held, its line is on its way to the robot
    STARTING = 'starting'  # the start is asked for: from here on the robot may move
    MOVING = 'moving'
    REVOKED = 'revoked'  # given up before the start was answered, which may still come
    STOPPING = 'stopping'  # given up: to be stopped


class JogEvent(StrEnum):
    """What happens to a jog."""

    PRESS = 'press'
    START = 'start'  # the start goes out
    ACCEPT = 'accept'  # it was accepted
    REFUSE = 'refuse'  # the line, or its start, was refused
    LOSE = 'lose'  # nobody knows what became of it
    CANCEL = 'cancel'  # the button was let go, or somebody stops the robot
    SETTLE = 'settle'  # the stop was answered, or there is nothing left to be stopped


TRANSITIONS = {
    (JogState.FREE, JogEvent.PRESS): JogState.PRESSED,
    (JogState.PRESSED, JogEvent.START): JogState.STARTING,
    (JogState.PRESSED, JogEvent.REFUSE): JogState.FREE,
    (JogState.PRESSED, JogEvent.LOSE): JogState.FREE,
    (JogState.PRESSED, JogEvent.CANCEL): JogState.FREE,
    (JogState.STARTING, JogEvent.ACCEPT): JogState.MOVING,
    (JogState.STARTING, JogEvent.REFUSE): JogState.FREE,
    (JogState.STARTING, JogEvent.LOSE): JogState.STOPPING,
    (JogState.STARTING, JogEvent.CANCEL): JogState.REVOKED,
    (JogState.MOVING, JogEvent.CANCEL): JogState.STOPPING,
    (JogState.REVOKED, JogEvent.ACCEPT): JogState.STOPPING,
    (JogState.REVOKED, JogEvent.REFUSE): JogState.FREE,
    (JogState.REVOKED, JogEvent.LOSE): JogState.STOPPING,
    (JogState.STOPPING, JogEvent.SETTLE): JogState.FREE,
}
"""Where an event leads from a state; what is not listed changes nothing."""


class Turn(Enum):
    """What there is to do for a jog."""

    NOTHING = 'nothing'
    SET_OFF = 'set off'
    STOP = 'stop'


class Jog:
    """The buttons of all directions, of which one counts at a time, and what was set off by it.

    Attributes
    ----------
    state
        How far the jog is.
    direction
        Of the newest press.
    number
        Of the newest press; what becomes of an earlier one does not matter any more.

    """

    def __init__(self) -> None:
        self.state = JogState.FREE
        self.direction, self.number = '', 0
        self._held, self._beat_s = '', -math.inf
        self._spent = False  # whether the button has to be let go before it counts again
        self._asking, self._stop_s = False, -math.inf

    @property
    def may_move(self) -> bool:
        """Whether the robot may be moving because of it."""
        return self.state not in (JogState.FREE, JogState.PRESSED)

    def wants(self, number: int) -> bool:
        """Whether a press is the newest one, its button is held, and it was not set off yet."""
        return self.state is JogState.PRESSED and number == self.number

    # buttons ----------------------------------------------------------------------------------------------------------

    def beat(self, direction: str, time_s: float) -> None:
        """Take note that a button was held at a time; another one counts only when this one is released."""
        if time_s - self._beat_s > SILENT_S:
            self._let_go()
        if self._held in ('', direction):
            self._held, self._beat_s = direction, time_s

    def drop(self) -> None:
        """Give the motion up: the button has to be let go before it counts again."""
        self._spent = bool(self._held)
        self._happen(JogEvent.CANCEL)

    def _let_go(self) -> None:
        self._held, self._spent = '', False
        self._happen(JogEvent.CANCEL)

    def look(self, now_s: float) -> Turn:
        """Say what there is to do; a stop that is asked for ends with ``stopped`` or ``unheard``."""
        if now_s - self._beat_s > SILENT_S:
            self._let_go()
        elif self.state is JogState.FREE and self._held and not self._spent:
            self.direction, self.number = self._held, self.number + 1
            self._happen(JogEvent.PRESS)
            return Turn.SET_OFF
        given_up = self.state in (JogState.REVOKED, JogState.STOPPING)
        if given_up and not self._asking and now_s >= self._stop_s:
            self._asking = True
            return Turn.STOP
        return Turn.NOTHING

    # what becomes of it -----------------------------------------------------------------------------------------------

    def start(self, number: int) -> bool:
        """Take note that the start of a press goes out now; False if it must not."""
        wanted = self.wants(number)
        if wanted:
            self._happen(JogEvent.START)
        return wanted

    def accepted(self, number: int) -> None:
        """Take note that the start was accepted."""
        if number == self.number:
            self._happen(JogEvent.ACCEPT)

    def refused(self, number: int) -> None:
        """Take note that nothing comes of a press."""
        self._fail(number, JogEvent.REFUSE)

    def lost(self, number: int) -> None:
        """Take note that nobody knows what has come of a press."""
        self._fail(number, JogEvent.LOSE)

    def _fail(self, number: int, event: JogEvent) -> None:
        if number == self.number:
            # who was let go meanwhile may be held anew by now
            self._spent = self._spent or self.state in (JogState.PRESSED, JogState.STARTING)
            self._happen(event)

    def stopped(self, now_s: float) -> None:
        """Take note that the stop was answered: the robot stops, or there is nothing to be stopped."""
        self._asking, self._stop_s = False, now_s + STOP_AGAIN_S
        self._happen(JogEvent.SETTLE)

    def unheard(self) -> None:
        """Take note that nobody has answered the stop: it is asked for again."""
        self._asking, self._stop_s = False, -math.inf

    def _happen(self, event: JogEvent) -> None:
        before, self.state = self.state, TRANSITIONS.get((self.state, event), self.state)
        if self.state is not before:
            self._stop_s = -math.inf


def parse(text: str, numbers: int) -> tuple[str, list[float]]:
    """Return the direction and the numbers that a page asks for ("+x 10 50"); raises ProgramError."""
    direction, *words = text.split() or ['']
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if direction not in DIRECTIONS or len(values) != numbers or not all(0.0 < v < math.inf for v in values):
        raise ProgramError(
            f'{shown(text)} is no direction ({", ".join(DIRECTIONS)}) with {numbers} positive numbers'
        )
    return direction, values


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
    if not distance > 0.0:
        raise ProgramError(
            f'the robot stands at the edge of its workspace: it cannot go further to {direction}'
        )
    return np.asarray(np.array([x, y, z]) + distance * way)
