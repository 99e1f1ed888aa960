"""Node of UnitRobot, the planner: takes moves and programs, plans and checks them as a whole, starts and overrides.

In: ``motion/located`` (where the robot stands), ``motion/state``, ``motion/course``, ``motion/refusal`` of the
transformation task; requests of operators: ``unit_robot/program`` (String: YAML, or the name of a packaged program),
``unit_robot/move_l`` (PointStamped), ``unit_robot/move_c`` (Path: circle point, end), ``unit_robot/move_sb`` (Path of
at most 100 poses), ``unit_robot/override`` (Float64, percent). Out: ``motion/plan``, ``motion/change``,
``unit_robot/state`` (latched: idle, moving, stopping, stopped, error), ``unit_robot/answer`` (latched: one sentence
for each request), ``unit_robot/alive``. Services: ``start``, ``resume``, ``clear``.
"""

import traceback
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped
from nav_msgs.msg import Path
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, String
from std_srvs.srv import Trigger

from delta3_pacdrive import yaml_file
from delta3_pacdrive.bus.time import Clock
from delta3_pacdrive.errors import Delta3Error, ProgramError, TelegramError, shown
from delta3_pacdrive.injection import UNIT_ROBOT, Fault
from delta3_pacdrive.motion import planning
from delta3_pacdrive.motion import program as programs
from delta3_pacdrive.motion.plan import Plan
from delta3_pacdrive.motion.planning import Planned
from delta3_pacdrive.motion.program import Program
from delta3_pacdrive.motion.rejoin import left_of_plan, rejoin
from delta3_pacdrive.motion.timeline import NEVER, RATE_MAX, RATE_MIN, Course, Timeline
from delta3_pacdrive.nodes import runtime, telegram
from delta3_pacdrive.nodes.fault_desk import Faults
from delta3_pacdrive.nodes.motion_server import FAULT, ORDER, STANDING_M, MotionState, numbers
from delta3_pacdrive.nodes.participant import Participant
from delta3_pacdrive.nodes.planner_watch import Heartbeat
from delta3_pacdrive.nodes.polling import PollingNode
from delta3_pacdrive.nodes.qos import LATCHED, NEWEST, PLAN, REQUEST
from delta3_pacdrive.nodes.robot_parameters import declare, declare_robot, descriptor

LEAD_CYCLES = (
    60  # how far ahead a change of course is planned; four times as far each time that it came too late
)
LEAD_CYCLES_MAX = 4000
FAULTS_S = 0.05  # between two looks whether an injected fault is due
MATCH_S = 0.01  # between two looks whether the transformation task listens
PROGRAM_MAX = 1_000_000  # characters


