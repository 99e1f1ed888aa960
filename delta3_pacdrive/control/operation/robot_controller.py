"""The controller of one robot: bus master, cyclic operation, robot state, and control by operators.

Pure: inputs arrive as calls, outputs go through ``ControllerCallbacks`` and the actions of ``RobotState``.
"""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

from delta3_pacdrive.belts.image import read_belts
from delta3_pacdrive.control.actions import Logged
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.control.operation.commissioning import Commissioning
from delta3_pacdrive.control.operation.control import Control
from delta3_pacdrive.control.operation.cyclic_operation import (
    Content,
    ControllerCallbacks,
    CyclicOperation,
    RobotParts,
    Timing,
)
from delta3_pacdrive.control.operation.enabling import Enabling
from delta3_pacdrive.control.operation.orders import Orders
from delta3_pacdrive.control.operation.planner_watch import PlannerWatch
from delta3_pacdrive.control.operation.robot_state import RobotState
from delta3_pacdrive.control.operation.script_gate import GateEvent, ScriptGate
from delta3_pacdrive.control.operation.script_service import ScriptService
from delta3_pacdrive.errors import Code, FaultCode, Reason, RobotFault, UnreachableError
from delta3_pacdrive.parameters import SERCOS_2, Parameters, numbered
from delta3_pacdrive.planning.learned_torques import Learned
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.robot.drive.operation_data import (
    CP3_CHECK,
    CP4_CHECK,
    INVALID_FOR_CP3,
    TABLE,
    refusal,
    times_to_write,
)
from delta3_pacdrive.robot.faults.fault import UNIT_ROBOT
from delta3_pacdrive.robot.faults.schedule import Schedule
from delta3_pacdrive.robot.sercos import master
from delta3_pacdrive.robot.sercos.axis_monitor import AxisMonitor
from delta3_pacdrive.robot.sercos.bus_time import NEVER
from delta3_pacdrive.robot.sercos.configuration_check import Identity
from delta3_pacdrive.robot.sercos.master import BusMaster
from delta3_pacdrive.robot.sercos.participants import Announcement
from delta3_pacdrive.robot.sercos.service_channel import Access, Answer, Operation, ServiceError, format_idn
from delta3_pacdrive.robot.sercos.service_requests import ServiceRequests
from delta3_pacdrive.robot.sercos.words import Phase

# procedure command of each drive before the next phase
TRANSITION_CHECKS = {
    Phase.CP2: Access(CP3_CHECK, Operation.COMMAND),
    Phase.CP3: Access(CP4_CHECK, Operation.COMMAND),
}
ALL_READY = Reason(Code.BUS, 'waiting for the robots that share its bus clock')


