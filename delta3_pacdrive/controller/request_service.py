"""Service of requests of operators: one at a time, in the order in which they came, each answered once.

Pure: what is done for a request, and what is known of the transformation task, come in as calls.
"""

from collections.abc import Callable

from delta3_pacdrive.controller.control import control_refusal
from delta3_pacdrive.controller.messages import Recent, Request
from delta3_pacdrive.controller.planner_actions import Action, Replied, Reported
from delta3_pacdrive.controller.request_queue import RequestQueue
from delta3_pacdrive.controller.request_tracker import RequestTracker
from delta3_pacdrive.controller.task_status import TaskStatus
from delta3_pacdrive.errors import Code, Delta3Error, Reason, RefusedError

WITHDRAWN = Reason(Code.WITHDRAWN, 'withdrawn by its operator')
LOST_CONTROL = Reason(Code.CONTROL, 'its operator has lost control')
OPERATORS_MAX = 1000  # whose newest accepted request is known, should it be withdrawn

FOR_MOVES = frozenset({'program', 'move', 'trajectory'})


class RequestService:
    """The requests that one planner serves.

    Parameters
    ----------
    task
        What the transformation task says.
    act
        Called with what has to be done, answers among it.

    Attributes
    ----------
    serving
        The request that is served and not yet answered, None if there is none.
    tracker
        What becomes of the moves of each.

    """

    def __init__(self, task: TaskStatus, act: Callable[[Action], None]) -> None:
        self._task, self._act = task, act
        self._queue = RequestQueue()
        self._accepted: Recent[tuple[int, str]] = Recent(OPERATORS_MAX)  # number and sentence, by operator
        self.tracker = RequestTracker(lambda report: act(Reported(report)))
        self.serving: Request | None = None

    def add(self, request: Request, now_s: float) -> bool:
        """Let a request wait, or refuse it."""
        reason = self._queue.add(request, now_s, self._task.received)
        if reason is not None:
            self._refuse(request, reason)
            self._act(Replied(request, reason, ''))
        return reason is None

    def _refuse(self, request: Request, reason: Reason) -> None:
        if request.action in FOR_MOVES:
            self.tracker.refuse(request.identity, reason)

    def serve_next(
        self, now_s: float, must_wait: Callable[[Request], bool], serve: Callable[[Request], None]
    ) -> bool:
        """Serve the request that came first.

        Parameters
        ----------
        now_s
            Time [s].
        must_wait
            Whether a request has to wait for something that is under way.
        serve
            Does what it asks for, or raises why not; whoever does it replies, now or later.

        Returns
        -------
        bool
            Whether it was served; False if there is none, or none can be served yet.

        """
        waiting, status = self._queue.first, self._task.newest
        if waiting is None:
            return False
        request = waiting.request
        unknown = status is None or status.control < request.control
        if (unknown and waiting.may_wait(now_s)) or must_wait(request):
            return False
        self.serving = request
        reason = None
        try:
            self.require_control(request)
            serve(request)
        except Delta3Error as error:
            reason = Reason.of(error)
        if reason is not None and waiting.may_be_outdated(reason, now_s, self._task.received):
            self.serving = None
            return False
        self._queue.pop()
        if reason is not None:
            self.reply(reason)
        return True

    def require_control(self, request: Request) -> None:
        """Raise RefusedError if somebody else has control of the robot."""
        status = self._task.newest
        if status is not None and status.operator not in ('', request.operator):
            raise RefusedError(control_refusal(status.operator_name))

    def reply(self, outcome: Reason | str) -> None:
        """Answer the request that is served: why it is refused, or what was done."""
        request, self.serving = self.serving, None
        if request is not None:
            reason, sentence = (outcome, '') if isinstance(outcome, Reason) else (None, outcome)
            if reason is not None:
                self._refuse(request, reason)
            elif request.operator:
                self._accepted.note(request.operator, (request.number, sentence))
            self._act(Replied(request, reason, sentence))

    def withdraw(
        self, request: Request, cancel: Callable[[], Reason | str], remove: Callable[[str], Reason | str]
    ) -> None:
        """Withdraw the request of the same operator whose number is the text, and say what is left of it.

        ``cancel`` ends a request that is served; ``remove`` removes the moves of one that was accepted, by its
        identity, from the queue and returns an empty text if none are there. Both return a reason if they cannot.
        """
        serving, what = self.serving, (request.operator, request.text)
        outcome: Reason | str = 'withdrawn'
        if serving is not None and what == (serving.operator, str(serving.number)):
            outcome = cancel()
        elif waiting := self._queue.withdraw(*what):
            for one in waiting:
                self._act(Replied(one, WITHDRAWN, ''))
        else:
            outcome = remove(f'{request.operator or request.receiver}-{request.text}') or outcome
            number, sentence = self._accepted.get(request.operator, (-1, ''))
            if outcome == 'withdrawn' and request.text == str(number):
                outcome = Reason(Code.STATE, f'it was carried out before it could be withdrawn: {sentence}')
        reason, sentence = (outcome, '') if isinstance(outcome, Reason) else (None, outcome)
        self._act(Replied(request, reason, sentence))

    def lose_control(self, loser: str, cancel: Callable[[], object]) -> None:
        """Refuse the requests of an operator who has lost control; ``cancel`` ends one that is served."""
        if self.serving is not None and self.serving.operator == loser:
            cancel()
        for one in self._queue.remove(lambda request: request.operator == loser):
            self._act(Replied(one, LOST_CONTROL, ''))
