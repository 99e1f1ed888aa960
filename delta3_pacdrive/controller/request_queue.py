"""Requests of operators that wait to be served, one at a time, in the order in which they came."""

from collections import deque
from dataclasses import dataclass

from delta3_pacdrive.controller.messages import Request
from delta3_pacdrive.errors import Code, Reason

WAITING_MAX = 100  # requests
NEWS_S = 2.0  # that a request may wait for news of the transformation task
# refusals that the next status may end
PASSING = frozenset({Code.STATE, Code.DISABLED, Code.FAULT, Code.BUS})


@dataclass(frozen=True)
class Waiting:
    """A request, since when it waits, and how many statuses had come by then."""

    request: Request
    since_s: float
    news: int

    def may_wait(self, now_s: float) -> bool:
        """Whether the request may still wait for news."""
        return now_s - self.since_s < NEWS_S

    def may_be_outdated(self, reason: Reason, now_s: float, news: int) -> bool:
        """Whether a refusal may be out of date: what was done a moment ago, enabling for example, is not known yet."""
        return reason.code in PASSING and self.news == news and self.may_wait(now_s)


class RequestQueue:
    """The requests that wait."""

    def __init__(self) -> None:
        self._waiting: deque[Waiting] = deque()

    def add(self, request: Request, now_s: float, news: int) -> Reason | None:
        """Let a request wait; returns why not."""
        if len(self._waiting) >= WAITING_MAX:
            return Reason(Code.STATE, f'{WAITING_MAX} requests are waiting already')
        self._waiting.append(Waiting(request, now_s, news))
        return None

    @property
    def first(self) -> Waiting | None:
        """The request that is served next, None if none waits."""
        return self._waiting[0] if self._waiting else None

    def pop(self) -> None:
        """Take the first request away."""
        self._waiting.popleft()

    def withdraw(self, operator: str, number: str) -> list[Request]:
        """Take an operator's request back; returns it, if it was waiting."""
        given_up = [
            w for w in self._waiting if (operator, number) == (w.request.operator, str(w.request.number))
        ]
        self._waiting = deque(w for w in self._waiting if w not in given_up)
        return [waiting.request for waiting in given_up]