class RobotController:
    """Controller of one robot.

    Parameters
    ----------
    parameters
        Parameters of the robot.
    timing
        Clocks and periods.
    wait_for_program
        Whether to stay in CP3 until a program is loaded.
    faults
        Faults injected into the controller.
    callbacks
        Functions that act on the ROS graph.
    learned
        Learned torques of a program.

    """

    def __init__(
        self,
        parameters: Parameters,
        timing: Timing,
        wait_for_program: bool,
        faults: Schedule,
        callbacks: ControllerCallbacks,
        learned: Learned | None = None,
    ) -> None:
        bus, identity, drives = parameters.bus, Identity.of(parameters), parameters.axes
        self._parameters, self._callbacks, self.wait_for_program = parameters, callbacks, wait_for_program
        enabling_s = parameters.drive.enable_settle_s + parameters.motor.brake_release_s
        self._enabling_cycles = math.ceil(enabling_s / bus.cycle_time_s) + bus.outstanding_cycles_max
        self._start_s: float | None = None  # of the first cyclic operation
        self.task, self.axes = Transformation(parameters, learned), AxisMonitor(parameters)
        self.bus = BusMaster(identity, self._locate, drives=drives, checks=bus.timing == SERCOS_2)
        self.services = ServiceRequests(self.bus.channel_closed, drives)
        self.state = RobotState(self, self.task, self.axes)
        self.enabling = Enabling(self, self.task, self.axes, self.state)
        self.gate = ScriptGate(self.task, timing.period_s > 0.0, bus.cycle_time_s)
        self.cycles = CyclicOperation(
            parameters,
            timing,
            RobotParts(self.state, self.task, self.axes, self.services),
            faults=faults,
            callbacks=callbacks,
            gate=self.gate,
            fall=self._fall,
        )
        self._awaited: Reason | None = None  # additional condition for cyclic operation
        self.control = Control(timing.poll_s)
        self.planners = PlannerWatch(timing.poll_s, identity)
        self.orders = Orders(parameters, self.state, self.control, self.planners, callbacks.check_faults)
        self.orders.begin_session(self.bus.session.decode())
        self.commissioning = Commissioning(
            self,
            self.task,
            self.axes,
            self.state,
            self.control,
            services=self.services,
            parameters=parameters,
        )
        self.state.interrupt = self.commissioning.cancel
        self.scripts = ScriptService(
            state=self.state,
            task=self.task,
            cycles=self.cycles,
            gate=self.gate,
            orders=self.orders,
            control=self.control,
            in_position_cycles=parameters.in_position_cycles,
        )
        if parameters.motion.enable_cycle >= 0 and parameters.mounting.homed_at_start:
            self.task.enable(parameters.motion.enable_cycle)

    # the bus as required by RobotState --------------------------------------------------------------------------------

    @property
    def next_cycle(self) -> int:
        """Next cycle to start."""
        return self.cycles.next_cycle

    @property
    def answered(self) -> int:
        """First cycle without complete feedback."""
        return self.cycles.answered

    def closed(self) -> Reason | None:
        """Return why cyclic operation is not possible, None if it is."""
        return self.bus.closed()

    def waiting(self) -> Reason | None:
        """Return the condition that the present phase waits for, if any."""
        return self.bus.waiting or self._awaited or self.state.unavailable

    def earliest(self) -> int:
        """Return the first cycle in which a motion may start: no earlier cycle is outstanding, drives follow."""
        enabled = self.task.enable_cycle
        follow = enabled + self._enabling_cycles if enabled < NEVER else 0
        if not self.next_cycle:
            return follow
        return max(self.next_cycle + self._parameters.bus.outstanding_cycles_max + 1, follow)

    # phases -----------------------------------------------------------------------------------------------------------

    def poll_start_up(self, doubled: Reason | None) -> None:
        """Advance the phases of the bus; ``doubled`` names a second writer of a topic, if any."""
        ready = not self.wait_for_program or self.state.starts != NEVER
        first = self.next_cycle
        self._awaited = None
        if ready and self.bus.phase is Phase.CP3:
            begins = self.cycles.first_cycle()
            self._awaited = ALL_READY if begins is None else None
            first = first if begins is None else begins
        self._do(self.bus.poll(first, doubled, ready and self._awaited is None))

    def receive_announcement(self, announcement: Announcement) -> None:
        """Take the announcement of a bus participant or of a planner."""
        if announcement.name == UNIT_ROBOT:
            self.planners.receive_announcement(announcement.instance, announcement.identity)
        self._do(self.bus.announced(announcement, self.next_cycle, self.answered))

    def receive_greeting(self, index: int, content: Content) -> None:
        """Take the AT of an axis in reply to a greeting; those of bus cycles go to ``cycles``."""
        if not self.bus.cyclic:
            self.bus.positioned(index, content[0][0])
            self.services.received(index, content[2])

    def _locate(self, motor_positions_rad: Sequence[float]) -> Reason | None:
        if self.commissioning.unknown:
            motor_positions_rad = [0.0] * len(motor_positions_rad)  # until the axes are homed; a valid pose
        try:
            self.task.locate(motor_positions_rad)
        except UnreachableError as error:
            return Reason.of(error)
        return None

    def _fall(self, fault: RobotFault) -> None:
        self._do(self.bus.fall(fault, self.next_cycle))

    def _do(self, actions: Sequence[master.Action]) -> None:
        for action in actions:
            match action:
                case master.Announce():
                    self._announce(action)
                case master.Greet():
                    self._callbacks.greet(action)
                case master.Check(index, phase):
                    self._check_drive(index, phase)
                case master.RobotReady(cycle):
                    if not self.state.fault and not self.commissioning.unknown:
                        self.state.locate(self.task.state['tcp'][0], cycle)
                case master.Begin(cycle):
                    self._begin(cycle)
                case master.AbortCyclic(fault, session):
                    self._end_session(fault, session)
                case master.Note(fault):
                    self.state.record_fault(fault)
                case master.StopRobot(fault):
                    self.state.stop(fault)
                case master.Drop(index, fault):
                    self._exclude_drive(index, fault)
                case master.Wait(waiting):
                    self.state.actions.append(Logged(str(waiting)))
        if any(isinstance(action, (master.AbortCyclic, master.StopRobot, master.Drop)) for action in actions):
            self._callbacks.publish_status()
        elif self.state.actions:
            self._callbacks.run_actions()

    def _announce(self, action: master.Announce) -> None:
        self._callbacks.announce(action)
        if action.entered and action.phase is Phase.CP3 and self._parameters.bus.timing == SERCOS_2:
            self.state.actions.append(Logged(f'telegrams: {self._parameters.bus_timing.text}'))

    def _check_drive(self, index: int, phase: Phase) -> None:
        """Ask a drive for the transition check of a phase, before CP3 with the times of the telegrams."""
        if phase is Phase.CP2:
            for idn, value in times_to_write(self._parameters, index):
                # the check fails without a value that the drive rejects
                access = Access(idn, Operation.WRITE, value)
                self.services.ask_during_start_up(index, access, lambda *_: None)
        done = partial(self._transition_checked, phase)
        self.services.ask_during_start_up(index, TRANSITION_CHECKS[phase], done)

    def _transition_checked(self, phase: Phase, index: int, answer: Answer) -> None:
        reason = refusal(TRANSITION_CHECKS[phase], answer) if answer.error else ''
        if answer.error == ServiceError.COMMAND_NOT_EXECUTABLE and phase is Phase.CP2:
            done = partial(self._invalid_named, reason)
            self.services.ask_during_start_up(index, Access(INVALID_FOR_CP3, Operation.READ), done)
            return
        self._do(self.bus.transition_checked(index, phase, reason))

    def _invalid_named(self, reason: str, index: int, answer: Answer) -> None:
        """Report a failed check before CP3 with the value that the drive rejects."""
        row = TABLE.get(int(answer.value)) if not answer.error else None
        cause = f': {format_idn(row.idn)} {row.name} is missing or invalid' if row is not None else ''
        self._do(self.bus.transition_checked(index, Phase.CP2, f'{reason}{cause}'))

    def _begin(self, cycle: int) -> None:
        if cycle or self.state.fault:
            self.task.disable()  # after a fault or a restart nothing is enabled automatically
        self.axes.begin()
        self.task.follow_belts(read_belts(self.bus.belts))
        self.cycles.begin(cycle, self.bus.inputs)
        self.commissioning.begin()
        if self._start_s is None:
            self._start_s = self.cycles.last_answer_s

    def _end_session(self, fault: RobotFault, session: bytes) -> None:
        self.cycles.end()
        self.axes.begin()
        self.services.close()
        self.state.handle_bus_loss(fault)
        self.enabling.handle_bus_loss(fault)
        self.commissioning.handle_bus_loss()
        self.wait_for_program = False
        self.orders.begin_session(session.decode())

    def _exclude_drive(self, index: int, fault: RobotFault) -> None:
        """Continue without a drive, to a stop; then the phase falls."""
        self.axes.drop(index)
        self.cycles.answers.drop(index)
        self.state.stop(fault, hard=True)
        if len(self.axes.absent) == len(self.services.drives):
            self._fall(fault)
        else:
            self.cycles.complete()

    # supervision ------------------------------------------------------------------------------------------------------

    def poll(self, now_s: float) -> None:
        """Check the timeouts of drives, planner and scripts."""
        if self.state.fault:
            self.gate.handle(GateEvent.FAIL)  # the robot has to stop, so the bus no longer waits for a script
        self._check_drives(now_s)
        lost = self.orders.poll(now_s)
        if lost is not None:
            # the motion profile of the program could no longer be changed
            silent = lost.code is Code.SILENT
            code = FaultCode.PLANNER_SILENT if silent else FaultCode.PLANNER_RESTARTED
            sentence = f'{lost}, in bus cycle {self.answered}'
            self.state.stop(RobotFault(code, sentence, UNIT_ROBOT, cycle=self.answered))
        self.scripts.poll()
        self.cycles.complete()  # feedback that arrived while the bus waited for a script
        self.enabling.poll()
        self.commissioning.poll()

    def _check_drives(self, now_s: float) -> None:
        silence_s = self.cycles.watchdog.silence_s(now_s)
        answered, next_cycle = self.answered, self.next_cycle
        if not self.bus.cyclic or next_cycle == answered or self.gate.closed:
            self.cycles.watchdog.received(now_s)
            return
        answers, cycles = self.cycles.answers, self.cycles
        silent, ahead = answers.behind(answered), answers.ahead(answered)
        of_plant = 'the inputs' if cycles.belts.is_complete(answered) else 'the belts'
        self._do(self.bus.missed(silent, silence_s, ahead, next_cycle, answered=answered, of_plant=of_plant))

    # reports ----------------------------------------------------------------------------------------------------------

    def progress(self) -> MotionProgress:
        """Return the state of bus and program, as published in ``motion/progress``."""
        task, state, cycles = self.task, self.state, self.cycles
        move, distance, speed = task.progress()
        cycle_time, answered, end = self._parameters.bus.cycle_time_s, cycles.answered, task.end_cycle
        operator = self.control.operator
        place = task.answer['tcp_actual'] if answered else state.tcp_m if state.located else None
        remaining = max(end - answered, 0) if end < NEVER else 0
        stops = task.loaded and task.held  # the remaining time then depends on the resume
        turns: dict[str, Any] = {
            numbered('turn_rad', number): axis.feedback[1] for number, axis in enumerate(task.rotary)
        }
        return MotionProgress(
            session=self.bus.session.decode(),
            phase=self.bus.phase.name,
            waiting=str(self.waiting() or ''),
            missing=tuple(self.bus.missing),
            fault=str(state.fault or ''),
            **RobotFault.facts(state.fault),
            state=str(state.motion),
            finished=state.finished,
            settling=task.settling(answered - 1),
            in_torque=state.in_torque,
            enabled=state.enabled,
            operator=operator.name if operator else '',
            operator_identity=operator.identity if operator else '',
            control=self.control.changes,
            tcp_m=None if place is None else tuple(place.tolist()),
            cycles=answered,
            bus_time_s=answered * cycle_time,
            wall_time_s=cycles.last_answer_s - (self._start_s or 0.0),
            move=move,
            moves=task.moves,
            end_s=(state.ends if state.ends < NEVER else answered) * cycle_time,
            remaining_s=None if stops else remaining * cycle_time,
            master_m=distance,
            master_speed_m_s=speed,
            rate=1.0 if task.profile is None else task.profile.override,
            outputs=task.outputs,
            payload_kg=task.payload,
            following_error_rad=max(abs(value) for value in task.answer['following_error'].tolist()),
            overruns=cycles.scheduler.overruns,
            slip_s=cycles.scheduler.slip_s,
            lost_telegrams=cycles.answers.lost + cycles.inputs.lost,
            learned_torques=task.learned.exist,
            unlearned=task.learned.reason,
            repeated_telegrams=cycles.answers.repeated,
            **turns,
        )

    def totals(self) -> dict[str, Any]:
        """Return totals of bus and program."""
        return {
            'at_losses': self.axes.losses,
            'input_losses': self.cycles.inputs.lost,
            **self.cycles.statistics.summary(),
            'figures': self.task.figures().to_dict(),
        }
