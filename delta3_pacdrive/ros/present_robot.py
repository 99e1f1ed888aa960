"""The robot that is up, as its clients know it: which messages come from it, and whether it is still heard.

A recording that is played back publishes in another session. Clients of ``motion/progress`` and ``motion/state`` ask
which messages to believe.
"""

import math
import time
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from std_msgs.msg import Header

from delta3_pacdrive.controller.task_status import MASTER_SILENT_S
from delta3_pacdrive.ros import interfaces, node_process
from delta3_pacdrive.sercos.telegrams import NO_SESSION
from delta3_pacdrive.sercos.words import Phase


class PresentRobot:
    """The session of the robot in the namespace of a node.

    The planner publishes it with each heartbeat, together with the identifier of the heartbeat's publisher. Heartbeats
    count only if the graph has that publisher, so those in a bag that is played back do not. The first planner counts
    as long as it is heard. Without heartbeats the session that was heard first counts, for as long as reports of it
    arrive.

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
        self._undecided_s = time.monotonic()  # since when it is open which session is that of the robot
        self.session = ''
        self._cycles = 0.0  # of the newest report that was taken
        self._heard_s = self._planner_s = -math.inf
        self._planner = self._planned_in = ''
        interfaces.PLANNER_ALIVE.subscription(node, self._on_alive)

    def _on_alive(self, message: Header) -> None:
        planner, session, publisher = interfaces.read_heartbeat(message)
        if planner != self._planner and self._planner_is_here:
            return
        if session.encode() in (b'', NO_SESSION):
            return
        if publisher in interfaces.publishers_of(self._node, interfaces.PLANNER_ALIVE):
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
        else:
            self._undecided_s = min(self._undecided_s, now)
            if now - self._undecided_s < MASTER_SILENT_S and not self.is_alone:
                return False  # a heartbeat decides
            present = session
        if session != present or (session == self.session and cycles < self._cycles):
            return False
        self._cycles = cycles if cycles < math.inf else 0.0  # bus cycles count from CP4 on
        self.session, self._heard_s, self._undecided_s = session, now, math.inf
        return True


class RobotWatch:
    """Lets the process of a client join the domain anew if a robot is up but not heard.

    A robot is taken for up if this participant has heard it, or knows publishers of its reports.

    Parameters
    ----------
    node
        The client.
    say
        Called with a sentence when its process joins anew.
    period_s
        Time between two looks [s].
    process
        That joins anew; by default that of a single node.

    """

    def __init__(
        self,
        node: Node,
        say: Callable[[str], object],
        period_s: float,
        process: node_process.Process | None = None,
    ) -> None:
        self._node, self._was_heard = node, False
        self._partners = node_process.PartnerWatch(say, period_s, process)

    def heard(self) -> None:
        """Note that the transformation task was heard."""
        self._was_heard = True
        self._partners.heard(interfaces.TASK)

    def look(self) -> None:
        """Look whether it is silent for too long."""
        is_up = self._was_heard or self._node.count_publishers(interfaces.PROGRESS.name)
        self._partners.look((interfaces.TASK,) if is_up else (), time.monotonic())
