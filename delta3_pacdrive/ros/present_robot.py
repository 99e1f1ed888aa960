"""The robot that is up, told apart from a recording that is played back: they publish in different sessions.

Clients of ``motion/progress`` and ``motion/state`` ask it which messages to believe.
"""

import math
import time
from typing import Any

from rclpy.node import Node
from std_msgs.msg import Header

from delta3_pacdrive.controller.task_status import MASTER_SILENT_S
from delta3_pacdrive.ros import interfaces
from delta3_pacdrive.sercos.telegrams import NO_SESSION
from delta3_pacdrive.sercos.words import Phase


class PresentRobot:
    """The session of the robot in the namespace of a node.

    The planner publishes it with each heartbeat, which recordings of robots do not contain. Without heartbeats the
    session that was heard first counts, for as long as reports of it arrive.

    Parameters
    ----------
    node
        Client of the robot.

    Attributes
    ----------
    session
        That of the newest report that was taken, empty before the first.

    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._begun_s = time.monotonic()
        self.session = ''
        self._cycles = 0.0  # of the newest report that was taken
        self._heard_s = self._planner_s = -math.inf
        self._planner = self._planned_in = ''
        interfaces.PLANNER_ALIVE.subscription(node, self._on_alive)

    def _on_alive(self, message: Header) -> None:
        planner, _, session = message.frame_id.partition(' ')
        if planner != self._planner and self._planner_is_here:
            return
        if session and session.encode() != NO_SESSION:
            self._planner, self._planned_in, self._planner_s = planner, session, time.monotonic()

    @property
    def _planner_is_here(self) -> bool:
        return time.monotonic() - self._planner_s < MASTER_SILENT_S

    @property
    def is_alone(self) -> bool:
        """Whether no other node than a transformation task publishes here: everything comes from one robot."""
        writers = self._node.get_publishers_info_by_topic(
            self._node.resolve_topic_name(interfaces.PROGRESS.name)
        )
        return all(writer.node_name == interfaces.TASK for writer in writers)

    def is_planner(self, identity: str) -> bool:
        """Whether a message comes from the planner of the robot, as far as its heartbeats are heard."""
        return identity == self._planner or not self._planner_is_here

    def takes(self, progress: dict[str, Any]) -> bool:
        """Whether a report of ``motion/progress`` comes from the robot that is up."""
        now, session = time.monotonic(), str(progress['session'])
        cycles = progress['cycles'] if progress['phase'] == Phase.CP4.name else math.inf
        if self._planner_is_here:
            present = self._planned_in
        elif now - self._heard_s < MASTER_SILENT_S:
            present = self.session
        elif now - self._begun_s < MASTER_SILENT_S and not self.is_alone:
            return False  # a heartbeat decides
        else:
            present = session
        if session != present or (session == self.session and cycles < self._cycles):
            return False
        self._cycles = cycles if cycles < math.inf else 0.0  # bus cycles count from CP4 on
        self.session, self._heard_s = session, now
        return True
