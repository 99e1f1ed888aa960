"""Set points of other programs that steer the robot: velocities and positions of the TCP, with their stamps.

In: ``servo/twist``, ``servo/pose``, and ``servo/joint_jog`` where ``control_msgs`` is installed; only while the robot
is steered (service ``servo/enable``). Out: ``servo/state`` (state of the steering and newest rejection). A stamp is
the time of day, or bus time for senders with ``use_sim_time``. Two senders at once steer nothing: the robot stops.
"""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.serialization import deserialize_message

from delta3_pacdrive.belts.synchronization import Vector
from delta3_pacdrive.control.cycle.set_points import STANDSTILL_S, SetPoint, SetPointKind
from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.control.motion_state import sentence as motion_sentence
from delta3_pacdrive.control.operation.robot_controller import RobotController
from delta3_pacdrive.errors import Code, ProgramError, Reason, shown
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.ros.wire import frames, interfaces
from delta3_pacdrive.ros.wire.control_messages import joint_jog
from delta3_pacdrive.ros.wire.interfaces import Topic
from delta3_pacdrive.ros.wire.joint_trajectory import TIME_OF_DAY_SEC
from delta3_pacdrive.ros.wire.polling import PollingNode, Taken

SECOND_NS = 1_000_000_000
BYTES_MAX = 4096  # of a message
TAKEN_MAX = 2  # messages of a topic in one bus cycle: a flood must not delay the next cycle


