"""``delta3 move servo``: steer the running robot with the keyboard."""

import json
import os
import select
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from delta3_pacdrive.errors import ProgramError, RunError
from delta3_pacdrive.numerics.units import millimetres

if TYPE_CHECKING:
    from delta3_pacdrive.ros.clients.robot_client import OperatorNode

Direction = tuple[float, float, float]
AHEAD, BACK, LEFT, RIGHT, UP, DOWN = (
    (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
)  # fmt: skip
DIRECTIONS: dict[str, Direction] = {
    'w': AHEAD, 's': BACK, 'a': LEFT, 'd': RIGHT, 'r': UP, 'f': DOWN,
    '\x1b[A': AHEAD, '\x1b[B': BACK, '\x1b[D': LEFT, '\x1b[C': RIGHT, '\x1b[5~': UP, '\x1b[6~': DOWN,
}  # fmt: skip
QUIT = ('q', '\x04', '')  # also the end of the input
HELP = 'w/s or up/down: x; a/d or left/right: y; r/f or page up/down: z; +/-: speed; space: stop; q: end'
# a terminal reports no release of a key: the first press counts until keys repeat, then each until the next
FIRST_S, REPEATED_S = 0.6, 0.15
SPEED_M_S, FASTER, SPEED_MIN_M_S = 0.1, 1.25, 0.001
PERIOD_S = 0.02  # of the set points
SHOW_EVERY = 10  # set points


class Keyboard:
    """Velocity of the TCP [m/s] by the keys pressed; ``speed_max_m_s`` is the largest speed."""

    def __init__(self, speed_m_s: float, speed_max_m_s: float) -> None:
        self.speed_m_s, self._speed_max_m_s = min(speed_m_s, speed_max_m_s), speed_max_m_s
        self._key, self._until_s = '', 0.0

    def press(self, key: str, now_s: float) -> bool:
        """Take a key at a time [s]; return whether it ends the steering."""
        if key in QUIT:
            return True
        if key in DIRECTIONS:
            repeated = key == self._key and now_s < self._until_s
            self._key, self._until_s = key, now_s + (REPEATED_S if repeated else FIRST_S)
        elif key == ' ':
            self._key = ''
        elif key in '+-':
            factor = FASTER if key == '+' else 1.0 / FASTER
            self.speed_m_s = min(max(factor * self.speed_m_s, SPEED_MIN_M_S), self._speed_max_m_s)
        return False

    def velocity(self, now_s: float) -> Direction:
        """Return the velocity at a time [s]."""
        if not self._key or now_s >= self._until_s:
            return (0.0, 0.0, 0.0)
        x, y, z = DIRECTIONS[self._key]
        return self.speed_m_s * x, self.speed_m_s * y, self.speed_m_s * z


def keys_of(text: str) -> Iterator[str]:
    """Yield the keys in the input of a terminal: characters, and sequences such as that of an arrow."""
    while text:
        known = next((key for key in DIRECTIONS if len(key) > 1 and text.startswith(key)), text[0])
        yield known
        text = text[len(known) :]


@contextmanager
def _keys(file: int) -> Iterator[Callable[[], list[str]]]:
    """Read keys without echo and without waiting; the function returns those pressed since the last call."""
    before = termios.tcgetattr(file)

    def read() -> list[str]:
        ready, _, _ = select.select([file], [], [], 0.0)
        if not ready:
            return []
        text = os.read(file, 1024).decode(errors='replace')
        return list(keys_of(text)) or ['']

    tty.setcbreak(file)
    try:
        yield read
    finally:
        termios.tcsetattr(file, termios.TCSADRAIN, before)


def require_terminal() -> None:
    """Raise ProgramError unless the input is a terminal."""
    if not sys.stdin.isatty():
        raise ProgramError('move servo reads keys and needs a terminal')


def steer(operator: 'OperatorNode', limits: dict[str, float], report: Callable[[str], None]) -> None:
    """Steer the robot with the keyboard until the user or the robot ends it; raises RunError, RefusedError."""
    from delta3_pacdrive.control.messages import END_STEERING, STEER
    from delta3_pacdrive.control.motion_state import MotionState
    from delta3_pacdrive.ros.wire import interfaces

    speed_max = limits.get('speed_m_s', SPEED_M_S)
    keyboard = Keyboard(SPEED_M_S, speed_max)
    send = operator.velocities()
    rejections: list[str] = []
    interfaces.SERVO_STATE.subscription(operator, lambda message: rejections.append(message.message))
    report(operator.ask('control', STEER, json.dumps(limits | {'speed_m_s': speed_max})))
    operator.wait_until(lambda: operator.state == MotionState.STEERED, 'motion/state')
    report(HELP)
    try:
        with _keys(sys.stdin.fileno()) as pressed:
            sent = 0
            while True:
                now_s = time.monotonic()
                ends = [keyboard.press(key, now_s) for key in pressed()]
                if any(ends):
                    return
                if operator.state != MotionState.STEERED:
                    raise RunError(f'the steering has ended: the robot is {operator.state}')
                send(*keyboard.velocity(now_s))
                sent += 1
                if sent % SHOW_EVERY == 0:
                    _show(operator, keyboard, rejections[-1] if rejections else '')
                operator.spin_for(PERIOD_S)
    finally:
        print(file=sys.stderr)
        operator.interruptible = False
        with suppress(RunError, ProgramError):  # the robot may have ended the steering itself
            report(operator.ask('control', END_STEERING))


def _show(operator: 'OperatorNode', keyboard: Keyboard, rejection: str) -> None:
    """Show speed and position in one line of the terminal."""
    place = operator.progress.tcp_m
    text = f'{keyboard.speed_m_s:.3f} m/s' + (f', TCP at {millimetres(place)}' if place else '')
    print(f'\r{text}{": " if rejection else ""}{rejection}\x1b[K', end='', file=sys.stderr, flush=True)
