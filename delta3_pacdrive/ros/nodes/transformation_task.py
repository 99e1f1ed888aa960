"""Node of the controller's cyclic part: SERCOS master and transformation task.

In: ``sercos/participants``, ``sercos/at/axisN``. Out: ``sercos/mdt``, ``sercos/phase``, ``following_error``,
``tcp/command``, ``tcp/actual``, ``tcp/error``, ``joint_states`` (100 Hz), ``motion/master`` (distance and speed along
the path, on request), ``motion/progress`` (JSON text, 5 Hz), ``/diagnostics`` (1 Hz). Plans: see ``planner_link``;
services and control: ``operator_services``; states and outputs: ``robot_outputs``; service channel: ``service_desk``.
"""

import math
import time
from dataclasses import asdict
from typing import Any

from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from delta3_pacdrive.controller.control import Control
from delta3_pacdrive.controller.cycle import Command, ControllerCycle, emergency_stop
from delta3_pacdrive.controller.orders import Orders
from delta3_pacdrive.controller.planner_watch import PlannerWatch
from delta3_pacdrive.controller.robot_state import RobotState
from delta3_pacdrive.controller.transformation import FOLLOWING_ERROR, TCP_ACTUAL, Transformation
from delta3_pacdrive.errors import ParameterError, RunError, UnreachableError
from delta3_pacdrive.faults.fault import AT_FAULTS, TASK, UNIT_ROBOT
from delta3_pacdrive.faults.telegram_faults import FaultyLink
from delta3_pacdrive.ros import cdr, node_process
from delta3_pacdrive.ros.announcements import hear_announcements
from delta3_pacdrive.ros.at_receiver import AtReceiver, Content
from delta3_pacdrive.ros.fault_injection import FaultDesk, Faults
from delta3_pacdrive.ros.operator_services import OperatorServices
from delta3_pacdrive.ros.parameters import declare, declare_robot, descriptor
from delta3_pacdrive.ros.phase_up import PhaseUp
from delta3_pacdrive.ros.planner_link import PlannerLink
from delta3_pacdrive.ros.polling import PollingNode
from delta3_pacdrive.ros.progress_report import ProgressReport
from delta3_pacdrive.ros.qos import CYCLIC_PUBLISHER, LATCHED
from delta3_pacdrive.ros.robot_outputs import RobotOutputs
from delta3_pacdrive.ros.service_requests import ServiceDesk
from delta3_pacdrive.ros.task_outputs import TaskOutputs
from delta3_pacdrive.sercos.answer_buffer import Inbox
from delta3_pacdrive.sercos.axis_monitor import AxisMonitor
from delta3_pacdrive.sercos.bus_time import ACYCLIC_SEC, NEVER, Clock
from delta3_pacdrive.sercos.configuration_check import DRIVES, PLANT, Identity
from delta3_pacdrive.sercos.participants import Announcement, Participants
from delta3_pacdrive.sercos.scheduler import Pacing
from delta3_pacdrive.sercos.statistics import BusStatistics
from delta3_pacdrive.sercos.telegrams import NO_SESSION, new_session
from delta3_pacdrive.sercos.watchdog import ANSWER_SILENT_S, BUS_SILENT_S, Watch
from delta3_pacdrive.sercos.words import CONTROL_OFF, Phase

