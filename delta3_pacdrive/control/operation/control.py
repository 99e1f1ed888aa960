"""Control of the robot: the right to move it, held by at most one operator.

An operator takes control, keeps it by heartbeats and releases it. While no operator has control, every client may move
the robot, including ROS clients without identity or heartbeat. Otherwise requests of others are rejected with the name
of the operator; reading and stopping remain available to all. Control can be taken over explicitly. When the
heartbeat of an operator times out, it loses control and the robot stops on its path.
"""

from dataclasses import dataclass

from delta3_pacdrive.control.messages import TEXT_MAX, Numbering
from delta3_pacdrive.errors import Code, Reason, shown
from delta3_pacdrive.robot.sercos.watchdog import OPERATOR_APPEARS_S, OPERATOR_SILENT_S, Watchdog


@dataclass(frozen=True)
class Operator:
    """An operator: a self-chosen identity, and a display name."""

    identity: str
    name: str


class Control:
    """Control of one robot; ``period_s`` is the time between two calls of ``poll`` [s]."""

    def __init__(self, period_s: float) -> None:
        self.operator: Operator | None = None
        # changes of control, and of these the losses by take-over or timeout
        self.changes = self.losses = 0
        self._watch = Watchdog(period_s)
        self._heartbeats = Numbering()
        self._heartbeat_received = False  # from the present operator

    def take(self, operator: Operator, by_force: bool, now_s: float) -> Reason | None:
        """Give control to an operator; return the reason of a rejection."""
        if not operator.identity or not operator.name.isprintable() or not 0 < len(operator.name) <= TEXT_MAX:
            return Reason(Code.CONTENT, f'{shown(operator.name)} cannot be the name of an operator')
        if self.operator is not None and self.operator.identity != operator.identity and not by_force:
            return control_refusal(self.operator.name)
        if self.operator is None or self.operator.identity != operator.identity:
            self.losses += self.operator is not None
            self.operator, self._heartbeat_received = operator, False
            self.changes += 1
        self._watch.received(now_s)
        return None

    def release(self, identity: str) -> Reason | None:
        """Release control; return the reason of a rejection."""
        if self.operator is None or self.operator.identity != identity:
            return Reason(Code.CONTROL, 'you do not have control of the robot')
        self._end()
        return None

    def receive_heartbeat(self, identity: str, number: int, now_s: float) -> None:
        """Record a heartbeat; repeated ones are ignored."""
        new = self._heartbeats.is_new(identity, number)
        if new and self.operator is not None and self.operator.identity == identity:
            self._heartbeat_received = True
            self._watch.received(now_s)

    def poll(self, now_s: float) -> Operator | None:
        """Return the operator that has just lost control by timeout, None if none has."""
        silence = self._watch.silence_s(now_s)
        limit_s = OPERATOR_SILENT_S if self._heartbeat_received else OPERATOR_APPEARS_S
        if self.operator is None or silence <= limit_s:
            return None
        operator = self.operator
        self.losses += 1
        self._end()
        return operator

    def refusal(self, identity: str) -> Reason | None:
        """Return why an operator (empty: no identity) may not move the robot, None if it may."""
        if self.operator is None or self.operator.identity == identity:
            return None
        return control_refusal(self.operator.name)

    def _end(self) -> None:
        self.operator = None
        self.changes += 1


def control_refusal(name: str) -> Reason:
    """Return the rejection of a request while another operator has control."""
    return Reason(Code.CONTROL, f'{name} has control of the robot; it can be taken over (--take-over)')
