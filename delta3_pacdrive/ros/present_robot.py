"""Identification of the running robot by its clients: which messages belong to it, and whether it is still received.

A played-back recording publishes under another session. Clients of ``motion/progress`` and ``motion/state`` use this
module to ignore it.
"""

import math
import time
from collections.abc import Callable

from rclpy.node import Node
from std_msgs.msg import Header

from delta3_pacdrive.control.queue.task_status import MASTER_SILENT_S
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.robot.sercos.telegrams import NO_SESSION
from delta3_pacdrive.robot.sercos.words import Phase
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.wire import interfaces


class PresentRobot:
    """The session of the robot in the namespace of a node.

    The planner publishes it with each heartbeat, together with the identifier of the heartbeat's publisher. Heartbeats
    count only if the graph has that publisher, which excludes those of a bag. The first planner counts as long as its
    heartbeat is received. Without heartbeats the first session counts for as long as its reports arrive.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._undecided_s = time.monotonic()  # since when the session of the robot is unknown
        self.session = ''  # of the newest accepted report
        self._cycles = 0.0  # of the newest accepted report
        self._received_s = self._planner_s = -math.inf
        self._planner = self._planned_in = ''
        interfaces.PLANNER_ALIVE.subscription(node, self._on_alive)

    def _on_alive(self, message: Header) -> None:
        planner, session, publisher = interfaces.read_heartbeat(message)
        if planner != self._planner and self._planner_is_alive:
            return
        if session.encode() in (b'', NO_SESSION):
            return
        if publisher in interfaces.publishers_of(self._node, interfaces.PLANNER_ALIVE):
            self._planner, self._planned_in, self._planner_s = planner, session, time.monotonic()

    @property
    def _planner_is_alive(self) -> bool:
        return time.monotonic() - self._planner_s < MASTER_SILENT_S

    @property
    def is_alone(self) -> bool:
        """Whether only a transformation task publishes progress, so that all messages come from one robot."""
        writers = self._node.get_publishers_info_by_topic(
            self._node.resolve_topic_name(interfaces.PROGRESS.name)
        )
        return all(writer.node_name == interfaces.TASK for writer in writers)

    def is_planner(self, identity: str) -> bool:
        """Whether an identity is that of the robot's planner; True while no heartbeat is received."""
        return identity == self._planner or not self._planner_is_alive

    def accepts(self, progress: MotionProgress) -> bool:
        """Whether a report of ``motion/progress`` comes from the running robot."""
        now, session = time.monotonic(), progress.session
        cycles = progress.cycles if progress.phase == Phase.CP4.name else math.inf
        if self._planner_is_alive:
            present = self._planned_in
        elif now - self._received_s < MASTER_SILENT_S:
            present = self.session
        else:
            self._undecided_s = min(self._undecided_s, now)
            if now - self._undecided_s < MASTER_SILENT_S and not self.is_alone:
                return False  # a heartbeat decides
            present = session
        if session != present or (session == self.session and cycles < self._cycles):
            return False
        self._cycles = cycles if cycles < math.inf else 0.0  # bus cycles count from CP4
        self.session, self._received_s, self._undecided_s = session, now, math.inf
        return True


class RobotWatch:
    """Makes the process of a client rejoin the domain if a robot is up but not received.

    A robot counts as up if it has been received before, or if its reports have publishers. The arguments are those of
    ``PartnerWatch``.
    """

    def __init__(
        self,
        node: Node,
        log: Callable[[str], object],
        period_s: float,
        process: node_process.Process | None = None,
    ) -> None:
        self._node, self._was_received = node, False
        self._partners = node_process.PartnerWatch(log, period_s, process)

    def received(self) -> None:
        """Record that a message of the transformation task was received."""
        self._was_received = True
        self._partners.received(interfaces.TASK)

    def update(self) -> None:
        """Check for a timeout."""
        is_up = self._was_received or self._node.count_publishers(interfaces.PROGRESS.name)
        self._partners.update((interfaces.TASK,) if is_up else (), time.monotonic())