STARTUP_S = 0.02
CALL_EVERY = 10  # looks at who is there, after which CP0 is announced once more
PROGRESS_S, QUICK_PROGRESS_S = 0.2, 0.04  # with a clock, without one
FACTOR_MIN = 0.01  # of real time: slower cycles would be taken for silence
AHEAD = 2  # cycles by which others answer later ones than a drive that is lost


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
        if 0.0 < factor < FACTOR_MIN:
            raise ParameterError(f'real_time_factor is {factor:g}, but must be 0 or at least {FACTOR_MIN:g}')
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
        self._cycles = Clock(bus.cycle_time_s)
        self._factor = factor
        self._pacing = Pacing(bus.cycle_time_s / factor if factor else 0.0, bus.outstanding_cycles_max)
        self._phase = Phase.CP0
        self._ticker: Any = None
        self._calls = 0

        self.next_cycle = 0  # to start
        self.answered = 0  # the next to be complete
        self._inbox: Inbox[Content] = Inbox()
        self._axes = AxisMonitor(parameters)
        self._statistics = BusStatistics(bus.outstanding_cycles_max)
        self._last_answer_s = 0.0
        self._report_s = PROGRESS_S if factor else QUICK_PROGRESS_S
        self._watch = Watch(self._report_s)
        self._wall_start_s = 0.0
        self._frames: dict[tuple[int, float], bytes] = {}

        self._mdt = cdr.mdt_codec()
        mdt = self.create_publisher(JointState, 'sercos/mdt', CYCLIC_PUBLISHER)
        self._publish_mdt = cdr.raw_publish(mdt)
        self._phase_publisher = self.create_publisher(Header, 'sercos/phase', LATCHED)
        self._outputs = TaskOutputs(self, parameters)
        self._receiver = AtReceiver(self, self._cycles, factor > 0.0, self._statistics, self._on_at)
        self._session = new_session()
        self._participants = Participants()
        self._participants.begin(self._session.decode())
        identity = Identity.of(parameters)
        self._phase_up = PhaseUp(self, self._participants, identity)
        self._desk = ServiceDesk(self, self._channel_closed)
        self._faults = Faults(self, TASK, lambda: self.next_cycle, lambda: self._session)
        self._link: FaultyLink[Content] = FaultyLink(self._faults, AT_FAULTS, self._receiver.refuse)
        fault_desk = FaultDesk(
            self, bus.cycle_time_s, self.closed, lambda: self.next_cycle, lambda: self._session
        )
        self._state = RobotState(self, self._task, self._axes)
        self._cycle = ControllerCycle(self._task, self._axes, parameters)
        self._control = Control(self._report_s)
        actions = RobotOutputs(self, self._state, self._task, fault_desk, self._desk, self._cycles)
        self._carry_out = actions.carry_out
        self._planners = PlannerWatch(self._report_s, identity)
        self._orders = Orders(parameters, self._state, self._control, self._planners, fault_desk.check)
        self._orders.begin_session(self._session.decode())
        self._planner = PlannerLink(
            self, self._orders, lambda: (self._phase.name, self.next_cycle), self._carry_out
        )
        actions.tell_course, actions.tell_status = self._planner.tell_course, self._planner.tell_status
        self._operators = OperatorServices(
            self,
            self._state,
            self._control,
            lambda: self._session,
            self._carry_out,
            self._planner.tell_status,
        )
        hear_announcements(self, self._on_announcement, self._receiver.refuse)
        self._reports = ProgressReport(self, self._report_s, self.progress, self.statistics)
        self._startup = self.create_timer(STARTUP_S, self._start_up)
        self.create_timer(self._report_s, self._report)

    # start-up ---------------------------------------------------------------------------------------------------------

    @property
    def _cyclic(self) -> bool:
        return self._phase == Phase.CP4

    def closed(self) -> str:
        """Say why nothing that needs cyclic operation can be done, empty if it can."""
        return '' if self._cyclic else f'the bus is in {self._phase.name}'

    def _channel_closed(self) -> str:
        """Say why the service channels are closed, empty from CP3 on."""
        return '' if self._phase >= Phase.CP3 else f'the bus is in {self._phase.name}'

    def waiting(self) -> str:
        """Say what the present phase waits for, empty if it waits for nothing."""
        return self._phase_up.waiting

    def stamp(self, cycle: int) -> tuple[int, int]:
        """Bus time of a cycle."""
        return self._cycles.stamp(cycle)

    def _enter(self, phase: Phase) -> None:
        self._phase = phase
        stamp = self._cycles.stamp(self.next_cycle)
        self._phase_publisher.publish(cdr.phase_message(phase, self._session, stamp))
        if phase != Phase.CP0 or self._state.fault:
            self.get_logger().info(f'bus phase {phase.name}')

    def _start_up(self) -> None:
        """Advance the phases of the bus; a greeting MDT goes out until every partner has answered."""
        self._receiver.poll(self._due)
        self._call()
        if self._phase != Phase.CP0 and (self._phase != Phase.CP2 or not self._state.fault):
            self._greet()
        if self._phase == Phase.CP3:
            if not self._wait_for_program or self._state.starts != NEVER:
                self._begin_cyclic_operation()
            return
        try:
            phase = self._phase_up.next(self._phase)
        except RunError as error:
            self._state.note(str(error))
            self._carry_out()
            return
        if phase == self._phase:
            return
        if phase == Phase.CP1:
            self._receiver.session = self._session
            self._frames.clear()
        if phase == Phase.CP3:
            self._prepare()
        else:
            self._enter(phase)

    def _call(self) -> None:
        """Announce the phase again and again: a participant does not obey while the last master may still be there."""
        if self._calls % CALL_EVERY == 0:
            stamp = self._cycles.stamp(self.next_cycle)
            self._phase_publisher.publish(cdr.phase_message(self._phase, self._session, stamp))
        self._calls += 1

    def _greet(self) -> None:
        words = self._desk.to_send()
        frame = cdr.mdt_frame(self._phase, CONTROL_OFF, 0.0, self._receiver.session, words)
        self._publish_mdt(self._mdt.encode((ACYCLIC_SEC, 0), frame, [0.0] * 3))
        self._outputs.greet()

    def _prepare(self) -> None:
        resting = self._phase_up.resting
        try:
            tcp = self._task.locate([resting[index] for index in range(3)])
        except UnreachableError as error:
            self._state.note(str(error))
            self._carry_out()
            return
        self._enter(Phase.CP3)
        if not self._state.fault:
            self._state.locate(tcp, self._first_cycle())
            self._carry_out()

    def _first_cycle(self) -> int:
        """First cycle of the cyclic operation to come: bus time never goes back."""
        return max(self.next_cycle, self._participants.bus_cycle)

    def _begin_cyclic_operation(self) -> None:
        self._startup.cancel()
        self.next_cycle = self.answered = self._first_cycle()
        if self.next_cycle or self._state.fault:
            self._task.enable_cycle = NEVER  # who comes back enables nothing by himself
        self._inbox.begin(self.next_cycle)
        self._link.clear()
        self._axes.begin()
        self._participants.close()
        self._enter(Phase.CP4)
        self._last_answer_s = time.monotonic()
        self._watch.heard(self._last_answer_s)
        self._pacing.begin(self.next_cycle, time.monotonic() + self._pacing.period_s)
        if self._ticker is None:
            self._wall_start_s = self._last_answer_s
            self._ticker = self.create_timer(self._pacing.period_s or STARTUP_S, self._tick)
        else:
            self._ticker.reset()

    def _on_announcement(self, announcement: Announcement) -> None:
        if announcement.name == UNIT_ROBOT:
            self._planners.announced(announcement.instance, announcement.identity)
        name = self._participants.announced(announcement)
        if not name:
            return
        reason = f'{name} was started again, or has left the bus, in bus cycle {self.answered}'
        if name == PLANT:
            self._go_down(reason)
        else:
            self._stop(reason)

    def _stop(self, reason: str, hard: bool = False) -> None:
        """Stop the TCP on its path for a fault that leaves the bus working, then disable the drives."""
        self._state.stop(reason, hard)
        self._carry_out()
        self._report()

    def _go_down(self, reason: str) -> None:
        """Let the phase fall to CP0, from where the bus comes up again as soon as everybody is there."""
        if not self._cyclic:
            self._state.note(reason)
            self._carry_out()
            return
        self._ticker.cancel()
        self._axes.begin()
        self._desk.close()
        self._state.lose_bus(reason)
        self._wait_for_program = False
        self._receiver.session = NO_SESSION
        self._session = new_session()
        self._participants.begin(self._session.decode())
        self._orders.begin_session(self._session.decode())
        self._calls = 0
        self._phase_up.begin()
        self._enter(Phase.CP0)
        self._carry_out()
        self._report()
        self._startup.reset()

    # cyclic operation -------------------------------------------------------------------------------------------------

    def _due(self, index: int) -> bool:
        """Whether an axis may have more to say; before cyclic operation nobody knows how often it answers."""
        return not self._cyclic or self._inbox.expected[index] < self.next_cycle

    def _tick(self) -> None:
        self._receiver.poll(self._due)
        self._start_cycles()

    def _start_cycles(self) -> None:
        while self._cyclic and self._pacing.may_start(
            self.next_cycle, self.next_cycle - self.answered, time.monotonic()
        ):
            cycle = self.next_cycle
            outstanding = cycle - self.answered
            if cycle >= self._faults.next_cycle:
                self._begin_faults(cycle)
            command = self._cycle.command(cycle)
            data = self._mdt.encode(self._cycles.stamp(cycle), self._frame(command), command.motors.tolist())
            self._statistics.sent(cycle, outstanding, self._pacing.late_s, time.time_ns())
            self._publish_mdt(data)
            if self._outputs.master.wanted:
                move, distance, speed = self._task.progress()
                self._outputs.master.send(self._cycles.stamp(cycle), [distance, speed, float(move)])
            self.next_cycle = cycle + 1
            self._state.commanded(cycle)
            if self._state.actions:
                self._carry_out()

    def _begin_faults(self, cycle: int) -> None:
        """Let injected faults happen; after a process that was frozen, time goes on as after any delay."""
        for fault, _ in self._faults.due(cycle):
            if fault.kind == 'emergency_stop':
                self._state.stop_for(emergency_stop(cycle))
                self._carry_out()

    def _frame(self, command: Command) -> bytes:
        """Frame of the MDT of a cycle."""
        control, payload = command.control, command.payload
        if self._desk.busy:
            return cdr.mdt_frame(Phase.CP4, control, payload, self._receiver.session, self._desk.to_send())
        frame = self._frames.get((control, payload))
        if frame is None:
            frame = cdr.mdt_frame(Phase.CP4, control, payload, self._receiver.session)
            self._frames[control, payload] = frame
        return frame

    def _on_at(self, index: int, cycle: int, content: Content, received_ns: int) -> None:
        if cycle < 0:
            if not self._cyclic:
                self._phase_up.resting[index] = content[0][0]
                self._desk.received(index, content[2])
            return
        if not self._cyclic:
            return
        if cycle >= self.next_cycle:
            self._go_down(f'{DRIVES[index]} went on to bus cycle {cycle} without the master (8506)')
            return
        for arrived, what in self._link.arrivals(DRIVES[index], cycle, content):
            if not self._cyclic:
                return
            if self._inbox.put(index, arrived, what):
                self._complete(received_ns)
            else:
                self._stop(
                    f'{DRIVES[index]}: two different AT of bus cycle {arrived}: who is the second writer?'
                )

    def _complete(self, received_ns: int) -> None:
        """Evaluate the cycles of which all answers are there, or known to be lost because a later one came."""
        inbox, state, desk = self._inbox, self._state, self._desk
        while (cycle := self.answered) < self.next_cycle and inbox.is_complete(cycle):
            answers = inbox.get(cycle)
            if desk.busy:
                for index, answer in enumerate(answers):
                    desk.received(index, None if answer is None else answer[2])
            self._statistics.answered(cycle, received_ns or time.time_ns())
            self._last_answer_s = time.monotonic()
            self._watch.heard(self._last_answer_s)
            self.answered = cycle + 1
            stop = self._cycle.evaluate(cycle, answers, state.checked_from, bool(state.fault))
            self._outputs.send(cycle, self._cycles.stamp(cycle), self._task.answer, self._axes)
            if stop is not None:
                state.stop_for(stop)
                self._carry_out()
                self._report()
            if cycle == state.ends:
                state.answered(cycle)
                self._carry_out()
                self._report()
            if self._axes.absent and self._task.enable_cycle == NEVER and not state.in_torque:
                self._go_down(state.fault)
                return
        if not self._pacing.period_s and self._cyclic:
            self._start_cycles()

    def _lose(self, index: int, reason: str) -> None:
        """Go on without a drive, to a stop; then the phase falls."""
        self._axes.drop(index)
        self._inbox.lose(index)
        self._stop(reason, hard=True)
        if len(self._axes.absent) == len(DRIVES):
            self._go_down(reason)
        else:
            self._complete(0)

    def earliest(self) -> int:
        """First cycle at which something may start: all outstanding cycles are over then, and the drives follow."""
        follow = self._task.enable_cycle + self._enabling_cycles if self._task.enable_cycle < NEVER else 0
        return (
            max(self.next_cycle + self._robot.bus.outstanding_cycles_max + 1, follow)
            if self.next_cycle
            else follow
        )

    # reports ----------------------------------------------------------------------------------------------------------

    def _check_planner(self) -> None:
        """Stop a program whose planner is lost: nobody could change its course any more."""
        reason = self._orders.look(time.monotonic())
        if reason:
            self._state.stop(f'{reason}, in bus cycle {self.answered}')
            self._carry_out()

    def _check_silence(self) -> None:
        silence = self._watch.silence_s(time.monotonic())
        if not self._cyclic or self.next_cycle == self.answered:
            self._watch.heard(time.monotonic())
            return
        silent = self._inbox.behind(self.answered)
        names = ', '.join(DRIVES[index] for index in silent)
        reason = f'no AT of {names} for {silence:.1f} s in bus cycle {self.answered} (8506)'
        if silence > ANSWER_SILENT_S and self._inbox.ahead(self.answered) > AHEAD:
            for index in silent:
                self._lose(index, reason)
        elif silence > BUS_SILENT_S:
            # where nobody can go on, or nobody may, the plant is as good a guess as the drives
            self._go_down(f'{reason}: is the plant running?')

    def progress(self) -> dict[str, Any]:
        """Return the present state of bus and program, as published in ``motion/progress``."""
        move, distance, speed = self._task.progress()
        cycle_time = self._robot.bus.cycle_time_s
        end = self._task.end_cycle
        operator = self._control.operator
        remaining = max(end - self.answered, 0) if end < NEVER else 0
        return {
            'session': self._session.decode(),
            'phase': self._phase.name,
            'waiting': self._phase_up.waiting,
            'fault': self._state.fault,
            'fault_cycle': self._state.fault_cycle,
            'state': str(self._state.motion),
            'finished': self._state.finished,
            'in_torque': self._state.in_torque,
            'enabled': self._state.enabled,
            'operator': operator.name if operator else '',
            'operator_identity': operator.identity if operator else '',
            'control': self._control.changes,
            'tcp_m': self._task.answer[TCP_ACTUAL].tolist() if self.answered else self._state.tcp_m.tolist(),
            'cycles': self.answered,
            'bus_time_s': self.answered * cycle_time,
            'wall_time_s': self._last_answer_s - self._wall_start_s,
            'move': move,
            'moves': self._task.moves,
            'end_s': (self._state.ends if self._state.ends < NEVER else self.answered) * cycle_time,
            'remaining_s': remaining * cycle_time,
            'master_m': distance,
            'master_speed_m_s': speed,
            'rate': 1.0 if self._task.course is None else self._task.course.rate,
            'outputs': self._task.outputs,
            'payload_kg': self._task.payload,
            'following_error_rad': max(abs(value) for value in self._task.answer[FOLLOWING_ERROR].tolist()),
            'overruns': self._pacing.overruns,
            'slip_s': self._pacing.slip_s,
            'lost_telegrams': self._inbox.lost,
            'repeated_telegrams': self._inbox.repeated,
        }

    def statistics(self) -> dict[str, Any]:
        """Return what the bus and the program did so far."""
        return {
            'at_losses': self._axes.losses,
            **self._statistics.summary(),
            'figures': asdict(self._task.figures()),
        }

    def _report(self) -> None:
        self._check_silence()
        self._check_planner()
        self._operators.look()
        self._state.look()
        self._carry_out()
        self._planner.tell_status()
        self._reports.publish()


def main() -> int:
    """Run the transformation task process."""
    return node_process.run_single(TransformationTaskNode)


if __name__ == '__main__':
    raise SystemExit(main())