class SetPointReceiver:
    """Receives the set points for one transformation task.

    ``period_s`` is the wall-clock time per bus cycle, 0 without a clock, ``cycle_time_s`` the bus time.
    """

    def __init__(
        self, node: PollingNode, controller: RobotController, period_s: float, cycle_time_s: float
    ) -> None:
        self._node, self._controller = node, controller
        self._period_s, self._cycle_time_s = period_s, cycle_time_s
        self._prefix, self._base = frames.prefix_of(node), frames.base_of(node)
        self._state = interfaces.SERVO_STATE.publisher(node)
        self._published: tuple[Any, ...] = ()
        self._newest: dict[str, tuple[int, float]] = {}  # by topic: number of the message, and bus time [s]
        self._conflict_s = -math.inf  # bus time of the last message of a second sender
        self._rejection, self._rejections = (
            '',
            0,
        )  # newest one since the begin of the steering, and their number
        self._was_steered = False
        self._inputs: list[tuple[Topic, SetPointKind, Callable[[Any], Vector], Any]] = [
            (topic, kind, read, topic.polled_subscription(node))
            for topic, kind, read in (
                (interfaces.SERVO_TWIST, SetPointKind.VELOCITY, velocity_of),
                (interfaces.SERVO_POSE, SetPointKind.POSITION, position_of),
                (joint_jog(), SetPointKind.ARM_SPEEDS, arm_speeds_of),
            )
            if topic is not None
        ]

    def poll(self) -> None:
        """Take the set points that have arrived."""
        for topic, kind, read, take in self._inputs:
            for _ in range(TAKEN_MAX):
                taken = take()
                if taken is None:
                    break
                reason = self._read(topic, kind, read, taken)
                if reason is not None:
                    self._reject(f'{topic.name}: {reason}')

    def _read(
        self, topic: Topic, kind: SetPointKind, read: Callable[[Any], Vector], taken: Taken
    ) -> Reason | None:
        """Take a serialised set point; return why it is rejected, None if it is not."""
        data, info = taken
        if len(data) > BYTES_MAX:
            return Reason(Code.CONTENT, f'a message has {len(data)} bytes, the limit is {BYTES_MAX}')
        try:
            message = deserialize_message(data, topic.type)
        except (RuntimeError, ValueError, UnicodeDecodeError) as error:
            return Reason(
                Code.CONTENT, f'a message is not a valid {topic.type.__name__}: {shown(str(error))}'
            )
        try:
            values = read(message)
        except ProgramError as error:
            return Reason.of(error)
        return self._take(topic, kind, message, values, info['publication_sequence_number'])

    @property
    def _now_s(self) -> float:
        """Bus time of the next command."""
        return self._controller.next_cycle * self._cycle_time_s

    def _take(
        self, topic: Topic, kind: SetPointKind, message: Any, values: Vector, number: int
    ) -> Reason | None:
        """Take a set point; return why it is rejected, None if it is not."""
        motion, task = self._controller.state.motion, self._controller.task
        if motion is not MotionState.STEERED:
            return Reason(
                Code.STATE, f'{motion_sentence(motion)}: the service servo/enable lets set points move it'
            )
        time_s = self._bus_time_s(message.header.stamp.sec, message.header.stamp.nanosec)
        if isinstance(time_s, Reason):
            return time_s
        frame = message.header.frame_id
        names = [self._prefix + belt.name for belt in task.tracking.belts]
        relative = names if kind is SetPointKind.VELOCITY else ()
        if kind is not SetPointKind.ARM_SPEEDS and frame not in ('', self._base, *relative):
            known = ', '.join([self._base, *names])
            return Reason(Code.CONTENT, f'frame_id is {shown(frame)}, but must be one of: {known}')
        point = SetPoint(kind, time_s, values, names.index(frame) if frame in relative else -1)
        if self._now_s - time_s < STANDSTILL_S and self._is_second(topic, number):
            return Reason(Code.CONTROL, 'two senders steer at once; the robot stops until only one is left')
        reason = task.servo.take(point, self._now_s)
        if reason is None:
            self._newest[topic.name] = number, self._now_s
        return reason

    def _bus_time_s(self, sec: int, nanosec: int) -> float | Reason:
        """Return the bus time of a stamp [s], or why it has none."""
        if sec == 0 and nanosec == 0:
            return Reason(Code.CONTENT, 'a set point needs a stamp')
        if sec < TIME_OF_DAY_SEC:
            return sec + nanosec / SECOND_NS
        if not self._period_s:
            return Reason(
                Code.CONTENT,
                'a robot without a clock needs stamps in bus time: the sender needs use_sim_time',
            )
        age_s = (time.time_ns() - sec * SECOND_NS - nanosec) / SECOND_NS
        # by the schedule, because a cycle may be late
        cycles = self._controller.cycles.scheduler.cycles_at(time.monotonic() - age_s)
        return cycles * self._cycle_time_s

    def _is_second(self, topic: Topic, number: int) -> bool:
        """Whether two senders steer: numbers of messages decrease only if there are two, or if one has restarted."""
        others = [at for name, (_, at) in self._newest.items() if name != topic.name]
        last, _ = self._newest.get(topic.name, (0, 0.0))
        two_kinds = any(self._now_s - at < STANDSTILL_S for at in others)
        if two_kinds or (number <= last and self._node.count_publishers(topic.name) > 1):
            self._conflict_s = self._now_s
        if number <= last:
            self._newest[topic.name] = number, self._now_s
        return self._now_s - self._conflict_s < STANDSTILL_S

    def _reject(self, reason: str) -> None:
        self._rejection, self._rejections = reason, self._rejections + 1
        self._node.get_logger().warning(reason, throttle_duration_sec=1.0)

    def publish(self) -> None:
        """Publish the state of the steering if it has changed."""
        steered = self._controller.task.servo.steered
        if steered.active and not self._was_steered:
            self._rejection, self._rejections = '', 0
        self._was_steered = steered.active
        steered = replace(steered, rejected=self._rejections)
        facts = (steered, self._rejection)
        if facts == self._published:
            return
        self._published = facts
        level = DiagnosticStatus.WARN if self._rejection else DiagnosticStatus.OK
        message = DiagnosticStatus(level=level, name='servo', message=self._rejection)
        message.values = [KeyValue(key=key, value=str(value)) for key, value in vars(steered).items()]
        self._state.publish(message)


def velocity_of(message: TwistStamped) -> Vector:
    """Return the linear velocity [m/s]; the angular one is not used."""
    linear = message.twist.linear
    return linear.x, linear.y, linear.z


def position_of(message: PoseStamped) -> Vector:
    """Return the position [m]; the orientation is not used."""
    place = message.pose.position
    return place.x, place.y, place.z


def arm_speeds_of(message: Any) -> Vector:
    """Return the speeds of the arms [rad/s], 0 for those without one; raises ProgramError."""
    names, speeds = list(message.joint_names), list(message.velocities)
    if len(message.displacements) or len(speeds) != len(names):
        raise ProgramError(
            f'a JointJog must have one velocity for each of its {len(names)} joints and no displacements'
        )
    for name in names:
        if name not in DRIVES or names.count(name) > 1:
            raise ProgramError(
                f'joint_names contains {shown(name)}, but must contain each of {", ".join(DRIVES)} at most once'
            )
    first, second, third = (speeds[names.index(name)] if name in names else 0.0 for name in DRIVES)
    return first, second, third
