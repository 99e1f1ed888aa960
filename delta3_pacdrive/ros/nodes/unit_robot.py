"""Node of UnitRobot, the planner: receives moves and programs, plans and checks them as a whole, starts and overrides.

In: ``motion/status``, ``motion/course``, ``motion/verdict`` of the transformation task. Out: ``unit_robot/alive``
(5 Hz), and the outputs of ``ros.planner.planner_outputs``. Operator requests: ``ros.planner.planner_services``; ROS
actions: ``ros.planner.motion_action``. Decisions are made in ``control.queue.planner``.

It is longer than other nodes because it connects the planner to its thread, its operators and its outputs.
"""

import time
from collections.abc import Callable, Iterator
from typing import Any

from rclpy.parameter import Parameter
from std_msgs.msg import Float64MultiArray, Header, String

from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.control.messages import Origin, Status, Verdict
from delta3_pacdrive.control.queue.planner import Planner
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.adapted_program import rest_of
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.program.output_names import OWN
from delta3_pacdrive.robot.faults.fault import TASK, UNIT_ROBOT
from delta3_pacdrive.robot.sercos.bus_time import ACYCLIC_SEC, NEVER, Clock
from delta3_pacdrive.robot.sercos.telegrams import NO_SESSION
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros import parameters as node_parameters
from delta3_pacdrive.ros.fault_injection import Faults
from delta3_pacdrive.ros.parameters import declare_own, declare_robot
from delta3_pacdrive.ros.planner.follow_joint_trajectory import (
    FollowJointTrajectory,
    ToleranceMonitor,
    tolerances_of,
)
from delta3_pacdrive.ros.planner.motion_action import MotionAction, MotionSequence
from delta3_pacdrive.ros.planner.planner_outputs import PlannerOutputs, PlanningThread
from delta3_pacdrive.ros.planner.planner_services import PlannerServices
from delta3_pacdrive.ros.wire import frames, interfaces
from delta3_pacdrive.ros.wire.announcements import Participant
from delta3_pacdrive.ros.wire.control_messages import control_type
from delta3_pacdrive.ros.wire.joint_states import JointStatesReader
from delta3_pacdrive.ros.wire.joint_trajectory import TimeOfDay
from delta3_pacdrive.ros.wire.numbers import row_of
from delta3_pacdrive.ros.wire.polling import PollingNode
from delta3_pacdrive.ros.wire.qos import NEWEST
from delta3_pacdrive.scene.urdf import urdf

AHEAD_MAX = 5000  # cycles; limits jumps, as any node may publish joint states


class NewestCycle:
    """The bus cycle of the newest joint states, published every 10 ms of bus time.

    ``known`` returns a cycle that is known from another source.
    """

    def __init__(self, node: PollingNode, cycles: Clock, known: Callable[[], int]) -> None:
        self._cycles, self._known = cycles, known
        self._take = interfaces.JOINT_STATES.polled_subscription(node, profile=NEWEST)
        base = frames.base_of(node)
        self._frame, self._reader = base.encode(), JointStatesReader(base)
        self._newest = 0
        self.times = TimeOfDay(cycles)

    def __call__(self) -> int:
        """Return the newest bus cycle."""
        known = self._known()
        self._newest = max(self._newest, known) if self._newest < known + AHEAD_MAX else known
        while (taken := self._take()) is not None:
            try:
                states = self._reader.read(taken[0])
            except TelegramError:
                continue  # joints of another robot on the same topic
            cycle = self._cycles.count(states.sec, states.nanosec) if states.frame == self._frame else -1
            if 0 <= cycle < known + AHEAD_MAX:
                self._newest = max(self._newest, cycle)
                self.times.observe(cycle, taken[1]['source_timestamp'])
        return self._newest

    def stamp(self) -> tuple[int, int]:
        """Return the stamp of that cycle; negative before cyclic operation."""
        cycle = self()
        return self._cycles.stamp(cycle) if cycle > 0 else (ACYCLIC_SEC, 0)


KIND = 'unit_robot'
LOOK_S = 0.05  # period of the checks of timeouts and injected faults
FETCH_S = 0.005  # period of the checks of the planning thread, while it is busy
ALIVE_EVERY = 4  # checks between two heartbeats
PROGRESS_EVERY = 10  # checks between two progress reports of a long request
ANNOUNCE_EVERY = 20  # checks between two announcements, until the task has received one


