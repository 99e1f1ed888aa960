"""Outputs of a program that wait for the move on which they are due."""

from dataclasses import dataclass, replace

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion.blending import PathSegment, StatementError, name_of
from delta3_pacdrive.motion.curves import COINCIDENT_M, Curve
from delta3_pacdrive.motion.move import EVENT_NAMES
from delta3_pacdrive.motion.planned_move import ROUNDING_S, Event, PlannedMove, TimedEvent
from delta3_pacdrive.motion.program import Output


@dataclass(frozen=True)
class Due:
    """An output that is due near the end of a move.

    Attributes
    ----------
    output
        What changes.
    number, name
        Of its statement.
    count
        How many segments of the present move are before it: 0, if the move before it is over.
    left_s
        Of the time after the end of the move before it [s].

    """

    output: Output
    number: int
    name: str
    count: int = 0
    left_s: float = 0.0

    @property
    def is_later(self) -> bool:
        """Whether it is due after the end of the move before it."""
        return self.output.after_m > 0.0 or self.left_s > 0.0

    @property
    def is_timed(self) -> bool:
        """Whether it is due a time before or after the end of the move before it."""
        return self.left_s > 0.0 or self.output.before_s > 0.0

    @property
    def is_shifted(self) -> bool:
        """Whether its place follows from what is around it."""
        return self.is_later or self.is_timed

    def at(self, distance_m: float) -> Event:
        """Return it as an event at a distance on a move [m]."""
        output = self.output
        return Event(distance_m, EVENT_NAMES.index(output.name), output.value, output.payload_kg)

    def timed(self, planned: PlannedMove, anchor_m: float) -> TimedEvent:
        """Return it as an event at a time before or after a place on a move; raises StatementError if not on it."""
        shift_s = self.left_s - self.output.before_s
        event = TimedEvent(anchor_m, shift_s, EVENT_NAMES.index(self.output.name), self.output.value)
        time_s = event.time_s(planned.move)
        if time_s < -ROUNDING_S:
            raise StatementError(
                self.number,
                f'{self.name}: {self.output.before_s:g} s before the end of the move before it lies before the start '
                f'of {planned.name}, which is only {time_s - shift_s:.4g} s earlier',
            )
        if time_s > planned.move.duration_s + ROUNDING_S:
            raise StatementError(
                self.number,
                f'{self.name}: {self.output.after_s:g} s after the end of the move before it lies behind the end of '
                f'{planned.name}, which takes {planned.move.duration_s:.4g} s',
            )
        return event


class DueOutputs:
    """Outputs that wait for the move on which they are due, in the order of the program."""

    def __init__(self) -> None:
        self._dues: list[Due] = []

    def __len__(self) -> int:
        """Return how many wait."""
        return len(self._dues)

    def add(self, due: Due) -> None:
        """Let an output wait."""
        self._dues.append(due)

    def clear(self) -> None:
        """Forget all."""
        self._dues = []

    @property
    def before_the_first(self) -> int:
        """How many stand before the first segment of the present move."""
        return sum(1 for due in self._dues if not due.count)

    @property
    def any_shifted(self) -> bool:
        """Whether the place of any of them follows from what is around it."""
        return any(due.is_shifted for due in self._dues)

    def now(self) -> list[Due]:
        """Take out those that are due where the next move begins; raises ProgramError if that is too late for one."""
        taken = [due for due in self._dues if not due.is_later]
        if any(due.output.before_m > 0.0 for due in taken):
            raise ProgramError('before_m of an output needs a move right before it')
        self._dues = [due for due in self._dues if due.is_later]
        return taken

    def in_dwell(self, time_s: float) -> list[tuple[float, Due]]:
        """Take out those that are due in a dwell, with their times in it [s]; the others have less time left.

        What is due at its end is due where the next move begins.
        """
        taken, left = [], []
        for due in self._dues:
            if due.left_s <= 0.0 or due.output.after_m > 0.0:
                left.append(due)
            elif due.left_s < time_s - ROUNDING_S:
                taken.append((due.left_s, due))
            else:
                over_s = due.left_s - time_s
                left.append(replace(due, left_s=over_s if over_s > ROUNDING_S else 0.0))
        self._dues = left
        return taken

    def in_time(self) -> list[Due]:
        """Take out those that are due on a move whose path is one over time; raises StatementError for a distance."""
        taken, self._dues = self._dues, []
        for due in taken:
            if due.output.after_m > 0.0:
                raise StatementError(due.number, f'{due.name}: after_m needs a move along a path behind it')
        return taken

    def on_path(
        self, segments: list[PathSegment], ends: list[float], curve: Curve, waits: bool
    ) -> tuple[list[Event], list[tuple[Due, float]]]:
        """Take out those that are due on a move along a path: events, and those at a time, with their anchors [m].

        What is due behind its end goes on waiting, and so does what is due at its end if the robot ``waits`` there.
        """
        anchors: list[tuple[Due, float]] = []
        left = []
        for due in self._dues:
            in_position = waits and due.output.before_m == due.output.before_s == 0.0
            if due.count == len(segments) and (due.is_later or in_position):
                left.append(replace(due, count=0))
            else:
                anchors.append((due, ends[due.count - 1] if due.count else 0.0))
        self._dues = left
        events = [
            due.at(_distance(due, end_m, curve, segments)) for due, end_m in anchors if not due.is_timed
        ]
        return events, [(due, end_m) for due, end_m in anchors if due.is_timed]

    def require_none_later(self) -> None:
        """Refuse what is due after the last move; raises StatementError."""
        for due in self._dues:
            if due.is_later:
                key = 'after_m' if due.output.after_m else 'after_s'
                raise StatementError(
                    due.number,
                    f'{due.name}: {key} needs moves behind it that reach as far, the program ends before',
                )


def _distance(due: Due, end_m: float, curve: Curve, segments: list[PathSegment]) -> float:
    """Return where on a move an output is due [m]; raises StatementError if that is not on it."""
    output = due.output
    if output.before_m > 0.0 and due.count == 0:
        raise StatementError(due.number, f'{due.name}: before_m of an output needs a move right before it')
    distance = end_m - output.before_m + output.after_m
    if output.after_m > 0.0 and distance > curve.length_m + COINCIDENT_M:
        raise StatementError(
            due.number,
            f'{due.name}: {output.after_m:g} m after the end of the move before it lies behind the end of '
            f'{name_of(segments)}, {distance - curve.length_m:.4g} m further',
        )
    if output.after_m == 0.0 and not -COINCIDENT_M <= distance <= curve.length_m:
        before = segments[due.count - 1]
        raise StatementError(
            before.number,
            f'{before.name}: an output {output.before_m:g} m before its end would lie before the '
            f'start of the move, which is {curve.length_m:.4g} m long',
        )
    return max(distance, 0.0)