class UnitRobotNode(PollingNode):
    """The non-cyclic part of the controller."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('unit_robot', **node_options)
        text = descriptor('program file, or the name of a packaged program; empty: none', 0, 0, str)
        path = declare(self, 'program', '', text)
        self._robot = declare_robot(self)
        self._cycles = Clock(self._robot.bus.cycle_time_s)
        self._queue: Program | None = programs.load(path, self._robot.motion) if path else None
        self._planned: Planned | None = None
        self._starts_by_itself = bool(path) and self._robot.motion.start_cycle >= 0
        self._here: np.ndarray[Any, Any] | None = None
        self._motion = MotionState.IDLE
        self._rate = 1.0
        self._running: Program | None = None  # the last one that was started
        self._failed = False  # a fault has stopped it
        self._cut_off: Timeline | None = None  # what a fault has left of it
        self._restartable: Program | None = None  # all of it, from its beginning
        self._timeline: Timeline | None = None
        self._rate_max = RATE_MAX
        self._lead = LEAD_CYCLES
        self._newest_cycle = 0
        self._wanted_rate: float | None = None  # of a change of course that the task has not taken yet

        self._state = self.create_publisher(String, 'unit_robot/state', LATCHED)
        self._answer = self.create_publisher(String, 'unit_robot/answer', LATCHED)
        self._plan = self.create_publisher(Float64MultiArray, 'motion/plan', PLAN)
        self._change = self.create_publisher(Float64MultiArray, 'motion/change', PLAN)
        self._state.publish(String(data=str(MotionState.IDLE)))
        self._take_joint_states = self.create_polled_subscription(JointState, 'joint_states', NEWEST)
        self._joint_states = telegram.joint_states_codec()
        self._subscribe(PointStamped, 'motion/located', self._on_located, LATCHED)
        self._subscribe(String, 'motion/state', self._on_state, LATCHED)
        self._subscribe(Float64MultiArray, 'motion/course', self._on_course, LATCHED)
        self._subscribe(String, 'motion/refusal', self._on_refusal, REQUEST)
        self._subscribe(String, 'unit_robot/program', self._on_program, REQUEST)
        self._subscribe(PointStamped, 'unit_robot/move_l', self._on_move_l, REQUEST)
        self._subscribe(Path, 'unit_robot/move_c', self._on_move_c, REQUEST)
        self._subscribe(Path, 'unit_robot/move_sb', self._on_move_sb, REQUEST)
        self._subscribe(Float64, 'unit_robot/override', self._on_override, REQUEST)
        self.create_service(Trigger, 'start', self._service(self._start))
        self.create_service(Trigger, 'resume', self._service(self._resume))
        self.create_service(Trigger, 'clear', self._service(self._clear))
        self._participant = Participant(self, UNIT_ROBOT, self._robot)
        self._heartbeat = Heartbeat(self)
        self._faults = Faults(self, UNIT_ROBOT, self._newest)
        self.create_timer(FAULTS_S, self._befall)
        self.get_logger().info('waiting for transformation_task')

    def _befall(self) -> None:
        if self._faults.next_cycle < NEVER:
            self._faults.begin_and_end(self._newest())

    # what every request has in common ---------------------------------------------------------------------------------

    def _subscribe(self, kind: Any, topic: str, callback: Callable[[Any], None], qos: Any) -> None:
        def receive(message: Any) -> None:
            try:
                callback(message)
            except Delta3Error as error:
                self._refuse(str(error))
            except Exception as error:  # noqa: BLE001 (no message, whoever sends it, ends the planner)
                self.get_logger().error(traceback.format_exc())
                self._refuse(f'{topic}: {type(error).__name__}: {shown(str(error))}')

        self.create_subscription(kind, topic, receive, qos)

    def _service(
        self, action: Callable[[], str]
    ) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                response.message = action()
                response.success = True
                self._say(response.message)
            except Delta3Error as error:
                response.message = str(error)
                self._refuse(response.message)
            return response

        return serve

    def _say(self, sentence: str) -> None:
        self.get_logger().info(sentence)
        self._answer.publish(String(data=f'accepted: {sentence}'))

    def _refuse(self, sentence: str) -> None:
        self.get_logger().error(sentence)
        self._answer.publish(String(data=f'refused: {sentence}'))

    # what the task tells ----------------------------------------------------------------------------------------------

    def _on_located(self, message: PointStamped) -> None:
        place = [message.point.x, message.point.y, message.point.z]
        if not np.isfinite(place).all():
            raise ProgramError(f'motion/located says {place}, which is no place')
        first = self._here is None
        self._here = np.array([message.point.x, message.point.y, message.point.z])
        if self._failed:
            self._cut_off, self._restartable = self._timeline, self._running
        self._failed = False
        self._timeline = None
        self._planned = None
        if first and self._queue is not None:
            sentence = self._plan_queue(self._queue)
            if self._starts_by_itself:
                self._starter = self.create_timer(MATCH_S, self._start_when_heard)
            else:
                self._say(sentence)

    def _start_when_heard(self) -> None:
        if not self._change.get_subscription_count():
            return
        self._starter.cancel()
        try:
            self._say(self._start())
        except Delta3Error as error:
            self._refuse(str(error))

    def _on_state(self, message: String) -> None:
        if message.data not in [str(state) for state in MotionState]:
            raise ProgramError(f'motion/state is {shown(message.data)}, which is no state')
        self._motion = MotionState(message.data)
        self._failed = self._failed or (self._motion == MotionState.ERROR and self._timeline is not None)
        self._state.publish(message)

    def _on_course(self, message: Float64MultiArray) -> None:
        """Follow the course that the task follows, its own stops included."""
        if self._timeline is None:
            return
        course = Course.from_array(message.data)
        if self._timeline.course is None:
            self._timeline.start(course.cycle, course.rate)
        elif (course.cycle, course.held) != (self._timeline.course.cycle, self._timeline.course.held):
            # a program that is held before it begins stops in the cycle of its start
            self._timeline.change(course)
        if self._wanted_rate is not None and not course.held:
            self._wanted_rate = None
            self._lead = LEAD_CYCLES

    def _on_refusal(self, message: String) -> None:
        if self._wanted_rate is not None and 'is over' in message.data and self._lead < LEAD_CYCLES_MAX:
            self._lead *= 4
            self._send_change(self._wanted_rate)
            return
        self._wanted_rate = None
        raise ProgramError(message.data)

    # moves and programs -----------------------------------------------------------------------------------------------

    def _require_rest(self) -> np.ndarray[Any, Any]:
        """Return where the robot stands; moves are taken only by a robot that is ready and stands."""
        if self._here is None:
            raise ProgramError('the transformation task has not located the robot yet')
        if self._motion != MotionState.IDLE or self._timeline is not None:
            raise ProgramError(f'the robot is {self._motion}: moves are taken when it is idle')
        return self._here

    def _plan_queue(self, program: Program) -> str:
        """Plan and check a queue, which replaces the present one only if all of it is possible."""
        planned = planning.plan(program, self._require_rest(), self._robot, returning=True)
        self._queue, self._planned = program, planned
        for notice in planned.notices:
            self.get_logger().warning(notice)
        moves, duration = len(planned.plan), planned.plan.duration_s
        slow = f'; {"; ".join(planned.notices)}' if planned.notices else ''
        return f'planned "{program.name}": {moves} moves, {duration:.3f} s{slow}'

    def _enqueue(self, document: Any) -> None:
        """Append statements to the queue."""
        more = programs.parse(document, self._robot.motion)
        self._require_rest()
        if self._queue is None:
            program = more
        elif self._queue.repeat > 1 or more.repeat > 1:
            raise ProgramError('a queue with a repeated program takes no other moves; clear it first')
        else:
            program = replace(
                self._queue,
                statements=self._queue.statements + more.statements,
                faults=self._queue.faults + more.faults,
            )
        self._say(self._plan_queue(program))

    def _on_program(self, message: String) -> None:
        if len(message.data) > PROGRAM_MAX:
            raise ProgramError(f'the program has {len(message.data)} characters, the limit is {PROGRAM_MAX}')
        if message.data in programs.packaged_names():
            document = yaml_file.read(programs.find(message.data), 'program file', ProgramError)
        else:
            document = yaml_file.parse(message.data, 'the program', ProgramError)
        self._enqueue(document)

    def _on_move_l(self, message: PointStamped) -> None:
        _require_base(message.header.frame_id)
        self._enqueue({'moves': [{'move_l': {'to_m': _point_of(message.point)}}]})

    def _on_move_c(self, message: Path) -> None:
        points = _points_of(message)
        if len(points) != 2:
            raise ProgramError(f'move_c takes two poses, circle point and end, not {len(points)}')
        self._enqueue({'moves': [{'move_c': {'via_m': points[0], 'to_m': points[1]}}]})

    def _on_move_sb(self, message: Path) -> None:
        self._enqueue({'moves': [{'move_sb': {'through_m': _points_of(message)}}]})

    def _clear(self) -> str:
        self._queue = self._planned = self._cut_off = self._restartable = None
        return 'the queue is empty'

    # running ----------------------------------------------------------------------------------------------------------

    def _start(self) -> str:
        self._require_rest()
        if self._queue is None and self._restartable is not None:
            self._queue = replace(self._restartable, faults=())  # injected faults happen once
        if self._queue is None:
            raise ProgramError('no moves are in the queue')
        if not self._change.get_subscription_count():
            raise ProgramError('the transformation task does not listen yet')
        program = self._queue
        here = self._require_rest()
        planned = self._planned or planning.plan(program, here, self._robot, returning=True)
        self._queue = self._planned = None
        self._rate_max = planned.rate_max
        self._running = program
        cycle = self._robot.motion.start_cycle if self._starts_by_itself else -1
        self._starts_by_itself = False
        duration = self._send(planned.plan, cycle, program.faults)
        return f'started "{planned.name}": {len(planned.plan)} moves, {duration:.3f} s'

    def _send(self, plan: Plan, cycle: int, faults: Sequence[Fault] = ()) -> float:
        """Send a plan to the transformation task, which starts it; return how long it takes [s]."""
        self._cut_off = self._restartable = None
        rate = min(self._rate, self._rate_max)
        for number, move in enumerate(plan.moves):
            self._plan.publish(numbers(move.to_array(number, len(plan.moves)), move.kind.name))
        for fault in faults:
            self._plan.publish(numbers(fault.to_row(), FAULT))
        self._plan.publish(
            numbers([cycle, rate, *plan.tables.order.tolist()], f'{ORDER} {self._heartbeat.identity}')
        )
        self._timeline = Timeline(plan, self._robot.bus.cycle_time_s)
        return plan.duration_s / rate

    def _resume(self) -> str:
        if self._motion == MotionState.STOPPED:
            self._send_change(self._rate)
            return 'resumed'
        if self._motion != MotionState.IDLE or self._cut_off is None:
            raise ProgramError(f'the robot is {self._motion}: only a stopped program can be resumed')
        return self._resume_after_fault(self._cut_off)

    def _resume_after_fault(self, timeline: Timeline) -> str:
        """Go back to the path on a straight line, then on along it; whoever was told to restart may still do so."""
        here = self._require_rest()
        on_path, moves = left_of_plan(timeline)
        if float(np.linalg.norm(here - on_path)) > STANDING_M:
            x, y, z = on_path.tolist()
            document = {'moves': [{'move_l': {'to_m': [x, y, z]}}]}
            program = programs.parse(document, self._robot.motion)
            way_back = planning.plan(program, here, self._robot, returning=True)
            moves = [*way_back.plan.moves, *moves]
        self._queue = self._planned = None
        duration = self._send(Plan.of(moves), -1)
        return f'resumed after the fault: {len(moves)} moves, {duration:.3f} s'

    def _on_override(self, message: Float64) -> None:
        percent = message.data
        if not 100.0 * RATE_MIN <= percent <= 100.0 * RATE_MAX:
            raise ProgramError(
                f'override is {percent:g} %, but must be between {100 * RATE_MIN:g} and {100 * RATE_MAX:g} %'
            )
        rate = percent / 100.0
        if (
            self._motion in (MotionState.MOVING, MotionState.STOPPING, MotionState.STOPPED)
            and rate > self._rate_max
        ):
            raise ProgramError(
                f'override is {percent:g} %, but the motors bear at most {100 * self._rate_max:.0f} % in this program'
            )
        self._rate = rate
        if self._motion == MotionState.MOVING:
            self._send_change(rate)
        self._say(f'override {percent:g} %')

    def _send_change(self, rate: float) -> None:
        """Plan how to go over to the plan at a rate from a bus cycle in the near future on, and send it to the task."""
        if self._timeline is None or self._timeline.course is None:
            raise ProgramError('the program that runs is not one of this planner')
        cycle = self._newest() + self._lead
        if self._motion == MotionState.STOPPED:
            cycle = max(cycle, self._timeline.end_cycle)
        cycle = max(cycle, self._timeline.course.cycle + 1)
        if not self._timeline.course.held and cycle >= self._timeline.end_cycle:
            return  # it is over before anything could change
        course = rejoin(self._timeline, cycle, rate)
        self._wanted_rate = rate
        self._change.publish(numbers(course.to_array(), 'COURSE'))

    def _newest(self) -> int:
        """Bus cycle of the newest joint states, which come every 10 ms of bus time."""
        while (taken := self._take_joint_states()) is not None:
            try:
                sec, nanosec, frame, _ = self._joint_states.decode(taken[0])
            except TelegramError:
                continue  # joints of somebody else: the topic belongs to everybody
            if frame != telegram.BASE_FRAME:
                continue
            self._newest_cycle = max(self._newest_cycle, self._cycles.count(sec, nanosec))
        return self._newest_cycle


def _require_base(frame: str) -> None:
    if frame != telegram.BASE_FRAME.decode():
        raise ProgramError(f'frame_id is {shown(frame)}, but must be "base"')


def _point_of(point: Any) -> list[float]:
    return [point.x, point.y, point.z]


def _points_of(message: Path) -> list[list[float]]:
    _require_base(message.header.frame_id)
    for pose in message.poses:
        if pose.header.frame_id:  # empty: that of the path
            _require_base(pose.header.frame_id)
    return [_point_of(pose.pose.position) for pose in message.poses]


def main() -> int:
    """Run the planner process."""
    return runtime.run_single(UnitRobotNode)


if __name__ == '__main__':
    raise SystemExit(main())
