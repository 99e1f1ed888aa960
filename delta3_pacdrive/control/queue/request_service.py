"""Service of operator requests: one at a time, in order of arrival, each answered once.

Pure: the functions that carry out a request are passed as arguments.
"""

from collections import deque
from collections.abc import Callable

from delta3_pacdrive.control.actions import PlannerAction, Replied, Reported
from delta3_pacdrive.control.messages import Recent, Request
from delta3_pacdrive.control.operation.control import control_refusal
from delta3_pacdrive.control.queue.request_queue import Waiting
from delta3_pacdrive.control.queue.request_tracker import RequestTracker
from delta3_pacdrive.control.queue.task_status import TaskStatus
from delta3_pacdrive.errors import Code, Delta3Error, Reason, RefusedError

WITHDRAWN = Reason(Code.WITHDRAWN, 'withdrawn by its operator')
LOST_CONTROL = Reason(Code.CONTROL, 'its operator has lost control')
WAITING_MAX = 100  # requests
OPERATORS_MAX = 1000  # operators with a stored accepted request, for withdrawals

FOR_MOVES = frozenset({'program', 'move', 'trajectory'})


class RequestService:
    """Requests served by one planner; ``act`` receives the actions, including replies."""

    def __init__(self, task: TaskStatus, act: Callable[[PlannerAction], None]) -> None:
        self._task, self.act = task, act
        self._waiting: deque[Waiting] = deque()
        self._accepted: Recent[tuple[int, str]] = Recent(OPERATORS_MAX)  # number and description, by operator
        self.tracker = RequestTracker(lambda report: act(Reported(report)))
        self.serving: Request | None = None  # not answered yet

    def add(self, request: Request, now_s: float) -> bool:
        """Append a request to the queue, or reject it."""
        accepted = len(self._waiting) < WAITING_MAX
        if accepted:
            self._waiting.append(Waiting(request, now_s, self._task.received))
        else:
            reason = Reason(Code.STATE, f'{WAITING_MAX} requests are waiting already')
            self._reject(request, reason)
            self.act(Replied(request, reason, ''))
        return accepted

    def _remove(self, concerned: Callable[[Request], bool], reason: Reason) -> bool:
        """Reject the waiting requests for which ``concerned`` is true; return whether there were any."""
        removed = [one for one in self._waiting if concerned(one.request)]
        for one in removed:
            self._waiting.remove(one)
            self.act(Replied(one.request, reason, ''))
        return bool(removed)

    def _reject(self, request: Request, reason: Reason) -> None:
        if request.action in FOR_MOVES:
            self.tracker.reject(request.identity, reason)

    def serve_next(
        self, now_s: float, must_wait: Callable[[Request], bool], serve: Callable[[Request], None]
    ) -> bool:
        """Serve the first request.

        Parameters
        ----------
        now_s
            Time [s].
        must_wait
            Whether a request has to wait for a running operation.
        serve
            Carries out the request and replies, now or later, or raises the rejection.

        Returns
        -------
        bool
            Whether a request was served; False if none waits or the first one must wait.

        """
        if not self._waiting:
            return False
        waiting, status = self._waiting[0], self._task.newest
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
        self._waiting.popleft()
        if reason is not None:
            self.reply(reason)
        return True

    def require_control(self, request: Request) -> None:
        """Raise RefusedError if another operator has control of the robot."""
        status = self._task.newest
        if status is not None and status.operator not in ('', request.operator):
            raise RefusedError(control_refusal(status.operator_name))

    def is_outdated(self, request: Request) -> bool:
        """Whether a later request of the same operator for the same action waits."""
        what = request.operator, request.action
        return any(
            one.request is not request and what == (one.request.operator, one.request.action)
            for one in self._waiting
        )

    def reply(self, outcome: Reason | str, routine: bool = False) -> None:
        """Reply to the request being served: reason of its rejection, or description of the result."""
        request, self.serving = self.serving, None
        if request is not None:
            reason, sentence = (outcome, '') if isinstance(outcome, Reason) else (None, outcome)
            if reason is not None:
                self._reject(request, reason)
            elif request.operator:
                self._accepted.note(request.operator, (request.number, sentence))
            self.act(Replied(request, reason, sentence, routine))

    def withdraw(
        self, request: Request, cancel: Callable[[], Reason | str], remove: Callable[[str], Reason | str]
    ) -> None:
        """Withdraw the request of this operator with the number in the text, and reply with its remainder.

        ``cancel`` cancels the request being served. ``remove`` removes the moves of an accepted request from the queue,
        and returns an empty text if it has none there. Both return a reason if they fail.
        """
        serving, what = self.serving, (request.operator, request.text)
        outcome: Reason | str = 'withdrawn'
        if serving is not None and what == (serving.operator, str(serving.number)):
            outcome = cancel()
        elif not self._remove(lambda one: what == (one.operator, str(one.number)), WITHDRAWN):
            outcome = remove(f'{request.operator or request.receiver}-{request.text}') or outcome
            number, sentence = self._accepted.get(request.operator, (-1, ''))
            if outcome == 'withdrawn' and request.text == str(number):
                outcome = Reason(Code.STATE, f'it was carried out before it could be withdrawn: {sentence}')
        reason, sentence = (outcome, '') if isinstance(outcome, Reason) else (None, outcome)
        self.act(Replied(request, reason, sentence))

    def handle_control_loss(self, operator: str, cancel: Callable[[], object]) -> None:
        """Reject the requests of an operator that has lost control; ``cancel`` cancels one being served."""
        if self.serving is not None and self.serving.operator == operator:
            cancel()
        self._remove(lambda request: request.operator == operator, LOST_CONTROL)