class UnitRobotNode(PollingNode):
    """The non-cyclic part of the controller."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__(KIND, **node_options)
        own = declare_own(self, KIND)
        path, around, tolerances = own['program'], own['cell'], tolerances_of(own)
        robot = declare_robot(self, KIND)
        program = None
        outputs = cell_file.load(around).output_names if around else OWN
        if path:
            program = rest_of(programs.load(path, robot.motion, outputs), own['first_statement'], robot)
        self._participant = Participant(self, UNIT_ROBOT, robot)
        self._partners = node_process.PartnerWatch(self.get_logger().warning, LOOK_S)
        self._identity = identity = self._participant.instance
        cycles = Clock(robot.bus.cycle_time_s)
        self._newest = NewestCycle(self, cycles, self._known_cycle)
        self._planner = planner = Planner(robot, identity, program, self._newest, tolerances)
        self._thread = PlanningThread(robot, self.get_logger().error, outputs)
        others = interfaces.publishers_of(self, interfaces.PLANNER_ALIVE)
        self._alive = interfaces.PLANNER_ALIVE.publisher(self)
        self._publisher = ' '.join(interfaces.publishers_of(self, interfaces.PLANNER_ALIVE) - others)
        interfaces.STATUS.bounded_subscription(self, self._on_status)
        interfaces.PROFILE.bounded_subscription(self, self._on_profile)
        interfaces.VERDICT.bounded_subscription(self, self._on_verdict)
        self._operators = PlannerServices(
            self,
            planner,
            identity,
            progress=self._thread.progress,
            stamp=self._newest.stamp,
            bus_time_s=self._newest.times.bus_time_s,
            changed=self._carry_out,
        )
        self._goals = list(self._offered_actions(robot, cycles))
        watched = tolerances.any or bool(self._goals)
        self._monitor = ToleranceMonitor(self, watched, cycles, planner)
        self._outputs = PlannerOutputs(
            self,
            planner,
            thread=self._thread,
            operators=self._operators,
            goals=self._goals,
            origin=self._origin,
        )
        self._faults = Faults(self, UNIT_ROBOT, self._newest, self._session)
        self.add_post_set_parameters_callback(self._on_parameters)
        self._beats = self._looks = 0
        self._description = interfaces.ROBOT_DESCRIPTION.publisher(self)
        self._description.publish(String(data=urdf(robot, frames.prefix_of(self))))
        self._participant.announce(NO_SESSION)
        self._beat()
        self._operators.publish_queue()
        self.create_timer(LOOK_S, self._look)
        self._fetcher = self.create_timer(FETCH_S, self._fetch, autostart=False)
        self.get_logger().info('waiting for transformation_task')

    def destroy_node(self) -> None:
        """End the planning thread as well."""
        self._thread.close()
        for goals in self._goals:
            goals.destroy()
        super().destroy_node()

    def _offered_actions(self, robot: Parameters, cycles: Clock) -> Iterator[MotionAction]:
        """Yield the servers of the actions whose types are installed."""
        missing = 'the installed control_msgs, if any, has no %s: that action is not offered'
        if (kind := control_type('FollowJointTrajectory')) is not None:
            times = self._newest.times
            yield FollowJointTrajectory(
                self, kind, self._planner, self._operators, cycles, bus_time_s=times.bus_time_s
            )
        else:
            self.get_logger().debug(missing % 'FollowJointTrajectory')
        if (kind := control_type('ExecuteMotionPrimitiveSequence')) is not None:
            yield MotionSequence(self, kind, self._planner, self._operators, robot.kinematics)
        else:
            self.get_logger().debug(missing % 'ExecuteMotionPrimitiveSequence')

    def _on_parameters(self, _: list[Parameter]) -> None:
        """Apply changed tolerances to the trajectories that begin from now on."""
        names = [one.name for one in node_parameters.OWN[KIND] if one.writable]
        values = {one.name: one.value for one in self.get_parameters(names)}
        self._planner.trajectory.default = tolerances_of(values)

    def _session(self) -> bytes:
        status = self._planner.status
        return status.session.encode() if status else NO_SESSION

    def _known_cycle(self) -> int:
        status = self._planner.status
        return status.cycle if status else 0

    def _origin(self, kind: str, number: int) -> Origin:
        return Origin(kind, self._identity, self._session().decode(), number)

    def _carry_out(self) -> None:
        """Execute the planner's actions, and start fetching while the thread is busy."""
        self._outputs.carry_out()
        if self._thread.busy and self._fetcher.is_canceled():
            self._fetcher.reset()

    # timers -----------------------------------------------------------------------------------------------------------

    def _look(self) -> None:
        self._looks += 1
        cycle = self._newest()
        if self._faults.next_cycle < NEVER:
            self._faults.due(cycle)
        self._planner.poll(time.monotonic())
        self._partners.update((TASK,), time.monotonic())
        self._monitor.update()
        self._carry_out()  # tolerance violations end goals before they count as reached
        for goals in self._goals:
            goals.update()
        if self._looks % ALIVE_EVERY == 0:
            self._beat()
        if self._looks % ANNOUNCE_EVERY == 0 and not self._planner.listened_to:
            self._participant.announce(NO_SESSION)
        if self._looks % PROGRESS_EVERY == 0:
            self._operators.report_progress()

    def _fetch(self) -> None:
        """Pass results of the planning thread to the planner."""
        for result in self._thread.results():
            self._planner.take_result(result, time.monotonic())
        if not self._thread.busy:
            self._fetcher.cancel()
        self._carry_out()

    def _beat(self) -> None:
        """Publish the heartbeat with the planner's identity, session and publisher."""
        self._beats += 1
        message = Header(frame_id=f'{self._identity} {self._session().decode()} {self._publisher}')
        message.stamp.sec = self._beats
        self._alive.publish(message)

    # messages of the transformation task ------------------------------------------------------------------------------

    def _on_status(self, message: String) -> None:
        self._partners.received(TASK)
        before = self._session()
        if not self._planner.receive_status(Status.from_json(message.data), time.monotonic()):
            return
        if self._session() != before:
            self._outputs.discard_rows()
            self._beat()
        self._outputs.send_rows()
        self._carry_out()

    def _on_profile(self, message: Float64MultiArray) -> None:
        label, row = row_of(message)
        self._planner.receive_profile(Origin.from_label(label), row)

    def _on_verdict(self, message: String) -> None:
        self._planner.receive_verdict(Verdict.from_json(message.data), time.monotonic())
        self._carry_out()


def main() -> int:
    """Run the planner process."""
    return node_process.run_single(UnitRobotNode)
