"""Node of the controller's cyclic part: SERCOS master and transformation task.

Its topics and services are those of ``TASK`` in ``ros.wire.interfaces``; decisions are made in
``control.operation.robot_controller``. MDT, progress and diagnostics: here; AT: ``receivers``; cyclic topics, states
and outputs: ``outputs``; plans: ``planner_link``; services and control: ``clients.operator_services``; service channel
and scripts: ``wire.service_requests``.

It is longer than other nodes because it connects all of these, and implements the controller's callbacks.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from std_msgs.msg import String

from delta3_pacdrive.control.cycle.transformation import Command
from delta3_pacdrive.control.operation.cyclic_operation import Timing
from delta3_pacdrive.control.operation.robot_controller import RobotController
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.planning import learned_torques as learned
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.robot.faults.fault import TASK, Fault
from delta3_pacdrive.robot.sercos import master, telegrams
from delta3_pacdrive.robot.sercos.bus_time import ACYCLIC_SEC, Clock
from delta3_pacdrive.robot.sercos.service_requests import ServiceRequests
from delta3_pacdrive.robot.sercos.shared_clock import SharedClock
from delta3_pacdrive.robot.sercos.telegrams import NO_SESSION, progress_values
from delta3_pacdrive.robot.sercos.words import CONTROL_OFF, Phase
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.clients.operator_services import OperatorServices
from delta3_pacdrive.ros.fault_injection import FaultInjection, Faults
from delta3_pacdrive.ros.parameters import declare_own, declare_robot
from delta3_pacdrive.ros.task.belt_receiver import BeltReceiver
from delta3_pacdrive.ros.task.outputs import RobotOutputs, TaskOutputs
from delta3_pacdrive.ros.task.planner_link import PlannerLink
from delta3_pacdrive.ros.task.receivers import AtReceiver, InputReceiver
from delta3_pacdrive.ros.task.set_points import SetPointReceiver
from delta3_pacdrive.ros.wire import cdr
from delta3_pacdrive.ros.wire.announcements import receive_announcements
from delta3_pacdrive.ros.wire.diagnostics import Health
from delta3_pacdrive.ros.wire.interfaces import MDT, PHASE, PROGRESS, PROGRESS_VALUES, second_writer
from delta3_pacdrive.ros.wire.polling import PollingNode
from delta3_pacdrive.ros.wire.publishers import Output, TelegramOutput
from delta3_pacdrive.ros.wire.service_requests import ScriptRequests, offer_service_requests


class CommandSender:
    """Sends the MDT of the master; with ``torques`` they contain torques in addition to positions."""

    def __init__(self, node: Node, torques: bool, requests: ServiceRequests) -> None:
        self._requests = requests
        self._session = NO_SESSION
        self._last = b''
        self._frames: dict[tuple[int, float, int], bytes] = {}  # without service channel words
        self._torques, self._count = torques, len(requests.drives)
        self._idle = (0,) * self._count
        self._codec = cdr.codec(telegrams.mdt(torques, requests.drives))
        self.publish = cdr.raw_publish(MDT.publisher(node))  # takes an encoded MDT

    def begin(self, session: bytes) -> None:
        """Start sending in a session."""
        self._session = session
        self._last = b''
        self._frames.clear()

    def greet(self, greeting: master.Greet) -> None:
        """Greet the drives before cyclic operation."""
        words = self._requests.to_send()
        frame = telegrams.mdt_frame(greeting.phase, CONTROL_OFF, 0.0, greeting.session, words)
        self.publish(
            self._codec.encode((ACYCLIC_SEC, 0), frame, [0.0] * self._count * (2 if self._torques else 1))
        )

    def send(self, stamp: tuple[int, int], command: Command) -> None:
        """Send the MDT of a bus cycle."""
        motors, torques, control, payload, outputs = command
        if self._requests.busy:
            words = self._requests.to_send()
            frame = telegrams.mdt_frame(
                Phase.CP4, control, payload_kg=payload, session=self._session, service=words, outputs=outputs
            )
        else:
            known = self._frames.get((control, payload, outputs))
            frame = known or telegrams.mdt_frame(
                Phase.CP4,
                control,
                payload_kg=payload,
                session=self._session,
                service=self._idle,
                outputs=outputs,
            )
            self._frames[control, payload, outputs] = frame
        values = motors.tolist()
        if self._torques:
            values += torques.tolist()
        self._last = self._codec.encode(stamp, frame, values)
        self.publish(self._last)

    def repeat(self) -> None:
        """Send the newest MDT again as a heartbeat while the bus waits for a script."""
        if self._last:
            self.publish(self._last)


Facts = Callable[[], dict[str, Any]]
DIAGNOSTICS_S = 1.0


class ProgressReport:
    """Publishes progress on request, with statistics at the end of a program, and diagnostics once a second.

    ``stamp`` returns the stamp of a bus cycle.
    """

    def __init__(
        self,
        node: Node,
        period_s: float,
        progress: Callable[[], MotionProgress],
        statistics: Facts,
        stamp: Callable[[int], tuple[int, int]],
    ) -> None:
        self._node, self._newest, self._statistics, self._stamp = node, progress, statistics, stamp
        self._progress = Output(node, PROGRESS)
        self._values = TelegramOutput(node, PROGRESS_VALUES, progress_values(list(progress().numbers())))
        self._health = Health(node)
        self._health_every = round(DIAGNOSTICS_S / period_s)
        self._reports = 0

    def publish(self) -> None:
        """Publish to subscribers; statistics are included after the end of a program and with a fault."""
        if self._values.wanted and (progress := self._newest()).cycles:
            self._values.send(self._stamp(progress.cycles - 1), list(progress.numbers().values()))
        if self._progress.wanted:
            progress = self._newest()
            if progress.finished or progress.fault:
                progress = replace(progress, statistics=self._statistics())
            self._progress.publish(String(data=progress.to_json()))
        self._reports += 1
        if self._reports % self._health_every == 0 and self._health.wanted:
            self._send_health()

    def _send_health(self) -> None:
        progress = self._newest()
        level = DiagnosticStatus.ERROR if progress.fault else DiagnosticStatus.OK
        twice = str(second_writer(self._node) or '')
        if twice:
            self._node.get_logger().warning(twice, throttle_duration_sec=10.0)
            level = max(level, DiagnosticStatus.WARN)
        sentence = progress.fault or progress.waiting or twice or progress.phase
        self._health.send(level, sentence, progress.to_fields() | self._statistics() | {'strangers': twice})


KIND = 'transformation_task'
STARTUP_S = 0.02
PROGRESS_S, QUICK_PROGRESS_S = 0.2, 0.04  # with a clock, without one
FACTOR_MIN = 0.01  # of real time: slower cycles would look like lost telegrams


class TransformationTaskNode(PollingNode):
    """Connects the controller of one robot to the graph."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__(KIND, **node_options)
        own = declare_own(self, KIND)
        factor, clock_path = own['real_time_factor'], own['shared_clock']
        if 0.0 < factor < FACTOR_MIN:
            raise ParameterError(f'real_time_factor is {factor:g}, but must be 0 or at least {FACTOR_MIN:g}')
        parameters = declare_robot(self, KIND)
        cycle_time_s = parameters.bus.cycle_time_s
        period_s = cycle_time_s / factor if factor else 0.0
        report_s = PROGRESS_S if factor else QUICK_PROGRESS_S
        clock = Clock(cycle_time_s)
        faults = Faults(self, TASK, lambda: controller.next_cycle, lambda: controller.bus.session)
        self.controller = controller = RobotController(
            parameters=parameters,
            timing=Timing(
                period_s=period_s,
                poll_s=report_s,
                now_s=time.monotonic,
                now_ns=time.time_ns,
                shared_clock=SharedClock(clock_path, own['clock_member']) if clock_path else None,
            ),
            wait_for_program=own['wait_for_program'],
            faults=faults,
            callbacks=self,
            learned=learned.load(own['learned']) if own['learned'] else None,
        )
        if own['script_cycle'] >= 0:
            controller.gate.begins = own['script_cycle']
        self.stamp, self._cycles = clock.stamp, controller.cycles
        self.progress, self.statistics = controller.progress, controller.totals
        self.commands = CommandSender(self, parameters.sends_torque, controller.services)
        self._phases = PHASE.publisher(self)
        self._outputs = TaskOutputs(self, parameters, controller, own['joint_motion'])
        self._receiver = AtReceiver(self, clock, factor > 0.0, controller)
        self._inputs = InputReceiver(self, clock, factor > 0.0, controller, self._receiver.refuse)
        self._belts = BeltReceiver(self, clock, factor > 0.0, controller, self._receiver.refuse)
        offer_service_requests(self, controller, self.run_actions)
        self._injection = FaultInjection(self, controller, parameters)
        self._planner = PlannerLink(self, controller, self.run_actions)
        self._actions = RobotOutputs(self, controller, self._injection, self._planner, clock)
        self._operators = OperatorServices(
            self, parameters, controller, self.run_actions, self._planner.publish_status
        )
        self._set_points = SetPointReceiver(self, controller, period_s, cycle_time_s)
        self._scripts = ScriptRequests(self, controller, self.run_actions)
        receive_announcements(
            self, controller.receive_announcement, self.reject_telegram, controller.bus.names
        )
        self._reports = ProgressReport(self, report_s, controller.progress, controller.totals, clock.stamp)
        self._startup = self.create_timer(STARTUP_S, self._start_up)
        self._ticker = self.create_timer(period_s or STARTUP_S, self._tick, autostart=False)
        self.create_timer(report_s, self._look)

    # callbacks of the controller --------------------------------------------------------------------------------------

    def announce(self, announcement: master.Announce) -> None:
        """Announce a phase of the bus."""
        phase, session = announcement.phase, announcement.session
        self._phases.publish(cdr.phase_message(phase, session, self.stamp(announcement.cycle)))
        if not announcement.entered:
            return
        if phase != Phase.CP0 or self.controller.state.fault:
            self.get_logger().info(f'bus phase {phase.name}')
        self._receiver.session = NO_SESSION if phase == Phase.CP0 else session
        self.commands.begin(session)
        if phase == Phase.CP0:
            self._ticker.cancel()
            self._startup.reset()

    def greet(self, greeting: master.Greet) -> None:
        """Greet the drives before cyclic operation."""
        self.commands.greet(greeting)
        if greeting.phase >= Phase.CP3:  # the drives have reported their shaft positions
            self._outputs.greet()

    def start_ticks(self, delay_s: float) -> None:
        """Replace the start-up timer by that of the bus cycles, after a delay [s]."""
        time.sleep(delay_s)
        self._ticker.reset()
        self._startup.cancel()

    def send(self, cycle: int, command: Command) -> None:
        """Send the MDT of a bus cycle."""
        stamp = self.stamp(cycle)
        self.commands.send(stamp, command)
        if self._outputs.master.wanted:
            move, distance, speed = self.controller.task.progress()
            self._outputs.master.send(stamp, [distance, speed, float(move)])

    def publish_answers(self, cycle: int) -> None:
        """Publish the results of a bus cycle."""
        self._outputs.send(cycle, self.stamp(cycle))

    def run_actions(self) -> None:
        """Execute the actions of the robot state."""
        self._actions.carry_out()

    def publish_status(self) -> None:
        """Execute pending actions and publish all reports."""
        self._actions.carry_out()
        self._planner.publish_status()
        self._reports.publish()

    def reject_telegram(self, reason: str) -> None:
        """Count and log a rejected telegram."""
        self._receiver.refuse(reason)

    def check_faults(self, faults: Sequence[Fault]) -> None:
        """Check faults of a program before they are injected; raises ProgramError."""
        self._injection.check(faults)

    # timers -----------------------------------------------------------------------------------------------------------

    def _start_up(self) -> None:
        self._receiver.poll()
        self.controller.poll_start_up(second_writer(self))

    def _tick(self) -> None:
        self._receiver.poll()
        self._inputs.poll()
        self._belts.poll()
        self._set_points.poll()
        self._cycles.start_due()

    def _look(self) -> None:
        self.controller.poll(time.monotonic())
        if self.controller.gate.closed:
            self.commands.repeat()
        self._operators.check_heartbeat()
        self._set_points.publish()
        self.publish_status()


def main() -> int:
    """Run the transformation task process."""
    return node_process.run_single(TransformationTaskNode)
