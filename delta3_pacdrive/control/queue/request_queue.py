"""Records of requests: waiting and received ones."""

from dataclasses import dataclass

from delta3_pacdrive.control.messages import Reply, Request
from delta3_pacdrive.errors import Code, Reason, RefusedError

OPERATORS_MAX = 10_000  # remembered operators
REMEMBERED_S = 600.0  # time after its newest request for which an operator is remembered
NEWS_S = 2.0  # time that a request may wait for a newer status
# codes of rejections that the next status may make obsolete
PASSING = frozenset({Code.STATE, Code.DISABLED, Code.FAULT, Code.BUS})


@dataclass(frozen=True)
class Waiting:
    """A request, its time of arrival, and the number of statuses received before."""

    request: Request
    since_s: float
    news: int

    def may_wait(self, now_s: float) -> bool:
        """Whether the request may still wait for a newer status."""
        return now_s - self.since_s < NEWS_S

    def may_be_outdated(self, reason: Reason, now_s: float, news: int) -> bool:
        """Whether a rejection may be outdated, because no status has arrived since the request (after enabling)."""
        return reason.code in PASSING and self.news == news and self.may_wait(now_s)


@dataclass
class _Received:
    """Newest request of an operator, time of its last arrival, and its reply once available."""

    number: int
    at_s: float
    reply: Reply | None = None


class ReceivedRequests:
    """Newest request of each operator, so that a request is served once, however often it is received.

    An operator is removed ``REMEMBERED_S`` after its newest request, never to make room for others.
    """

    def __init__(self, operators_max: int = OPERATORS_MAX) -> None:
        self._operators_max = operators_max
        self._newest: dict[str, _Received] = {}  # by operator, least recent first

    def receive(self, request: Request, now_s: float) -> bool:
        """Record a request; return whether it is new.

        Raises
        ------
        RefusedError
            It is older than the newest one of its operator, or there are too many operators.

        """
        while self._newest and now_s - next(iter(self._newest.values())).at_s > REMEMBERED_S:
            del self._newest[next(iter(self._newest))]
        newest = self._newest.pop(request.operator, None)
        if newest is None and len(self._newest) >= self._operators_max:
            sentence = (
                f'{self._operators_max} operators, the limit, have made requests within {REMEMBERED_S:g} s'
            )
            raise RefusedError(Reason(Code.STATE, sentence))
        new = newest is None or request.number > newest.number
        if newest is None or new:
            newest = _Received(request.number, now_s)
        self._newest[request.operator] = newest
        newest.at_s = now_s
        if request.number < newest.number:
            sentence = f'request {request.number} came after request {newest.number} of the same operator'
            raise RefusedError(Reason(Code.FOREIGN, sentence))
        return new

    def note(self, reply: Reply) -> None:
        """Store the reply to the newest request of an operator."""
        newest = self._newest.get(reply.operator)
        if newest is not None and newest.number == reply.number:
            newest.reply = reply

    def reply(self, request: Request) -> Reply | None:
        """Return the reply to the newest request of an operator, None while it is being served."""
        newest = self._newest.get(request.operator)
        return newest.reply if newest is not None and newest.number == request.number else None
