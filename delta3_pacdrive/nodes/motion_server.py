"""The side of the transformation task that faces planner and operator: programs, their course, holds and outputs.

In: ``motion/plan`` (moves and their order), ``motion/change`` (courses from the planner). Out, latched:
``motion/state`` (idle, moving, stopping, stopped, error), ``motion/course`` (what the master follows from which cycle
on), ``motion/located`` (where the robot stands, when it can take a program), ``outputs`` (digital outputs and
payload); not latched: ``motion/refusal`` (why a plan or a course was refused). Services: ``hold``, ``abort``.
"""

from array import array
from collections.abc import Callable
from enum import StrEnum
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String
from std_srvs.srv import Trigger

from delta3_pacdrive.bus.time import Clock
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.injection import Fault
from delta3_pacdrive.motion.checks import check_reach, check_speed
from delta3_pacdrive.motion.plan import OUTPUTS, Move, Plan
from delta3_pacdrive.motion.timeline import NEVER, RATE_MAX, RATE_MIN, Course
from delta3_pacdrive.nodes import telegram
from delta3_pacdrive.nodes.fault_desk import LEAD_CYCLES, FaultDesk
from delta3_pacdrive.nodes.qos import LATCHED, PLAN, REQUEST
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.transformation import Transformation

STANDING_M = 1e-6  # how far a plan may start from where the TCP stands
FAULT = 'FAULT'  # label of a message with a fault of the program
# label of the message that ends a plan, and behind a space the identity of the planner, if it can be watched over:
# start cycle (-1: as soon as possible), rate, numbers of moves
ORDER = 'ORDER'
ORDER_HEADER = 2
START_CYCLES_MAX = 1_000_000  # how far ahead a program may be told to start


class MotionState(StrEnum):
    """What UnitRobot and the transformation task are doing with the TCP."""

    IDLE = 'idle'
    MOVING = 'moving'
    STOPPING = 'stopping'
    STOPPED = 'stopped'
    ERROR = 'error'


def numbers(values: Any, label: str) -> Float64MultiArray:
    """Return a row of numbers as a message."""
    row = np.asarray(values, dtype=np.float64)
    message = Float64MultiArray(data=array('d', row.tobytes()))
    message.layout.dim = [MultiArrayDimension(label=label, size=len(row), stride=len(row))]
    return message


