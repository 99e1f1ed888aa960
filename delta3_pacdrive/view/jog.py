"""Press-and-hold jogging: a held button sends a heartbeat, and the robot stops without it.

The release of a button cannot be detected reliably: the page may be closed, the browser may hang, the network may fail.
Therefore a missing heartbeat counts as release. The motion is then stopped repeatedly until the robot has confirmed it.
While the button is held, each heartbeat sends a velocity, as ``delta3 move servo`` does; the robot also stops by itself
when no more velocities arrive.
"""

import math
from enum import Enum, StrEnum

from delta3_pacdrive.errors import ProgramError, shown

HEARTBEAT_HZ = 20.0
JOG_SPEED_MAX_M_S = 0.25
JOG_LIMITS = {'acceleration_m_s2': 2.0, 'jerk_m_s3': 40.0}  # gentle, because people watch the motion
SILENT_S = 0.25  # without a heartbeat before the button counts as released
STOP_AGAIN_S = 0.1  # between two stop requests for a motion that may still start
DIRECTIONS = {
    '+x': (1.0, 0.0, 0.0),
    '-x': (-1.0, 0.0, 0.0),
    '+y': (0.0, 1.0, 0.0),
    '-y': (0.0, -1.0, 0.0),
    '+z': (0.0, 0.0, 1.0),
    '-z': (0.0, 0.0, -1.0),
}


class JogState(StrEnum):
    """State of a jog."""

    FREE = 'free'  # no motion started
    PRESSED = 'pressed'  # a button is held, the start is about to be sent to the robot
    STARTING = 'starting'  # the start is requested: the robot may move
    MOVING = 'moving'
    REVOKED = 'revoked'  # cancelled before the reply to the start, which may still arrive
    STOPPING = 'stopping'  # cancelled: has to be stopped


class JogEvent(StrEnum):
    """Event of a jog."""

    PRESS = 'press'
    START = 'start'  # the start is sent
    ACCEPT = 'accept'  # the start was accepted
    REFUSE = 'refuse'  # the start was rejected
    LOSE = 'lose'  # the outcome is unknown
    CANCEL = 'cancel'  # the button was released, or the robot is being stopped
    SETTLE = 'settle'  # the stop was confirmed, or there is nothing to stop


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
"""Next state by state and event; other events change nothing."""


class JogAction(Enum):
    """The next action for a jog."""

    NOTHING = 'nothing'
    START = 'start'
    STOP = 'stop'


class Jog:
    """The jog buttons, of which one is active at a time, and the motion started by it."""

    def __init__(self) -> None:
        self.state = JogState.FREE
        self.direction, self.number = '', 0  # of the newest press; results of earlier ones are ignored
        self._held, self._beat_s = '', -math.inf
        self._spent = False  # the button must be released before it starts another motion
        self._asking, self._stop_s = False, -math.inf

    @property
    def velocity(self) -> tuple[float, float, float] | None:
        """Direction of the motion, of length 1; None unless the robot is moved by a button."""
        return DIRECTIONS[self.direction] if self.state is JogState.MOVING else None

    @property
    def may_move(self) -> bool:
        """Whether a jog may be moving the robot."""
        return self.state not in (JogState.FREE, JogState.PRESSED)

    def is_pending(self, number: int) -> bool:
        """Whether a press is the newest one, still held and not started yet."""
        return self.state is JogState.PRESSED and number == self.number

    # buttons ----------------------------------------------------------------------------------------------------------

    def heartbeat(self, direction: str, time_s: float) -> None:
        """Record a heartbeat of a button; another button is ignored until this one is released."""
        if time_s - self._beat_s > SILENT_S:
            self._release()
        if self._held in ('', direction):
            self._held, self._beat_s = direction, time_s

    def cancel(self) -> None:
        """Cancel the motion; the button must be released before it starts another one."""
        self._spent = bool(self._held)
        self._handle(JogEvent.CANCEL)

    def _release(self) -> None:
        self._held, self._spent = '', False
        self._handle(JogEvent.CANCEL)

    def update(self, now_s: float) -> JogAction:
        """Return the next action; ``JogAction.STOP`` must be followed by ``stopped`` or ``unconfirmed``."""
        if now_s - self._beat_s > SILENT_S:
            self._release()
        elif self.state is JogState.FREE and self._held and not self._spent:
            self.direction, self.number = self._held, self.number + 1
            self._handle(JogEvent.PRESS)
            return JogAction.START
        cancelled = self.state in (JogState.REVOKED, JogState.STOPPING)
        if cancelled and not self._asking and now_s >= self._stop_s:
            self._asking = True
            return JogAction.STOP
        return JogAction.NOTHING

    # results ----------------------------------------------------------------------------------------------------------

    def start(self, number: int) -> bool:
        """Record that the start of a press is being sent; False if it must not be sent."""
        pending = self.is_pending(number)
        if pending:
            self._handle(JogEvent.START)
        return pending

    def accepted(self, number: int) -> None:
        """Record that the start was accepted."""
        if number == self.number:
            self._handle(JogEvent.ACCEPT)

    def refused(self, number: int) -> None:
        """Record that a press was rejected."""
        self._fail(number, JogEvent.REFUSE)

    def lost(self, number: int) -> None:
        """Record that the outcome of a press is unknown."""
        self._fail(number, JogEvent.LOSE)

    def _fail(self, number: int, event: JogEvent) -> None:
        if number == self.number:
            # a button released meanwhile may be held again by now
            self._spent = self._spent or self.state in (JogState.PRESSED, JogState.STARTING)
            self._handle(event)

    def stopped(self, now_s: float) -> None:
        """Record that the stop was confirmed, or that there is nothing to stop."""
        self._asking, self._stop_s = False, now_s + STOP_AGAIN_S
        self._handle(JogEvent.SETTLE)

    def unconfirmed(self) -> None:
        """Record that the stop was not confirmed: it is requested again."""
        self._asking, self._stop_s = False, -math.inf

    def _handle(self, event: JogEvent) -> None:
        before, self.state = self.state, TRANSITIONS.get((self.state, event), self.state)
        if self.state is not before:
            self._stop_s = -math.inf


def parse(text: str, numbers: int) -> tuple[str, list[float]]:
    """Return direction and numbers of a command ("+x 10 50"); raises ProgramError."""
    direction, *words = text.split() or ['']
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if direction not in DIRECTIONS or len(values) != numbers or not all(0.0 < v < math.inf for v in values):
        raise ProgramError(
            f'{shown(text)} is not a direction ({", ".join(DIRECTIONS)}) with {numbers} positive numbers'
        )
    return direction, values
