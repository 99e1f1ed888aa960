"""Steering by a script: set points of the TCP, checked before they are sent, and recorded ones.

A CSV file of recorded set points has one row for each, and one of two headings:

    time_s,vx_m_s,vy_m_s,vz_m_s
    time_s,x_m,y_m,z_m

A bag has ``servo/twist`` or ``servo/pose`` of one robot; the time of a set point is its stamp. The frame of a velocity
is ``base`` or the name of a belt.
"""

import csv
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from delta3_pacdrive.belts.synchronization import Vector
from delta3_pacdrive.control.cycle.set_points import SetPoint, SetPointKind, SetPointStream
from delta3_pacdrive.errors import ProgramError, RefusedError, TraceError, shown
from delta3_pacdrive.recording.bag_messages import typestore
from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS
from delta3_pacdrive.scripting.link import Link

HEADINGS = {
    ('time_s', 'vx_m_s', 'vy_m_s', 'vz_m_s'): SetPointKind.VELOCITY,
    ('time_s', 'x_m', 'y_m', 'z_m'): SetPointKind.POSITION,
}
TOPICS = {
    'servo/twist': (SetPointKind.VELOCITY, 'geometry_msgs/msg/TwistStamped'),
    'servo/pose': (SetPointKind.POSITION, 'geometry_msgs/msg/PoseStamped'),
}
BASE = 'base'


@dataclass(frozen=True)
class RecordedSetPoint:
    """A set point, its time since the first one [s], and the belt that it is relative to, empty: none."""

    time_s: float
    kind: SetPointKind
    values: Vector  # velocity [m/s] or position [m]
    belt: str = ''


class Steering:
    """Interface of a script to a steered robot, between the begin and the end of ``Robot.servo``.

    ``call`` executes a request and converts its errors to those of the script; ``wait`` waits for a time [s].
    """

    def __init__(
        self, link: Link, call: Callable[[Callable[[], None]], None], wait: Callable[[float], None]
    ) -> None:
        self._link, self._call, self._wait = link, call, wait
        self._stream = SetPointStream()  # the same checks as in the controller, which does not answer

    def velocity(self, x_m_s: float, y_m_s: float, z_m_s: float, belt: str = '') -> None:
        """Move the TCP with a velocity [m/s], relative to a belt if named; it counts for at most 0.3 s."""
        self._call(lambda: self._send(SetPointKind.VELOCITY, (x_m_s, y_m_s, z_m_s), self._number_of(belt)))

    def position(self, x_m: float, y_m: float, z_m: float) -> None:
        """Move the TCP along the curve of the positions [m] given so far, of which this is the newest."""
        self._call(lambda: self._send(SetPointKind.POSITION, (x_m, y_m, z_m), -1))

    def play(self, path: str | Path) -> None:
        """Send the set points of a CSV file or bag as described above at their times."""
        points: list[RecordedSetPoint] = []
        self._call(lambda: points.extend(read(path)))
        begin_s, cycle_time_s = self._next_s, self._link.parameters.bus.cycle_time_s
        for point in points:
            time_s = begin_s + point.time_s
            left_s = time_s - self._next_s
            if left_s > 0.5 * cycle_time_s:
                self._wait(left_s)
            self._call(partial(self._play, point, time_s))

    def _play(self, point: RecordedSetPoint, time_s: float) -> None:
        self._send(point.kind, point.values, self._number_of(point.belt), time_s)

    @property
    def _next_s(self) -> float:
        """Bus time of the cycle in which the next set point is taken [s]."""
        parameters = self._link.parameters
        return (self._link.poll().cycle + parameters.decision_cycles) * parameters.bus.cycle_time_s

    def _number_of(self, belt: str) -> int:
        names = [one.name for one in self._link.tracking.belts]
        if belt and belt not in names:
            raise ProgramError(
                f'velocity: unknown belt {shown(belt)}, the belts are: {", ".join(names) or "none"}'
            )
        return names.index(belt) if belt else -1

    def _send(self, kind: SetPointKind, values: Vector, belt: int, time_s: float | None = None) -> None:
        """Send a set point for a bus time [s], by default that of the cycle in which it is taken."""
        parameters = self._link.parameters
        cycle = self._link.poll().cycle + parameters.decision_cycles
        taken_s = cycle * parameters.bus.cycle_time_s
        x, y, z = (float(value) for value in values)
        point = SetPoint(kind, taken_s if time_s is None else time_s, (x, y, z), belt)
        reason = self._stream.take(point, taken_s)
        if reason is not None:
            raise RefusedError(reason)
        self._link.set_point(cycle, point)


