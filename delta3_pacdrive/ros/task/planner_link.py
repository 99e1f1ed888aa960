"""Link of the transformation task to the planner: receives plans and motion profiles, publishes verdicts and status.

In: ``motion/plan`` (moves, faults, and the order that ends them), ``motion/change`` (motion profiles),
``unit_robot/alive`` (heartbeat of the planner: its identity, the session it knows and its publisher; numbered in
``stamp.sec``). Out: ``motion/status`` (latched, JSON: everything the planner needs), ``motion/verdict`` (JSON: result
of an order or change), ``motion/refusal`` (text of a rejection), ``motion/course`` (latched: profile of the master).
"""

import time
from collections.abc import Callable

from std_msgs.msg import Float64MultiArray, Header, String

from delta3_pacdrive.control.operation.robot_controller import RobotController
from delta3_pacdrive.planning.execution import MotionProfile
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire import interfaces
from delta3_pacdrive.ros.wire.numbers import numbers, row_of

SLICE_S, SLICE_EVERY_S = 0.5e-3, 2e-3  # time slice for checking a plan, and its period
STATUS_EVERY = 500  # checked rows


class PlannerLink:
    """Link of one transformation task; ``changed`` is called when the state of the robot may have changed."""

    def __init__(self, node: RobotNode, controller: RobotController, changed: Callable[[], None]) -> None:
        self._log, self._controller, self._orders = node.get_logger(), controller, controller.orders
        self._changed = changed
        self._reported = 0  # checked rows in the last status
        self._status = interfaces.STATUS.publisher(node)
        self._verdicts = interfaces.VERDICT.publisher(node)
        self._refusals = interfaces.REFUSAL.publisher(node)
        self._profile = interfaces.PROFILE.publisher(node)
        interfaces.MOTION_PLAN.bounded_subscription(node, self._on_row, self._reject_message)
        interfaces.MOTION_CHANGE.bounded_subscription(node, self._on_profile, self._reject_message)
        interfaces.PLANNER_ALIVE.bounded_subscription(node, self._on_alive)
        self._slices = node.create_timer(SLICE_EVERY_S, self._check_rows)
        self._slices.cancel()

    def _on_alive(self, message: Header) -> None:
        planner, session, _ = interfaces.read_heartbeat(message)
        if self._orders.receive_heartbeat(planner, session, message.stamp.sec, time.monotonic()):
            self._log.info(f'planner {planner}')
            self.publish_status()

    def publish_status(self) -> None:
        """Publish the status for the planner."""
        self._reported = self._orders.checked
        controller = self._controller
        status = self._orders.status(controller.bus.phase.name, controller.next_cycle)
        self._status.publish(String(data=status.to_json()))

    def publish_profile(self, profile: MotionProfile) -> None:
        """Publish the profile that the master follows."""
        self._profile.publish(numbers(profile.to_array(), self._orders.profile_label()))

    def _on_row(self, message: Float64MultiArray) -> None:
        self._orders.take_row(*row_of(message))
        self._changed()
        if self._orders.waiting:
            self._slices.reset()

    def _check_rows(self) -> None:
        """Check rows of a plan for one time slice."""
        end = time.monotonic() + SLICE_S
        while self._orders.waiting and time.monotonic() < end:
            self._orders.check_row()
        if not self._orders.waiting:
            self._slices.cancel()
        if self._orders.checked >= self._reported + STATUS_EVERY:
            self.publish_status()
        self._changed()
        self.publish_verdicts()

    def _on_profile(self, message: Float64MultiArray) -> None:
        self._orders.take_profile(*row_of(message))
        self._changed()
        self.publish_verdicts()

    def publish_verdicts(self) -> None:
        """Publish the results of orders and changes."""
        verdicts, self._orders.verdicts = self._orders.verdicts, []
        for what, verdict in verdicts:
            self._verdicts.publish(String(data=verdict.to_json()))
            if not verdict.accepted:
                self._refuse(f'{what} refused: {verdict.sentence}')

    def _refuse(self, sentence: str) -> None:
        self._log.error(sentence)
        self._refusals.publish(String(data=sentence))

    def _reject_message(self, sentence: str) -> None:
        """Report a message that is not a valid order; logged at most once a second."""
        self._log.error(f'refused: {sentence}', throttle_duration_sec=1.0)
        self._refusals.publish(String(data=f'refused: {sentence}'))
