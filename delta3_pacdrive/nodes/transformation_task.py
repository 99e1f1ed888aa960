"""Node of the controller's cyclic part: SERCOS master and transformation task.

In: ``sercos/participants``, ``sercos/at/axisN``. Out: ``sercos/mdt``, ``sercos/phase``, ``following_error``,
``tcp/command``, ``tcp/actual``, ``tcp/error``, ``joint_states`` (100 Hz), ``motion/master`` (distance and speed along
the path, on request), ``motion/progress`` (JSON text, 5 Hz), ``/diagnostics`` (1 Hz). Services: ``enable``,
``emergency_stop``, ``reset``. Programs, holds and outputs: see ``motion_server``; service channel: ``service_desk``.
"""

import json
import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PointStamped, Vector3Stamped
from sensor_msgs.msg import JointState
from std_msgs.msg import String, UInt8
from std_srvs.srv import SetBool, Trigger

from delta3_pacdrive.bus.pacing import Histogram, Pacing
from delta3_pacdrive.bus.phases import DRIVES, PARTICIPANTS, PLANT, Identity, disagreements, missing
from delta3_pacdrive.bus.service import Access, Answer, Operation, ServiceMaster
from delta3_pacdrive.bus.time import ACYCLIC_SEC, Clock
from delta3_pacdrive.bus.words import CONTROL_OFF, Phase, Status, in_torque
from delta3_pacdrive.errors import ProgramError, TelegramError, UnreachableError
from delta3_pacdrive.motion.timeline import NEVER
from delta3_pacdrive.nodes import runtime, telegram
from delta3_pacdrive.nodes.motion_server import MotionServer, MotionState
from delta3_pacdrive.nodes.output import Output, TelegramOutput
from delta3_pacdrive.nodes.participant import Roll
from delta3_pacdrive.nodes.polling import PollingNode, Taken
from delta3_pacdrive.nodes.qos import CYCLIC_PUBLISHER, CYCLIC_SUBSCRIPTION, LATCHED, REPORT
from delta3_pacdrive.nodes.robot_parameters import declare, declare_robot, descriptor
from delta3_pacdrive.nodes.service_desk import ServiceDesk
from delta3_pacdrive.transformation import (
    FOLLOWING_ERROR,
    TCP_ACTUAL,
    TCP_COMMAND,
    TCP_ERROR,
    THETA,
    Transformation,
)

STARTUP_S = 0.02
PROGRESS_S = 0.2
DIAGNOSTICS_EVERY = 5  # progress reports
JOINT_STATES_S = 0.01  # of bus time
SILENCE_S = 1.0
LOSSES_IN_A_ROW = 2
RESET_CLASS_1 = 99  # S-0-0099