def read(path: str | Path) -> list[RecordedSetPoint]:
    """Return the set points of a CSV file or bag in the order of their times.

    Raises
    ------
    ProgramError
        The file cannot be read, or has no set points, or one that is not valid.

    """
    path = Path(path)
    try:
        points = _of_bag(path) if path.is_dir() or path.suffix in ('.mcap', '.db3') else _of_csv(path)
    except OSError as error:
        raise ProgramError(f'{path} cannot be read: {error.strerror}') from None
    except (TraceError, UnicodeDecodeError, csv.Error) as error:
        raise ProgramError(f'{path} cannot be read: {error}') from None
    if not points:
        raise ProgramError(f'{path} has no set points: neither rows nor messages of {" or ".join(TOPICS)}')
    return points


def _of_csv(path: Path) -> list[RecordedSetPoint]:
    with path.open(newline='', encoding='utf-8-sig') as file:
        rows = csv.reader(file)
        heading = tuple(word.strip() for word in next(rows, []))
        if heading not in HEADINGS:
            known = ' or '.join(','.join(known) for known in HEADINGS)
            raise ProgramError(
                f'{path}, line 1: the heading is {shown(",".join(heading))}, but must be {known}'
            )
        found: list[RecordedSetPoint] = []
        first = 0.0
        for row in rows:
            if not row:
                continue
            place = f'{path}, line {rows.line_num}'
            time_s, *values = _numbers(row, len(heading), place)
            first = first if found else time_s
            if found and time_s - first <= found[-1].time_s:
                raise ProgramError(
                    f'{place}: time_s is {time_s:g}, which is not after that of the row before'
                )
            x, y, z = values
            found.append(RecordedSetPoint(time_s - first, HEADINGS[heading], (x, y, z)))
        return found


def _numbers(row: list[str], count: int, place: str) -> list[float]:
    try:
        values = [float(word) for word in row]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise ProgramError(f'{place}: {shown(",".join(row))} is not a row of {count} finite numbers')
    return values


def _of_bag(path: Path) -> list[RecordedSetPoint]:
    from delta3_pacdrive.recording.bags.bag_files import files_of, open_file  # loads rosbags

    stores = [open_file(file) for file in files_of(path, {})[0]]
    topics = {
        channel.topic: TOPICS[name]
        for store in stores
        for channel in store.channels
        for name in TOPICS
        if channel.msgcount and f'/{channel.topic}'.endswith(f'/{name}')
    }
    robots = {topic.removesuffix(name) for topic in topics for name in TOPICS if topic.endswith(name)}
    if len(robots) > 1:
        raise ProgramError(f'{path} has set points of several robots: {", ".join(sorted(topics))}')
    found: list[tuple[int, SetPointKind, Vector, str]] = []

    def take(kind: SetPointKind, name: str, data: bytes) -> None:
        found.append(_of_message(data, kind, name))

    for store in stores:
        store.read({topic: partial(take, *known) for topic, known in topics.items()})
    found.sort(key=lambda one: one[0])
    first = found[0][0] if found else 0
    return [
        RecordedSetPoint((stamp_ns - first) / NANOSECONDS, kind, values, belt)
        for stamp_ns, kind, values, belt in found
    ]


def _of_message(data: bytes, kind: SetPointKind, name: str) -> tuple[int, SetPointKind, Vector, str]:
    message: Any = typestore().deserialize_cdr(data, name)
    header = message.header
    vector = message.twist.linear if kind is SetPointKind.VELOCITY else message.pose.position
    frame = '' if header.frame_id in ('', BASE) else header.frame_id
    stamp_ns = header.stamp.sec * NANOSECONDS + header.stamp.nanosec
    return stamp_ns, kind, (vector.x, vector.y, vector.z), frame
