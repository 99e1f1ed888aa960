"""Selection of the active planner, and supervision of its heartbeat while its program runs."""

from delta3_pacdrive.control.messages import Numbering
from delta3_pacdrive.errors import Code, Reason
from delta3_pacdrive.robot.faults.fault import UNIT_ROBOT
from delta3_pacdrive.robot.sercos.configuration_check import Identity, disagreements
from delta3_pacdrive.robot.sercos.watchdog import PLANNER_SILENT_S, Watchdog

RESTARTED_S = 1.0  # without a heartbeat, after which another planner becomes active
PLANNERS_MAX = 16  # with stored parameters


class PlannerWatch:
    """Planners known to one master.

    ``period_s`` is the time between two calls of ``poll`` [s], ``identity`` the configuration of the master.
    """

    def __init__(self, period_s: float, identity: Identity) -> None:
        self._identity = identity
        self.planner = ''  # the active one, empty without one
        self._watch = Watchdog(period_s)
        self._heartbeats = Numbering()
        self._identities: dict[str, Identity] = {}
        self._other = ''  # another planner with a heartbeat

    def receive_announcement(self, planner: str, identity: Identity) -> None:
        """Record the configuration of a planner."""
        self._identities.pop(planner, None)
        self._identities[planner] = identity
        while len(self._identities) > PLANNERS_MAX:
            del self._identities[next(name for name in self._identities if name != self.planner)]

    def receive_heartbeat(self, planner: str, number: int, now_s: float) -> None:
        """Record a heartbeat; repeated ones and those of unknown planners are ignored."""
        if planner not in self._identities or not self._heartbeats.is_new(planner, number):
            return
        if not self.planner:
            self.planner = planner
        if planner == self.planner:
            self._watch.received(now_s)
        else:
            self._other = planner

    def disagreement(self) -> Reason | None:
        """Return the differences between the configurations of planner and master, None if there are none."""
        if not self.planner:
            return Reason(Code.SILENT, 'there is no planner')
        sentences = '; '.join(disagreements(self._identity, {UNIT_ROBOT: self._identities[self.planner]}))
        return Reason(Code.CONTENT, sentences) if sentences else None

    def poll(self, now_s: float, running: str) -> Reason | None:
        """Return why the planner of the running program (empty: none) is lost, None if it is not."""
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
