"""Orders of the planner in the transformation task: plans and motion profiles in, verdicts and status out.

A plan of thousands of moves is checked in slices of time, so that bus cycles start on time.
"""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from delta3_pacdrive.axes import numbered
from delta3_pacdrive.control.cycle.plan_intake import MoreMoves, Order, PlanIntake
from delta3_pacdrive.control.messages import (
    ACCEPTED,
    OVERRIDE,
    PROFILE,
    REVOKE,
    Numbering,
    Origin,
    Status,
    Verdict,
    verdict_of,
)
from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.control.operation.control import Control
from delta3_pacdrive.control.operation.planner_watch import PlannerWatch
from delta3_pacdrive.control.operation.robot_state import RobotState
from delta3_pacdrive.errors import Code, ProgramError, Reason, RobotFault, TelegramError, shown
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import MotionProfile
from delta3_pacdrive.robot.faults.fault import Fault

ROWS_WAITING_MAX = 50_000  # rows of a plan waiting to be checked


class Orders:
    """Orders of the planner and of the script of one robot.

    ``check_faults`` raises ProgramError for faults of a program that cannot be injected.
    """

    def __init__(
        self,
        parameters: Parameters,
        state: RobotState,
        control: Control,
        watch: PlannerWatch,
        check_faults: Callable[[Sequence[Fault]], None],
    ) -> None:
        self._state, self._control, self._watch = state, control, watch
        self._check_faults = check_faults
        self.script = ''  # identity of the active script, which may send orders as well; empty without one
        self._intake, self._script_intake = PlanIntake(parameters), PlanIntake(parameters)
        self._changes = Numbering()
        self._rows: deque[tuple[Origin, Any]] = deque()
        self._revoked: set[tuple[str, int]] = set()
        # topic and verdict, to be published and removed by the caller
        self.verdicts: list[tuple[str, Verdict]] = []
        self._session = self._previous = ''
        self._serial = self._profiles = 0
        self._order = 0  # newest accepted one
        self._driven: set[int] = set()  # orders that form the running program
        self._planner = ''  # sender of the loaded program
        self._listened_to = ''

    def begin_session(self, session: str) -> None:
        """Clear the state of the previous session."""
        self._previous, self._session = self._session, session
        self._rows.clear()
        self._revoked.clear()
        self._intake.begin()
        self._script_intake.begin()
        self.script = ''
        self._order = 0
        self._driven = set()
        self._state.set_override([1.0])

    # the planner ------------------------------------------------------------------------------------------------------

    def receive_heartbeat(self, planner: str, session: str, number: int, now_s: float) -> bool:
        """Take a heartbeat; return whether the active planner has changed."""
        if session == self._session:
            self._watch.receive_heartbeat(planner, number, now_s)
        return self._has_another()

    def _has_another(self) -> bool:
        if self._watch.planner == self._listened_to:
            return False
        self._listened_to = self._watch.planner
        self._state.set_override([1.0])  # until the new planner sends another one
        if not self.script or self._planner != self.script:  # a program of the script is not affected
            self._order, self._driven = 0, set()
        return True

    def poll(self, now_s: float) -> Reason | None:
        """Return why the planner of the running program is lost, None if it is not."""
        moving = self._state.motion in (MotionState.MOVING, MotionState.STOPPING)
        reason = self._watch.poll(now_s, self._planner if moving else '')
        self._has_another()
        return reason

    @property
    def of_planner(self) -> bool:
        """Whether the program was ordered by the planner, which can resume it, and not by a script."""
        return self._planner == self._watch.planner

    @property
    def checked(self) -> int:
        """Number of checked rows of the present plan."""
        return self._intake.checked

    @property
    def waiting(self) -> bool:
        """Whether rows of a plan wait to be checked."""
        return bool(self._rows)

    def status(self, phase: str, next_cycle: int) -> Status:
        """Return the status for the planner."""
        self._serial += 1
        state, control = self._state, self._control
        refusal, operator = state.refusal(), control.operator
        x, y, z = (float(value) for value in state.tcp_m)
        turns: dict[str, Any] = {
            numbered('turn_rad', number): angle for number, angle in enumerate(state.turns_rad)
        }
        return Status(
            session=self._session,
            previous=self._previous,
            serial=self._serial,
            planner=self._watch.planner,
            state=str(state.motion),
            phase=phase,
            refusal=refusal.sentence if refusal else '',
            refusal_code=str(refusal.code) if refusal else '',
            located=state.located,
            tcp_m=(x, y, z),
            control=control.changes,
            operator=operator.identity if operator else '',
            operator_name=operator.name if operator else '',
            losses=control.losses,
            order=self._order if self._planner == self._watch.planner else 0,
            checked=self._intake.checked,
            cycle=next_cycle,
            **turns,
            **RobotFault.facts(refusal.fault if refusal else None),
        )

    def profile_label(self) -> str:
        """Return the label of the next published motion profile."""
        self._profiles += 1
        return Origin(PROFILE, self._planner, self._session, self._profiles).label()

    # plans and motion profiles ----------------------------------------------------------------------------------------

    def _origin(self, label: str) -> Origin:
        """Return the parsed label of a row; raises TelegramError if its sender or session is not active."""
        origin = Origin.from_label(label)
        if not self._listens_to(origin.planner) or origin.session != self._session:
            raise TelegramError(
                f'an order of planner {shown(origin.planner)} in session {shown(origin.session)} is not for this '
                'robot now; is it a recording?'
            )
        return origin

    def _listens_to(self, planner: str) -> bool:
        return planner == self._watch.planner or (bool(self.script) and planner == self.script)

    def take_row(self, label: str, row: Any) -> None:
        """Queue a row of a plan to be checked; raises TelegramError if its sender or session is not active."""
        origin = self._origin(label)
        if origin.kind == REVOKE:
            self._revoke(origin)
        elif len(self._rows) >= ROWS_WAITING_MAX:
            raise TelegramError(f'{ROWS_WAITING_MAX} rows of a plan are waiting already')
        else:
            self._rows.append((origin, row))

    def _revoke(self, origin: Origin) -> None:
        """Revoke an order; if it is running, abort the program."""
        self._revoked.add((origin.planner, origin.number))
        if origin.number in self._driven:
            self._state.abort()

    def check_row(self) -> None:
        """Check a waiting row; the order that ends the rows is carried out or rejected.

        Rows of a planner or script that is no longer active are dropped.
        """
        origin, row = self._rows.popleft()
        if not self._listens_to(origin.planner):
            return
        by_script = bool(self.script) and origin.planner == self.script
        outcome = (self._script_intake if by_script else self._intake).take(origin, row)
        if isinstance(outcome, Order):
            outcome = self._start(origin, outcome)
        elif isinstance(outcome, MoreMoves):
            outcome = self._extend(origin, outcome)
        if isinstance(outcome, Reason):
            self._report('plan', origin, outcome)

    def _start(self, origin: Origin, order: Order) -> Reason | None:
        if (origin.planner, origin.number) in self._revoked:
            return Reason(Code.WITHDRAWN, 'the planner has revoked it')
        try:
            self._check_faults(order.faults)
        except ProgramError as error:
            return Reason.of(error)
        disagreement = None if origin.planner == self.script else self._watch.disagreement()
        if disagreement is not None:
            return Reason(Code.CONTENT, f'it was planned for another robot: {disagreement}')
        if order.replaces:
            return self._replace(origin, order)
        before, self._planner = self._planner, origin.planner
        reason = self._state.start(order)
        if reason is not None:
            self._planner = before
            return reason
        self._order = origin.number
        self._driven = {origin.number}
        self._report('plan', origin, cycle=self._state.starts)
        return None

    def _replace(self, origin: Origin, order: Order) -> Reason | None:
        if origin.planner != self._planner:
            return Reason(Code.STATE, 'the running program is not one of this planner')

        def report(reason: Reason | None, _: str) -> None:
            if reason is None:
                self._order, self._driven = origin.number, {origin.number}
            self._report('plan', origin, reason)

        return self._state.replace(order, report)

    def _extend(self, origin: Origin, order: MoreMoves) -> Reason | None:
        taken_back = (origin.planner, origin.number) in self._revoked
        if taken_back or (origin.planner, order.row.base) != (self._planner, self._order):
            what = (
                'the planner has revoked it' if taken_back else f'order {order.row.base} of it is not driven'
            )
            return Reason(Code.WITHDRAWN if taken_back else Code.STATE, what)

        at_once = origin.planner == self.script  # the bus may wait for the script until then

        def report(reason: Reason | None, _: str) -> None:
            if reason is None:
                self._order = origin.number
                self._driven.add(origin.number)
            if not at_once:
                self._report('plan', origin, reason)

        refused = self._state.extend(order, report)
        if refused is None and at_once:
            self._report('plan', origin, cycle=order.row.profile.cycle)
        return refused

    def take_profile(self, label: str, row: Any) -> None:
        """Apply or reject a motion profile or an override; raises TelegramError if its sender is not active."""
        origin = self._origin(label)
        if not self._changes.is_new(f'{origin.planner} {origin.session}', origin.number):
            raise TelegramError(f'change {origin.number} of this planner was received before')
        if origin.kind == OVERRIDE:
            self._state.set_override(row)
            return
        try:
            reason = self._state.change(MotionProfile.from_array(row))
        except ProgramError as error:
            reason = Reason.of(error)
        followed = self._state.published
        self._report('change', origin, reason, 0 if followed is None else followed.cycle)

    def _report(self, what: str, origin: Origin, reason: Reason | None = None, cycle: int = 0) -> None:
        """Queue the verdict on an order; for a script it contains the bus cycle from which the order is active."""
        of_script = origin.planner == self.script
        code, sentence = (
            (reason.code, reason.sentence) if reason else (ACCEPTED, str(cycle) if of_script else '')
        )
        self.verdicts.append((what, verdict_of(origin, code, sentence)))
