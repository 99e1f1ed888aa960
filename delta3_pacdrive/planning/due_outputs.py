"""Outputs of a program that are pending until the move on which they are due is planned."""

from dataclasses import dataclass, replace

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.paths.curves import COINCIDENT_M, Curve
from delta3_pacdrive.planning.paths.move import EVENT_NAMES
from delta3_pacdrive.planning.planned_move import ROUNDING_S, Event, PlannedMove, TimedEvent
from delta3_pacdrive.planning.program.model import Output
from delta3_pacdrive.planning.timing.blending import PathSegment, StatementError, name_of


@dataclass(frozen=True)
class Due:
    """An output that is due relative to the end of the previous move."""

    output: Output
    number: int  # of its statement
    name: str
    count: int = 0  # number of preceding segments in the current move; 0: the previous move is complete
    left_s: float = 0.0  # remaining time after the end of the previous move

    @property
    def is_later(self) -> bool:
        """Whether it is due after the end of the previous move."""
        return self.output.after_m > 0.0 or self.left_s > 0.0

    @property
    def is_timed(self) -> bool:
        """Whether it is due at a time before or after the end of the previous move."""
        return self.left_s > 0.0 or self.output.before_s > 0.0

    @property
    def is_shifted(self) -> bool:
        """Whether its position depends on the neighbouring moves."""
        return self.is_later or self.is_timed

    def at(self, distance_m: float) -> Event:
        """Return an event at a distance on a move [m]."""
        output = self.output
        return Event(distance_m, EVENT_NAMES.index(output.name), output.value, output.payload_kg)

    def timed(self, planned: PlannedMove, anchor_m: float) -> TimedEvent:
        """Return an event at a time before or after a position on a move; raises StatementError if not on the move."""
        shift_s = self.left_s - self.output.before_s
        event = TimedEvent(anchor_m, shift_s, EVENT_NAMES.index(self.output.name), self.output.value)
        time_s = event.time_s(planned.move)
        if time_s < -ROUNDING_S:
            raise StatementError(
                self.number,
                f'{self.name}: {self.output.before_s:g} s before the end of the previous move is before the start '
                f'of {planned.name}, which is only {time_s - shift_s:.4g} s earlier',
            )
        if time_s > planned.move.duration_s + ROUNDING_S:
            raise StatementError(
                self.number,
                f'{self.name}: {self.output.after_s:g} s after the end of the previous move is after the end of '
                f'{planned.name}, which takes {planned.move.duration_s:.4g} s',
            )
        return event


class DueOutputs:
    """Pending outputs in program order."""

    def __init__(self) -> None:
        self._dues: list[Due] = []

    def __len__(self) -> int:
        """Return the number of pending outputs."""
        return len(self._dues)

    def add(self, due: Due) -> None:
        """Append an output."""
        self._dues.append(due)

    def clear(self) -> None:
        """Discard all outputs."""
        self._dues = []

    @property
    def before_the_first(self) -> int:
        """Number of outputs before the first segment of the current move."""
        return sum(1 for due in self._dues if not due.count)

    @property
    def any_shifted(self) -> bool:
        """Whether the position of any output depends on the neighbouring moves."""
        return any(due.is_shifted for due in self._dues)

    def now(self) -> list[Due]:
        """Remove and return the outputs due at the start of the next move; raises ProgramError if one is too late."""
        taken = [due for due in self._dues if not due.is_later]
        if any(due.output.before_m > 0.0 for due in taken):
            raise ProgramError('before_m of an output needs a move right before it')
        self._dues = [due for due in self._dues if due.is_later]
        return taken

    def in_dwell(self, time_s: float) -> list[tuple[float, Due]]:
        """Remove and return the outputs due during a dwell, with their times in it [s].

        The remaining time of the others is reduced. Outputs due at the end of the dwell are due at the next start.
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
        """Remove and return the outputs due on a move parametrised by time; raises StatementError for a distance."""
        taken, self._dues = self._dues, []
        for due in taken:
            if due.output.after_m > 0.0:
                raise StatementError(
                    due.number, f'{due.name}: after_m must be followed by a move along a path'
                )
        return taken

    def on_path(
        self, segments: list[PathSegment], ends: list[float], curve: Curve, waits: bool
    ) -> tuple[list[Event], list[tuple[Due, float]]]:
        """Remove and return the outputs due on a path: events by distance, and timed outputs with their anchors [m].

        Outputs due after the end stay pending; so do those due at the end if the robot ``waits`` there.
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
        """Raise StatementError if an output is due after the last move."""
        for due in self._dues:
            if due.is_later:
                key = 'after_m' if due.output.after_m else 'after_s'
                raise StatementError(
                    due.number,
                    f'{due.name}: {key} exceeds the moves that follow, the program ends before',
                )


def _distance(due: Due, end_m: float, curve: Curve, segments: list[PathSegment]) -> float:
    """Return the distance on a move at which an output is due [m]; raises StatementError if it is not on the move."""
    output = due.output
    if output.before_m > 0.0 and due.count == 0:
        raise StatementError(due.number, f'{due.name}: before_m of an output needs a move right before it')
    distance = end_m - output.before_m + output.after_m
    if output.after_m > 0.0 and distance > curve.length_m + COINCIDENT_M:
        raise StatementError(
            due.number,
            f'{due.name}: {output.after_m:g} m after the end of the previous move is after the end of '
            f'{name_of(segments)}, {distance - curve.length_m:.4g} m further',
        )
    if output.after_m == 0.0 and not -COINCIDENT_M <= distance <= curve.length_m:
        before = segments[due.count - 1]
        raise StatementError(
            before.number,
            f'{before.name}: an output {output.before_m:g} m before its end would be before the '
            f'start of the move, which is {curve.length_m:.4g} m long',
        )
    return max(distance, 0.0)
