"""Log of the moves and output changes that a script has executed, in bus cycles."""

from typing import Any

from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.paths.move import OUTPUTS, UNCHANGED
from delta3_pacdrive.planning.plan_times import path_length_m


class MotionLog:
    """The log of one script, updated with every change of the timeline."""

    def __init__(self, cycle_time_s: float) -> None:
        self._cycle_time_s = cycle_time_s
        self._timeline: Timeline | None = None
        self._from = 0  # first cycle of the timeline
        self._moves: list[tuple[str, int, int, float]] = []  # kind, first and end cycle, length
        self._events: list[tuple[int, int, float, float]] = []  # cycle, bit, value, payload
        self._logged = 0  # number of logged events of the last move
        self._continues = False  # whether the timeline starts within the last logged move
        self.start_cycle: int | None = None

    def follow(self, timeline: Timeline, cycle: int, continues: bool) -> None:
        """Start to log a timeline from a bus cycle; ``continues``: it starts within the preceding move."""
        self.end(cycle)
        self._timeline, self._from, self._continues = timeline, cycle, continues
        if self.start_cycle is None:
            self.start_cycle = cycle

    def end(self, cycle: int) -> None:
        """Log the moves of the present timeline up to a bus cycle (exclusive)."""
        timeline, first = self._timeline, self._from
        self._timeline = None
        if timeline is None or cycle <= first:
            return
        rest_cycle = min(max(timeline.end_cycle, first + 1), cycle)
        begun, last = timeline.at(first).number, timeline.at(rest_cycle - 1).number
        if timeline.profile is not None and begun != timeline.profile.number:
            self._continues = False  # the preceding move has ended
        for number in range(begun, last + 1):
            begin = max(timeline.first_cycle_in(number), first)
            end = rest_cycle if number == last else min(timeline.first_cycle_in(number + 1), rest_cycle)
            self._note(timeline, number, begin, end, last_of_all=number == last)
            self._continues = False

    def _note(self, timeline: Timeline, number: int, begin: int, end: int, last_of_all: bool) -> None:
        move = timeline.plan.move(number)
        kind, length_m = move.kind.name.lower(), path_length_m(move)
        if self._continues and self._moves:
            _, begin, _, _ = self._moves.pop()
        else:
            self._logged = 0
        self._moves.append((kind, begin, end, length_m))
        over = not last_of_all or end >= timeline.end_cycle
        for place, bit, value, payload in move.events[self._logged :].tolist():
            cycle = self._cycle_at(timeline, number, place, begin, end)
            if cycle == end and not over:
                break
            self._events.append((cycle, int(bit), value, payload))
            self._logged += 1

    @staticmethod
    def _cycle_at(timeline: Timeline, number: int, place_m: float, begin: int, end: int) -> int:
        """Return the first bus cycle in which the master has reached a distance of a move, at most ``end``."""
        while begin < end:
            middle = (begin + end) // 2
            now = timeline.at(middle)
            if now.number > number or now.distance_m >= place_m:
                end = middle
            else:
                begin = middle + 1
        return begin

    def _time_s(self, cycle: int) -> float:
        return (cycle - (self.start_cycle or 0)) * self._cycle_time_s

    def moves(self) -> list[dict[str, Any]]:
        """Return kind, start [s], end [s] and length [m] of each move; time counts from the first move."""
        return [
            {'kind': kind, 'start_s': self._time_s(begin), 'end_s': self._time_s(end), 'length_m': length_m}
            for kind, begin, end, length_m in self._moves
        ]

    def outputs(self) -> list[dict[str, Any]]:
        """Return time [s], name, value and payload [kg] of each output change; None: payload unchanged."""
        return [
            {
                'time_s': self._time_s(cycle),
                'name': OUTPUTS[bit] if bit >= 0 else 'payload',
                'value': value,
                'payload_kg': None if payload == UNCHANGED else payload,
            }
            for cycle, bit, value, payload in self._events
            if bit < len(OUTPUTS)
        ]
