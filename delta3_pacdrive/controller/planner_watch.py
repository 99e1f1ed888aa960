"""Which planner the transformation task listens to, and whether it is still there while its program runs."""

from delta3_pacdrive.controller.messages import Numbering
from delta3_pacdrive.errors import Code, Reason
from delta3_pacdrive.faults.fault import UNIT_ROBOT
from delta3_pacdrive.sercos.configuration_check import Identity, disagreements
from delta3_pacdrive.sercos.watchdog import PLANNER_SILENT_S, Watchdog

RESTARTED_S = 1.0  # without a heartbeat of the planner, after which another one takes its place
PLANNERS_MAX = 16  # whose parameters are remembered


class PlannerWatch:
    """The planners that one master hears of.

    Parameters
    ----------
    period_s
        Time between two looks [s].
    identity
        What the master was configured with.

    Attributes
    ----------
    planner
        The one that is listened to, empty if there is none.

    """

    def __init__(self, period_s: float, identity: Identity) -> None:
        self._identity = identity
        self.planner = ''
        self._watch = Watchdog(period_s)
        self._beats = Numbering()
        self._identities: dict[str, Identity] = {}
        self._other = ''  # heard beside the one that is listened to

    def announced(self, planner: str, identity: Identity) -> None:
        """Take note of what a planner was configured with."""
        self._identities.pop(planner, None)
        self._identities[planner] = identity
        while len(self._identities) > PLANNERS_MAX:
            del self._identities[next(name for name in self._identities if name != self.planner)]

    def heard(self, planner: str, number: int, now_s: float) -> None:
        """Take note of a heartbeat; one that is not newer than the last, or of an unknown planner, does not count."""
        if planner not in self._identities or not self._beats.is_new(planner, number):
            return
        if not self.planner:
            self.planner = planner
        if planner == self.planner:
            self._watch.received(now_s)
        else:
            self._other = planner

    def disagreement(self) -> Reason | None:
        """Say in what the planner disagrees with this master, None if in nothing."""
        if not self.planner:
            return Reason(Code.SILENT, 'there is no planner')
        sentences = '; '.join(disagreements(self._identity, {UNIT_ROBOT: self._identities[self.planner]}))
        return Reason(Code.CONTENT, sentences) if sentences else None

    def look(self, now_s: float, running: str) -> Reason | None:
        """Look: say why the planner whose program runs (empty: none does) is lost, None if it is not."""
        silence = self._watch.silence_s(now_s)
        reason = None
        if not self.planner or silence <= RESTARTED_S:
            return reason
        if running == self.planner:
            if self._other:
                reason = Reason(Code.FOREIGN, 'unit_robot was started again while its program ran')
            elif silence > PLANNER_SILENT_S:
                reason = Reason(Code.SILENT, f'unit_robot silent for {silence:.1f} s')
        if self._other or silence > PLANNER_SILENT_S:
            self.planner, self._other = self._other, ''
            self._watch.received(now_s)
        return reason
