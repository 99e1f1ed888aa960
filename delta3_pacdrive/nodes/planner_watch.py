"""Whether UnitRobot, which has planned what runs, is still there: its heartbeat, and the task's watch over it.

Topic: ``unit_robot/alive`` (Header, 5 Hz: ``frame_id`` is the identity that the planner has drawn at its start). The
order of a plan carries the same identity; a plan without one, of any other client, is not watched over.
"""

import secrets
import time

from rclpy.node import Node
from std_msgs.msg import Header

from delta3_pacdrive.bus.phases import Identity, disagreements
from delta3_pacdrive.bus.silence import PLANNER_SILENT_S, Watch
from delta3_pacdrive.errors import shown
from delta3_pacdrive.injection import UNIT_ROBOT
from delta3_pacdrive.nodes.participant import Roll
from delta3_pacdrive.nodes.qos import REPORT

ALIVE = 'unit_robot/alive'
IDENTITY_DIGITS = 8
ALIVE_S = 0.2
RESTARTED_S = (
    1.0  # without a heartbeat of the planner of the program, after which another one has taken its place
)


class Heartbeat:
    """Of a planner.

    Attributes
    ----------
    identity
        Eight hexadecimal digits, others after each start.

    """

    def __init__(self, node: Node) -> None:
        self.identity = secrets.token_hex(IDENTITY_DIGITS // 2)
        self._publisher = node.create_publisher(Header, ALIVE, REPORT)
        node.create_timer(ALIVE_S, lambda: self._publisher.publish(Header(frame_id=self.identity)))


class PlannerWatch:
    """Of a transformation task, which looks every ``period_s``, knows who is there, and has an identity itself."""

    def __init__(self, node: Node, period_s: float, roll: Roll, identity: Identity) -> None:
        self._roll, self._identity, self._log = roll, identity, node.get_logger()
        self._watch = Watch(period_s)
        self._others = ''  # identity of another planner than that of the program
        self._planner = ''  # of the program that runs
        node.create_subscription(Header, ALIVE, self._on_alive, REPORT)

    def _on_alive(self, message: Header) -> None:
        if message.frame_id == self._planner:
            self._watch.heard(time.monotonic())
        elif not self._others:
            self._others = message.frame_id[:IDENTITY_DIGITS]
            if self._planner:
                self._log.warning(f'{ALIVE}: heartbeat of another planner ({shown(self._others)})')

    def misplans(self) -> str:
        """Say in what the planner disagrees with this master, empty if in nothing or none is known."""
        planner = self._roll.planner
        return '' if planner is None else '; '.join(disagreements(self._identity, {UNIT_ROBOT: planner}))

    def lost(self, planner: str) -> str:
        """Look: say why the planner of the program that runs is lost; empty if it is not, or none runs (``''``)."""
        now = time.monotonic()
        if planner != self._planner:
            self._planner, self._others = planner, ''
            self._watch.heard(now)
        silence = self._watch.silence_s(now)
        if not planner:
            return ''
        if self._others and silence > RESTARTED_S:
            return 'unit_robot was started again while its program ran'
        return f'unit_robot silent for {silence:.1f} s' if silence > PLANNER_SILENT_S else ''