class MotionServer:
    """Programs of one transformation task.

    Attributes
    ----------
    state
        What happens now.
    starts
        Cycle at which the program begins.
    ends
        Last cycle whose answer belongs to the program, ``NEVER`` while none is under way or it is held.
    finished
        Whether a program came to its end.
    planner
        Identity of the planner whose program is loaded, empty if it told none.

    """

    def __init__(
        self,
        node: Node,
        task: Transformation,
        robot: Parameters,
        earliest: Callable[[], int],
        faults: FaultDesk,
        misplanned: Callable[[], str],
    ) -> None:
        self._misplanned = misplanned
        self._node, self._task, self._robot, self._faults = node, task, robot, faults
        self._cycles = Clock(robot.bus.cycle_time_s)
        self._earliest = earliest
        self.state = MotionState.IDLE
        self.starts, self.ends = NEVER, NEVER
        self.finished = False
        self.planner = ''
        self._ready = False  # whether the robot has been located
        self._parts: list[Move] = []
        self._planned_faults: list[Fault] = []
        self._aborting = False
        self._outputs, self._payload = task.outputs, task.payload
        self._told: Course | None = None  # the course that was published last
        self._due = NEVER  # command cycle at which something ends
        self._state_publisher = node.create_publisher(String, 'motion/state', LATCHED)
        self._course = node.create_publisher(Float64MultiArray, 'motion/course', LATCHED)
        self._refusal = node.create_publisher(String, 'motion/refusal', REQUEST)
        self._located = node.create_publisher(PointStamped, 'motion/located', LATCHED)
        self._outputs_publisher = node.create_publisher(JointState, 'outputs', LATCHED)
        node.create_subscription(Float64MultiArray, 'motion/plan', self._on_plan, PLAN)
        node.create_subscription(Float64MultiArray, 'motion/change', self._on_change, PLAN)
        node.create_service(Trigger, 'hold', self._on_hold)
        node.create_service(Trigger, 'abort', self._on_abort)
        self._enter(MotionState.IDLE)

    def locate(self, tcp: Any, stamp: tuple[int, int]) -> None:
        """Tell the planner where the robot stands: it can take a program."""
        self._ready = True
        message = PointStamped()
        message.header.frame_id = telegram.BASE_FRAME.decode()
        message.header.stamp.sec, message.header.stamp.nanosec = stamp
        message.point.x, message.point.y, message.point.z = (float(value) for value in tcp)
        self._located.publish(message)
        self._publish_outputs(stamp)

    def fail(self) -> None:
        """Give the program up: the task stops it and takes the torque off; only a reset leads out of this state."""
        self.starts = self.ends = self._due = NEVER
        self._enter(MotionState.ERROR)

    def commanded(self, cycle: int) -> None:
        """Look at what the command of a cycle has brought about."""
        task = self._task
        if task.outputs != self._outputs or task.payload != self._payload:
            self._outputs, self._payload = task.outputs, task.payload
            self._publish_outputs(self._cycles.stamp(cycle))
        if self.state == MotionState.ERROR and task.loaded and task.course is not self._told:
            self._tell_course()
        if cycle >= self._due:
            self._due = NEVER
            if self._aborting:
                self._aborting = False
                task.unload()
                self.starts = NEVER
                self._enter(MotionState.IDLE)
                self.locate(task.state['tcp'][0], self._cycles.stamp(cycle))
            elif task.held:
                self._enter(MotionState.STOPPED)

    def answered(self, cycle: int) -> None:
        """Note that the last answer of a program is there."""
        self.starts = self.ends = self._due = NEVER
        self.finished = True
        self._task.unload()
        self._enter(MotionState.IDLE)
        self.locate(self._task.state['tcp'][0], self._cycles.stamp(cycle))

    def _enter(self, state: MotionState) -> None:
        self.state = state
        self._state_publisher.publish(String(data=str(state)))

    def reset(self, tcp: Any, stamp: tuple[int, int]) -> None:
        """Leave the state of error: the robot stands at a place, and no program is loaded."""
        self._task.unload()
        self._aborting = False
        self.starts = self.ends = self._due = NEVER
        self._enter(MotionState.IDLE)
        self.locate(tcp, stamp)

    def refuse(self, what: str, error: ProgramError) -> None:
        """Say why something was refused."""
        self._node.get_logger().error(f'{what} refused: {error}')
        self._refusal.publish(String(data=f'{what} refused: {error}'))

    def _publish_outputs(self, stamp: tuple[int, int]) -> None:
        message = JointState(name=[*OUTPUTS, 'payload_kg'])
        message.header.stamp.sec, message.header.stamp.nanosec = stamp
        bits = self._task.outputs
        message.position = [*(float(bits >> n & 1) for n in range(len(OUTPUTS))), self._task.payload]
        self._outputs_publisher.publish(message)

    # programs ---------------------------------------------------------------------------------------------------------

    def _on_plan(self, message: Float64MultiArray) -> None:
        try:
            if not self._ready or self.state != MotionState.IDLE or self.starts != NEVER:
                raise ProgramError(f'the robot is {self.state if self._ready else "not ready"}')
            if self._task.enable_cycle == NEVER:
                raise ProgramError('the drives are not enabled')
            row = np.frombuffer(message.data, dtype=np.float64)
            label, _, planner = (
                message.layout.dim[0].label.partition(' ') if message.layout.dim else ('', '', '')
            )
            if label == ORDER:
                self._start(row, planner)
                self.planner = planner
                return
            if label == FAULT:
                self._planned_faults.append(Fault.from_row(row.tolist()))
                return
            move, number, count = Move.from_array(row)
            check_reach(move, self._robot, returning=number == 0)
            check_speed(move, 1.0, self._robot)
            if number == 0:
                self._parts, self._planned_faults = [], []
            if number != len(self._parts):
                raise ProgramError(f'plan message {number} of {count} came where {len(self._parts)} was due')
            self._parts.append(move)
        except ProgramError as error:
            self._parts, self._planned_faults = [], []
            self.refuse('plan', error)

    def _start(self, row: Any, planner: str) -> None:
        moves, self._parts = self._parts, []
        faults, self._planned_faults = self._planned_faults, []
        if len(row) <= ORDER_HEADER or not np.isfinite(row).all() or (row[ORDER_HEADER:] % 1.0).any():
            raise ProgramError('the order of a plan must be whole numbers behind a start cycle and a rate')
        cycle, rate = row[:ORDER_HEADER].tolist()
        if not RATE_MIN <= rate <= RATE_MAX:
            raise ProgramError(
                f'the rate of an order is {rate:g}, but must be between {RATE_MIN:g} and {RATE_MAX:g}'
            )
        latest = self._task.next_cycle + START_CYCLES_MAX
        if not -1 <= cycle <= latest:
            raise ProgramError(
                f'an order starts in bus cycle {cycle:g}, but must be between 0 and {latest}, or -1'
            )
        if rate > 1.0:
            for move in moves:
                check_speed(move, rate, self._robot)
        disagreement = self._misplanned() if planner else ''
        if disagreement:
            raise ProgramError(f'it was planned for another robot: {disagreement}')
        if not moves:
            raise ProgramError('an order came without moves')
        plan = Plan.of(moves, row[ORDER_HEADER:])
        plan.require_joined()  # so that a move that begins beyond limits can only be driven first, and once
        away = float(np.linalg.norm(plan.start_m() - self._task.state['tcp'][0]))
        if away > STANDING_M:
            raise ProgramError(f'it starts {away * 1e3:.3f} mm away from where the robot stands')
        self._faults.check(faults)
        self._task.load(plan)
        self.finished = False
        self.starts = max(int(cycle), self._earliest())
        if faults:
            self.starts = max(self.starts, self._task.next_cycle + LEAD_CYCLES)
        self._task.start(self.starts, rate)
        self._follow()
        self._faults.inject(faults, self.starts)
        self._node.get_logger().info(f'program of {len(plan)} moves starts in bus cycle {self.starts}')
        self._enter(MotionState.MOVING)

    def _follow(self) -> None:
        """Publish the present course, and note when it ends."""
        task = self._task
        self._due = task.end_cycle if task.held else NEVER
        self.ends = NEVER if task.held else task.last_cycle
        self._tell_course()

    def _tell_course(self) -> None:
        self._told = self._task.course
        if self._told is not None:
            self._course.publish(numbers(self._told.to_array(), 'COURSE'))

    def _on_change(self, message: Float64MultiArray) -> None:
        try:
            if self.state not in (MotionState.MOVING, MotionState.STOPPED):
                raise ProgramError(f'the robot is {self.state}')
            course = Course.from_array(np.frombuffer(message.data, dtype=np.float64))
            if self.state == MotionState.STOPPED:
                # who stands has time: an order that came late is as good as one in time
                course = course.at_cycle(max(course.cycle, self._earliest()))
            self._task.change(course)
        except ProgramError as error:
            self.refuse('course', error)
            return
        self.ends = self._task.coming_last_cycle
        self._due = NEVER
        self._told = course
        self._course.publish(numbers(course.to_array(), 'COURSE'))
        self._enter(MotionState.MOVING)

    def _on_hold(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.state == MotionState.MOVING:
            course = self._task.hold()
            self._follow()
            self._enter(MotionState.STOPPING)
            response.success = True
            response.message = (
                f'stops from bus cycle {course.cycle} on, in cycle {self._task.end_cycle} it stands'
            )
        else:
            response.message = f'the robot is {self.state}'
        return response

    def _on_abort(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.state == MotionState.MOVING:
            self._on_hold(request, response)
        elif self.state in (MotionState.STOPPING, MotionState.STOPPED):
            self._due = min(self._due, self._task.end_cycle)
            response.success, response.message = True, 'the program is given up'
        else:
            response.message = f'the robot is {self.state}'
            return response
        self._aborting = True
        return response
