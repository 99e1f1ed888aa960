"""Steering by a script: set points of the TCP, checked before they are sent."""

from collections.abc import Callable

from delta3_pacdrive.belts.synchronization import Vector
from delta3_pacdrive.control.cycle.set_points import SetPoint, SetPointKind, SetPointStream
from delta3_pacdrive.errors import ProgramError, RefusedError, shown
from delta3_pacdrive.scripting.link import Link


class Steering:
    """Interface of a script to a steered robot, between the begin and the end of ``Robot.servo``.

    ``call`` executes a request and converts its errors to those of the script.
    """

    def __init__(self, link: Link, call: Callable[[Callable[[], None]], None]) -> None:
        self._link, self._call = link, call
        self._stream = SetPointStream()  # the same checks as in the controller, which does not answer

    def velocity(self, x_m_s: float, y_m_s: float, z_m_s: float, belt: str = '') -> None:
        """Move the TCP with a velocity [m/s], relative to a belt if named; it counts for at most 0.3 s."""
        self._call(lambda: self._send(SetPointKind.VELOCITY, (x_m_s, y_m_s, z_m_s), self._number_of(belt)))

    def position(self, x_m: float, y_m: float, z_m: float) -> None:
        """Move the TCP along the curve of the positions [m] given so far, of which this is the newest."""
        self._call(lambda: self._send(SetPointKind.POSITION, (x_m, y_m, z_m), -1))

    def _number_of(self, belt: str) -> int:
        names = [one.name for one in self._link.tracking.belts]
        if belt and belt not in names:
            raise ProgramError(
                f'velocity: unknown belt {shown(belt)}, the belts are: {", ".join(names) or "none"}'
            )
        return names.index(belt) if belt else -1

    def _send(self, kind: SetPointKind, values: Vector, belt: int) -> None:
        parameters = self._link.parameters
        cycle = self._link.poll().cycle + parameters.decision_cycles
        time_s = cycle * parameters.bus.cycle_time_s
        x, y, z = (float(value) for value in values)
        point = SetPoint(kind, time_s, (x, y, z), belt)
        reason = self._stream.take(point, time_s)
        if reason is not None:
            raise RefusedError(reason)
        self._link.set_point(cycle, point)
