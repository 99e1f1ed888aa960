"""The end of a robot that is up: its drives stop in a controlled way, and close their brakes, before all else ends."""

import math
from collections.abc import Callable
from typing import Any, Protocol

NEWS = 2  # times it has to tell how it is after it has answered: the first may have been on its way
FRESH_S = 1.0  # for the next report of a robot that comes up
SILENCE_S = 4.0  # without a report, after which a braking robot is given up; 2.4 s occur at load 20
STOP_TIMEOUT_S = 5.0  # for the drives to brake, before the processes end: they are slow where their clock is
STOP_WALL_S = 15.0  # all in all: on a machine that is busy a look takes much longer than it should


class Driven(Protocol):
    """What is known of a robot that is up, and how its drives are disabled."""

    @property
    def progress(self) -> dict[str, Any]:
        """The newest progress that it has told."""

    def can_disable(self) -> bool:
        """Whether a request to disable the drives would reach it."""

    def disable(self) -> Callable[[], bool]:
        """Ask it to disable its drives; return what says whether it has answered that it will."""


def brake(
    robot: Driven,
    spin_for: Callable[[float], None],
    look_s: float,
    is_over: Callable[[], bool] = lambda: False,
) -> None:
    """Disable the drives of a robot and wait, for a bounded time, until it says that they are without torque.

    What it has told last may be older than that: a robot that has just come up may have been enabled since, and moved.

    Parameters
    ----------
    robot
        The robot.
    spin_for, look_s
        Lets it tell what it has to tell for some seconds; how long at a time. Patience counts these seconds: they are
        longer on a machine that is busy.
    is_over
        Returns whether there is no more time to wait.

    """

    def spin_until(done: Callable[[], bool], patience_s: float, silence_s: float = math.inf) -> None:
        waited_s, silent_s, newest = 0.0, 0.0, robot.progress
        while not (done() or is_over()) and waited_s < patience_s and silent_s < silence_s:
            spin_for(look_s)
            waited_s, silent_s = waited_s + look_s, silent_s + look_s
            if robot.progress is not newest:
                newest, silent_s = robot.progress, 0.0

    told = robot.progress
    if not _is_up(told):
        spin_until(lambda: robot.progress is not told, FRESH_S)
    if not _is_up(robot.progress):
        return
    spin_until(robot.can_disable, FRESH_S)
    if not robot.can_disable():
        return
    answered, seen = robot.disable(), [robot.progress]

    def is_without_torque() -> bool:
        if not answered():
            seen[:] = [robot.progress]
        elif robot.progress is not seen[-1]:
            seen.append(robot.progress)
        return len(seen) > NEWS and not robot.progress.get('in_torque')

    spin_until(is_without_torque, STOP_TIMEOUT_S, SILENCE_S)


def _is_up(progress: dict[str, Any]) -> bool:
    return progress.get('phase') == 'CP4'
