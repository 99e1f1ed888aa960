"""Who has control of the robot: the right to move it, which one operator has at a time.

An operator takes control, keeps it by his heartbeat and releases it. While nobody has it, everybody may move the robot,
operators without an identity too, as ROS clients without a heartbeat are. While somebody has it, others are refused by
his name; reading and stopping are free for all. Another operator can take control over on purpose. Who falls silent has
lost it, and the robot stops on its path: nobody watches it any more.
"""

from dataclasses import dataclass

from delta3_pacdrive.controller.messages import TEXT_MAX, Numbering
from delta3_pacdrive.errors import Code, Reason, shown
from delta3_pacdrive.sercos.watchdog import OPERATOR_APPEARS_S, OPERATOR_SILENT_S, Watchdog


@dataclass(frozen=True)
class Operator:
    """Somebody who may have control: an identity of his own choice, and a name for people."""

    identity: str
    name: str


class Control:
    """Control of one robot.

    Parameters
    ----------
    period_s
        Time between two calls of ``lost`` [s].

    Attributes
    ----------
    operator
        Who has it, None for nobody.
    changes
        How often it has changed hands.
    losses
        How often somebody has lost it: taken over by another one, or silent.

    """

    def __init__(self, period_s: float) -> None:
        self.operator: Operator | None = None
        self.changes = self.losses = 0
        self._watch = Watchdog(period_s)
        self._heartbeats = Numbering()
        self._heartbeat_received = False  # whether a heartbeat of the operator has come

    def take(self, operator: Operator, by_force: bool, now_s: float) -> Reason | None:
        """Give control to an operator; returns why not."""
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
        """Take control back from an operator who gives it up; returns why not."""
        if self.operator is None or self.operator.identity != identity:
            return Reason(Code.CONTROL, 'you do not have control of the robot')
        self._end()
        return None

    def receive_heartbeat(self, identity: str, number: int, now_s: float) -> None:
        """Take note of a heartbeat; one that is not newer than the last does not count."""
        new = self._heartbeats.is_new(identity, number)
        if new and self.operator is not None and self.operator.identity == identity:
            self._heartbeat_received = True
            self._watch.received(now_s)

    def poll(self, now_s: float) -> Operator | None:
        """Look: the operator who has just lost control because he fell silent, None if none has."""
        silence = self._watch.silence_s(now_s)
        limit_s = OPERATOR_SILENT_S if self._heartbeat_received else OPERATOR_APPEARS_S
        if self.operator is None or silence <= limit_s:
            return None
        operator = self.operator
        self.losses += 1
        self._end()
        return operator

    def refusal(self, identity: str) -> Reason | None:
        """Say why somebody (empty: without an identity) may not move the robot, None if he may."""
        if self.operator is None or self.operator.identity == identity:
            return None
        return control_refusal(self.operator.name)

    def _end(self) -> None:
        self.operator = None
        self.changes += 1


def control_refusal(name: str) -> Reason:
    """Return the refusal of whoever has no control, because somebody else has."""
    return Reason(Code.CONTROL, f'{name} has control of the robot; it can be taken over (--take-over)')