class TransformationTaskNode(PollingNode):
    """One robot's master."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('transformation_task', **node_options)
        factor = declare(
            self,
            'real_time_factor',
            1.0,
            descriptor('bus time over wall time; 0 = as fast as possible', 0.0, 1e3, float),
        )
        self._wait_for_program = declare(
            self,
            'wait_for_program',
            False,
            descriptor(
                'stay in CP3 until a program is loaded, so that it starts at motion.start_cycle', 0, 1, bool
            ),
        )
        self._robot = parameters = declare_robot(self)
        bus, motion = parameters.bus, parameters.motion
        self._task = Transformation(parameters)
        self._task.enable_cycle = motion.enable_cycle if motion.enable_cycle >= 0 else NEVER
        enabling_s = parameters.drive.enable_settle_s + parameters.motor.brake_release_s
        self._enabling_cycles = math.ceil(enabling_s / bus.cycle_time_s) + bus.outstanding_cycles_max
        self._identity = Identity.of(parameters)
        self._cycles = Clock(bus.cycle_time_s)
        self._factor = factor
        self._pacing = Pacing(bus.cycle_time_s / factor if factor else 0.0, bus.outstanding_cycles_max)
        self._phase = Phase.CP0
        self._waiting = ''
        self._fault = ''
        self._down = False  # no more cycles
        self._supervised: list[int] = []

        self._cycle = 0  # next to start
        self._answered = 0  # next to be complete
        self._sent_ns = [0] * (4 * bus.outstanding_cycles_max)
        self._joint_states_every = max(1, round(JOINT_STATES_S / bus.cycle_time_s))
        self._inbox: list[dict[int, tuple[Any, bytes]]] = [{}, {}, {}]
        self._positions, self._torques = np.zeros(3), np.zeros(3)
        self._speeds = [0.0] * 3
        self._status = [0] * 3
        self._resting: dict[int, float] = {}
        self._refused = 0
        self._lost = 0
        self._expected = [0] * 3
        self._at_losses, self._losses_in_a_row = [0] * 3, [0] * 3
        self._lateness, self._outstanding, self._round_trip = Histogram(), [0] * 32, Histogram()
        self._last_answer_s = self._last_report_s = 0.0
        self._wall_start_s = 0.0

        self._service = [ServiceMaster() for _ in DRIVES]
        self._waiting_for: list[deque[Callable[[int, Answer], None]]] = [deque() for _ in DRIVES]
        self._accesses = 0  # under way in the service channels
        self._resets, self._reset_errors = 0, list[str]()

        self._create_outputs()
        self._create_inputs(poll=factor > 0.0)
        self.create_service(SetBool, 'enable', self._on_enable)
        self.create_service(Trigger, 'emergency_stop', self._on_emergency_stop)
        self.create_service(Trigger, 'reset', self._on_reset)
        self._desk = ServiceDesk(self, self._ask_drive)
        self._motion = MotionServer(self, self._task, parameters, self._earliest)
        self._set_phase(Phase.CP0)
        self._startup = self.create_timer(STARTUP_S, self._start_up)
        self.create_timer(PROGRESS_S, self._report)
        self._reports = 0

    def _create_outputs(self) -> None:
        def point(message_type: Any, topic: str) -> TelegramOutput:
            codec = telegram.StampedTripleCodec(message_type, len(telegram.BASE_FRAME))
            return TelegramOutput(self, message_type, topic, codec)

        self._mdt = telegram.mdt_codec()
        self._publish_mdt = telegram.raw_publish(
            self.create_publisher(JointState, 'sercos/mdt', CYCLIC_PUBLISHER)
        )
        self._answers = [
            (
                TelegramOutput(self, JointState, 'following_error', telegram.following_error_codec()),
                FOLLOWING_ERROR,
            ),
            (point(PointStamped, 'tcp/command'), TCP_COMMAND),
            (point(PointStamped, 'tcp/actual'), TCP_ACTUAL),
            (point(Vector3Stamped, 'tcp/error'), TCP_ERROR),
        ]
        self._joint_states = TelegramOutput(self, JointState, 'joint_states', telegram.joint_states_codec())
        self._master = point(Vector3Stamped, 'motion/master')
        self._phase_publisher = self.create_publisher(UInt8, 'sercos/phase', LATCHED)
        self._progress = Output(self, String, 'motion/progress', REPORT)
        self._diagnostics = Output(self, DiagnosticArray, '/diagnostics', REPORT)

    def _create_inputs(self, poll: bool) -> None:
        self._roll = Roll(self)
        self._pollers: list[tuple[Callable[[], Taken | None], Callable[..., None]]] = []
        for index, axis in enumerate(DRIVES):
            topic, receive = f'sercos/at/{axis}', self._on_at(index, telegram.at_codec(axis))
            if poll:
                # The clock drives this task, so that an answer need not wake it: it is read at the next tick.
                take = self.create_polled_subscription(JointState, topic, CYCLIC_SUBSCRIPTION)
                self._pollers.append((take, receive))
            else:
                self.create_subscription(
                    JointState, topic, partial(receive, received_ns=0), CYCLIC_SUBSCRIPTION, raw=True
                )

    # start-up ---------------------------------------------------------------------------------------------------------

    def _set_phase(self, phase: Phase) -> None:
        self._phase = phase
        self._phase_publisher.publish(UInt8(data=int(phase)))
        if phase != Phase.CP0:
            self.get_logger().info(f'bus phase {phase.name}')

    def _wait_for(self, reason: str) -> None:
        if reason != self._waiting:
            self._waiting = reason
            if reason:
                self.get_logger().info(reason)

    def _start_up(self) -> None:
        """Advance the phases of the bus; a greeting MDT goes out until every partner has answered."""
        self._poll()
        if self._phase == Phase.CP0:
            absent = missing(self._roll.identities)
            self._wait_for(f'waiting for {", ".join(absent)}' if absent else '')
            if not absent:
                self._set_phase(Phase.CP1)
        elif self._phase == Phase.CP1:
            self._greet()
            silent = [axis for index, axis in enumerate(DRIVES) if index not in self._resting]
            self._wait_for(f'waiting for an answer of {", ".join(silent)}' if silent else '')
            if not silent:
                self._set_phase(Phase.CP2)
        elif self._phase == Phase.CP2:
            sentences = disagreements(
                self._identity, {name: self._roll.identities[name] for name in PARTICIPANTS}
            )
            unlinked = [axis for axis in DRIVES if axis not in self._roll.links.get(PLANT, ())]
            self._wait_for(f'waiting for the plant to hear {", ".join(unlinked)}' if unlinked else '')
            if sentences:
                self._fail('; '.join(sentences))
            elif not unlinked:
                self._prepare()
        elif self._phase == Phase.CP3:
            self._greet()
            if not self._wait_for_program or self._motion.starts != NEVER:
                self._begin_cyclic_operation()

    def _greet(self) -> None:
        frame = telegram.mdt_frame(self._phase, CONTROL_OFF, 0.0)
        self._publish_mdt(self._mdt.encode((ACYCLIC_SEC, 0), frame, [0.0] * 3))
        for output, _ in self._answers:
            # who records knows by this that nothing of cyclic operation will pass it by
            output.send((ACYCLIC_SEC, 0), [0.0] * 3)
        self._master.send((ACYCLIC_SEC, 0), [0.0] * 3)

    def _prepare(self) -> None:
        try:
            tcp = self._task.locate([self._resting[index] for index in range(3)])
        except UnreachableError as error:
            self._fail(str(error))
            return
        self._set_phase(Phase.CP3)
        self._motion.locate(tcp, (0, 0))

    def _begin_cyclic_operation(self) -> None:
        self._startup.cancel()
        self._set_phase(Phase.CP4)
        self._wall_start_s = self._last_answer_s = time.monotonic()
        period = self._pacing.period_s or STARTUP_S
        self._ticker = self.create_timer(period, self._tick)

    # cyclic operation -------------------------------------------------------------------------------------------------

    def _poll(self) -> None:
        for index, (take, receive) in enumerate(self._pollers):
            # before cyclic operation nobody knows how many answers there are; then it is one per cycle
            while self._phase != Phase.CP4 or self._expected[index] < self._cycle:
                taken = take()
                if taken is None:
                    break
                receive(taken[0], taken[1]['received_timestamp'])

    def _tick(self) -> None:
        self._poll()
        self._start_cycles()

    def _start_cycles(self) -> None:
        while not self._down and self._pacing.may_start(
            self._cycle, self._cycle - self._answered, now := time.monotonic()
        ):
            cycle = self._cycle
            outstanding = cycle - self._answered
            self._lateness.add(self._pacing.lateness_s(cycle, now))
            self._outstanding[outstanding] += 1
            commands = self._task.command(cycle)
            frame = self._frame(cycle)
            data = self._mdt.encode(self._cycles.stamp(cycle), frame, commands.tolist())
            self._sent_ns[cycle % len(self._sent_ns)] = time.time_ns()
            self._publish_mdt(data)
            if self._master.wanted:
                move, distance, speed = self._task.progress()
                self._master.send(self._cycles.stamp(cycle), [distance, speed, float(move)])
            self._cycle = cycle + 1
            self._motion.commanded(cycle)

    def _frame(self, cycle: int) -> bytes:
        """Frame of the MDT of a cycle."""
        control, payload = self._task.control(cycle), self._task.payload
        if not self._accesses:
            return _frame_of(control, payload)
        return telegram.mdt_frame(
            Phase.CP4, control, payload, [channel.to_send() for channel in self._service]
        )

    def _on_at(self, index: int, codec: telegram.JointStateCodec) -> Callable[..., None]:
        inbox = self._inbox[index]

        def receive(data: bytes, received_ns: int) -> None:
            try:
                sec, nanosec, frame, values = codec.decode(data)
                cycle = self._cycles.count(sec, nanosec)
                if cycle >= self._cycle:
                    raise TelegramError(f'AT of cycle {cycle} before its MDT')
            except TelegramError as error:
                self._refused += 1
                self.get_logger().warning(f'{DRIVES[index]}: {error}', throttle_duration_sec=1.0)
                return
            if cycle < 0:
                self._resting[index] = values[0]
            elif cycle >= self._expected[index]:
                self._lost += cycle - self._expected[index]
                self._expected[index] = cycle + 1
                inbox[cycle] = (values, frame)
                self._complete(received_ns)

        return receive

    def _complete(self, received_ns: int) -> None:
        """Evaluate the cycles of which all answers are there, or known to be lost because a later one came."""
        first, second, third = self._expected
        while (cycle := self._answered) < first and cycle < second and cycle < third:
            for index, inbox in enumerate(self._inbox):
                answer_ = inbox.pop(cycle, None)
                if answer_ is None:
                    self._bridge(index, cycle)
                    if self._accesses:
                        self._take_service(index, None)
                    continue
                values, frame = answer_
                self._losses_in_a_row[index] = 0
                self._positions[index], self._speeds[index], self._torques[index] = values
                self._status[index], service = telegram.parse_at_frame(frame)
                if self._accesses:
                    self._take_service(index, service)
            self._round_trip.add(
                ((received_ns or time.time_ns()) - self._sent_ns[cycle % len(self._sent_ns)]) * 1e-9
            )
            self._last_answer_s = time.monotonic()
            self._answered = cycle + 1
            answer = self._task.receive(cycle, self._positions, self._torques)
            stamp = self._cycles.stamp(cycle)
            for output, columns in self._answers:
                if output.wanted:
                    output.send(stamp, answer[columns].tolist())
            if self._joint_states.wanted and cycle % self._joint_states_every == 0:
                self._send_joint_states(stamp)
            if self._motion.state != MotionState.IDLE or self._status != self._supervised:
                self._supervise(cycle)
        if not self._pacing.period_s and self._phase == Phase.CP4:
            self._start_cycles()

    def _ask_drive(self, index: int, access: Access, done: Callable[[int, Answer], None]) -> None:
        """Take a request of an operator; raises TelegramError."""
        if self._phase != Phase.CP4 or self._down:
            raise TelegramError(
                f'the service channel needs cyclic operation, the bus is in {self._phase.name}'
            )
        self._access(index, access, done)

    def _access(self, index: int, access: Access, done: Callable[[int, Answer], None]) -> None:
        """Ask a drive through its service channel; ``done`` is called with the answer some ten cycles later."""
        self._service[index].request(access)
        self._waiting_for[index].append(done)
        self._accesses += 1

    def _take_service(self, index: int, word: int | None) -> None:
        answer = self._service[index].received(word)
        if answer is not None:
            self._accesses -= 1
            self._waiting_for[index].popleft()(index, answer)

    def _bridge(self, index: int, cycle: int) -> None:
        """Go on without the AT of an axis: its shaft is extrapolated; two in a row are the master's fault 8506."""
        self._at_losses[index] += 1
        self._losses_in_a_row[index] += 1
        self._positions[index] += self._speeds[index] * self._robot.bus.cycle_time_s
        if self._losses_in_a_row[index] >= LOSSES_IN_A_ROW:
            self._stop(f'{DRIVES[index]}: two AT lost in a row in bus cycle {cycle} (8506)')

    def _supervise(self, cycle: int) -> None:
        motion = self._motion
        if self._status != self._supervised or cycle == motion.starts:
            self._supervised = list(self._status)
            for axis, status in zip(DRIVES, self._status, strict=True):
                if status & Status.ERROR:
                    self._stop(f'{axis} reports a fault in bus cycle {cycle}')
                elif cycle >= motion.starts and not in_torque(status):
                    self._stop(f'{axis} is not enabled in bus cycle {cycle}, in which a program runs')
        if cycle == motion.ends:
            motion.answered(cycle)
            self._report()

    def _send_joint_states(self, stamp: tuple[int, int]) -> None:
        theta = self._task.answer[THETA].tolist()
        ratio = self._robot.dynamics.gear_ratio
        speeds = [speed / ratio for speed in self._speeds]
        self._joint_states.send(stamp, [*theta, *speeds, *self._torques.tolist()])

    # requests ---------------------------------------------------------------------------------------------------------

    def _earliest(self) -> int:
        """First cycle at which something may start: all outstanding cycles are over then, and the drives follow."""
        follow = self._task.enable_cycle + self._enabling_cycles if self._task.enable_cycle < NEVER else 0
        return (
            max(self._cycle + self._robot.bus.outstanding_cycles_max + 1, follow) if self._cycle else follow
        )

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if request.data and self._fault:
            response.message = f'not after a fault: {self._fault}'
            return response
        self._task.enable_cycle = self._cycle if request.data else NEVER
        response.success = True
        response.message = f'effective in bus cycle {self._cycle + 1}'
        return response

    def _on_emergency_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Stop on the path, then take the torque off: stop category 1."""
        self._stop(f'emergency stop in bus cycle {self._cycle}')
        response.success, response.message = True, self._fault
        return response

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Clear the faults of all drives (S-0-0099); the robot is ready again where it stands, and not enabled."""
        if not self._fault or self._down or self._resets:
            response.message = (
                'there is no fault' if not self._fault else f'cannot be cleared now: {self._fault}'
            )
            return response
        self._resets = len(DRIVES)
        self._reset_errors = []
        for index in range(len(DRIVES)):
            self._access(index, Access(RESET_CLASS_1, Operation.COMMAND), self._on_reset_answer)
        response.success, response.message = True, f'S-0-0099 goes out from bus cycle {self._cycle} on'
        return response

    def _on_reset_answer(self, index: int, answer: Answer) -> None:
        self._resets -= 1
        if answer.error:
            self._reset_errors.append(f'{DRIVES[index]}: {answer.sentence}')
        if self._resets:
            return
        if self._reset_errors:
            self._motion.refuse('reset', ProgramError('; '.join(self._reset_errors)))
            return
        if any(in_torque(status) for status in self._status):
            self._motion.refuse('reset', ProgramError('a drive is in torque still'))
            return
        self._fault = ''
        self._task.enable_cycle = NEVER
        try:
            tcp = self._task.locate(self._positions)
        except UnreachableError as error:
            self._stop(str(error))
            return
        self.get_logger().info(f'faults cleared in bus cycle {self._answered}')
        self._motion.reset(tcp, self._cycles.stamp(self._answered))

    # reports ----------------------------------------------------------------------------------------------------------

    def _stop(self, reason: str) -> None:
        """Note a fault that leaves the bus working: the TCP stops on its path, then all drives are disabled."""
        if not self._fault:
            self._fault = reason
            self.get_logger().error(reason)
            self._motion.fail()
            self._report()

    def _fail(self, reason: str) -> None:
        """Note a fault after which there are no more cycles."""
        self._down = True
        self._stop(reason)

    def _check_silence(self) -> None:
        now = time.monotonic()
        blocked = now - self._last_report_s > 2.0 * PROGRESS_S
        self._last_report_s = now
        if self._phase != Phase.CP4 or self._down or self._cycle == self._answered:
            return
        if blocked:
            # this process itself was held up, and may not have read what came meanwhile
            self._last_answer_s = now
        silence = now - self._last_answer_s
        if silence > SILENCE_S:
            silent = [
                axis for axis, inbox in zip(DRIVES, self._inbox, strict=True) if self._answered not in inbox
            ]
            hint = ' (is the plant running?)' if len(silent) == len(DRIVES) else ''
            self._fail(
                f'no AT of {", ".join(silent)} for {silence:.1f} s in bus cycle {self._answered}{hint}'
            )

    def progress(self) -> dict[str, Any]:
        """Return the present state of bus and program, as published in ``motion/progress``."""
        move, distance, speed = self._task.progress()
        cycle_time = self._robot.bus.cycle_time_s
        end = self._task.end_cycle
        remaining = max(end - self._answered, 0) if end < NEVER else 0
        return {
            'phase': self._phase.name,
            'waiting': self._waiting,
            'fault': self._fault,
            'state': str(self._motion.state),
            'finished': self._motion.finished,
            'in_torque': any(in_torque(status) for status in self._status),
            'cycles': self._answered,
            'bus_time_s': self._answered * cycle_time,
            'wall_time_s': self._last_answer_s - self._wall_start_s,
            'move': move,
            'moves': self._task.moves,
            'end_s': (self._motion.ends if self._motion.ends < NEVER else self._answered) * cycle_time,
            'remaining_s': remaining * cycle_time,
            'master_m': distance,
            'master_speed_m_s': speed,
            'rate': 1.0 if self._task.course is None else self._task.course.rate,
            'outputs': self._task.outputs,
            'payload_kg': self._task.payload,
            'following_error_rad': max(abs(value) for value in self._task.answer[FOLLOWING_ERROR].tolist()),
            'overruns': self._pacing.overruns,
            'lost_telegrams': self._lost,
        }

    def statistics(self) -> dict[str, Any]:
        """Return what the bus and the program did so far."""
        return {
            'slip_s': self._pacing.slip_s,
            'refused_telegrams': self._refused,
            'at_losses': self._at_losses,
            'lateness_ms': self._lateness.summary_ms(),
            'outstanding': self._outstanding[: self._robot.bus.outstanding_cycles_max + 1],
            'mdt_to_last_at_ms': self._round_trip.summary_ms(),
            'figures': asdict(self._task.figures()),
        }

    def _report(self) -> None:
        self._check_silence()
        if self._progress.wanted:
            facts = self.progress()
            if self._motion.finished or self._fault:
                facts |= self.statistics()
            self._progress.publish(String(data=json.dumps(facts)))
        self._reports += 1
        if self._reports % DIAGNOSTICS_EVERY == 0 and self._diagnostics.wanted:
            self._publish_diagnostics()

    def _publish_diagnostics(self) -> None:
        level = DiagnosticStatus.ERROR if self._fault else DiagnosticStatus.OK
        status = DiagnosticStatus(level=level, name=self.get_fully_qualified_name())
        status.message = self._fault or self._waiting or self._phase.name
        facts = self.progress() | self.statistics()
        status.values = [
            KeyValue(key=key, value=value if isinstance(value, str) else json.dumps(value))
            for key, value in facts.items()
        ]
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)


_FRAMES: dict[tuple[int, float], bytes] = {}


def _frame_of(control: int, payload_kg: float) -> bytes:
    """Frame of a cyclic MDT; made once per control word and payload."""
    frame = _FRAMES.get((control, payload_kg))
    if frame is None:
        frame = _FRAMES[control, payload_kg] = telegram.mdt_frame(Phase.CP4, control, payload_kg)
    return frame


def main() -> int:
    """Run the transformation task process."""
    return runtime.run_single(TransformationTaskNode)


if __name__ == '__main__':
    raise SystemExit(main())
