"""The controller of one robot: the master of the bus, its cycles, the state of the robot, and who may change it.

Pure: inputs arrive as calls, outputs go through ``ControllerCallbacks`` and the actions of ``RobotState``.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from delta3_pacdrive.controller.belt_axes import read_belts
from delta3_pacdrive.controller.control import Control
from delta3_pacdrive.controller.cyclic_operation import Content, CycleCallbacks, CyclicOperation
from delta3_pacdrive.controller.enabling import Enabling
from delta3_pacdrive.controller.orders import Orders
from delta3_pacdrive.controller.planner_watch import PlannerWatch
from delta3_pacdrive.controller.robot_actions import Logged
from delta3_pacdrive.controller.robot_state import RobotState
from delta3_pacdrive.controller.script_gate import GateEvent, ScriptGate
from delta3_pacdrive.controller.script_service import ScriptService
from delta3_pacdrive.controller.transformation import Transformation
from delta3_pacdrive.errors import Code, FaultCode, Reason, RobotFault, UnreachableError
from delta3_pacdrive.faults.fault import UNIT_ROBOT, Fault
from delta3_pacdrive.faults.schedule import Schedule
from delta3_pacdrive.motion.learned import Learned
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.sercos import master
from delta3_pacdrive.sercos.axis_monitor import AxisMonitor
from delta3_pacdrive.sercos.bus_time import NEVER
from delta3_pacdrive.sercos.configuration_check import Identity, drives_of
from delta3_pacdrive.sercos.master import BusMaster
from delta3_pacdrive.sercos.participants import Announcement
from delta3_pacdrive.sercos.service_requests import ServiceRequests
from delta3_pacdrive.sercos.shared_clock import SharedClock
from delta3_pacdrive.sercos.words import Phase

ALL_READY = Reason(Code.BUS, 'waiting for the robots that share its bus clock')


class ControllerCallbacks(CycleCallbacks, Protocol):
    """What the controller does on the graph."""

    def announce(self, announcement: master.Announce) -> None:
        """Announce a phase of the bus."""

    def greet(self, greeting: master.Greet) -> None:
        """Greet the drives, outside of cyclic operation."""

    def check_faults(self, faults: Sequence[Fault]) -> None:
        """Refuse faults of a program that cannot be injected; raises ProgramError."""


class RobotController:
    """Controller of one robot.

    Parameters
    ----------
    parameters
        Of the robot.
    period_s, report_s
        Wall-clock time per cycle, 0 = as fast as possible, and between two looks [s].
    wait_for_program
        Whether to stay in CP3 until a program is loaded.
    faults
        Those that are injected into the controller.
    port
        Does what has to be done outside.
    now_s, now_ns
        Return the time: of a clock that never jumps [s], of day [ns].
    learned
        Torques that were learned for a program.
    shared_clock
        Clock of the bus by which other robots go as well.

    Attributes
    ----------
    bus, cycles, state, task, axes
        The phases of the bus, its cycles, the state of the robot, its transformation, what is known of the drives.
    enabling, services, control, planners, orders
        What operators and clients ask of the drives, who has control, which planner is there, what it has ordered.
    gate, scripts
        Of the script that decides, if one does, and what it asks for.
    wait_for_program
        Whether the bus still stays in CP3 until a program is loaded.

    """

    def __init__(
        self,
        parameters: Parameters,
        period_s: float,
        report_s: float,
        wait_for_program: bool,
        faults: Schedule,
        callbacks: ControllerCallbacks,
        now_s: Callable[[], float],
        now_ns: Callable[[], int],
        learned: Learned | None = None,
        shared_clock: SharedClock | None = None,
    ) -> None:
        bus, identity, drives = parameters.bus, Identity.of(parameters), drives_of(parameters)
        self._parameters, self._callbacks, self.wait_for_program = parameters, callbacks, wait_for_program
        enabling_s = parameters.drive.enable_settle_s + parameters.motor.brake_release_s
        self._enabling_cycles = math.ceil(enabling_s / bus.cycle_time_s) + bus.outstanding_cycles_max
        self._start_s: float | None = None  # of the first cyclic operation
        self.task, self.axes = Transformation(parameters, learned), AxisMonitor(parameters)
        self.bus = BusMaster(identity, self._locate, drives=drives)
        self.services = ServiceRequests(self.bus.channel_closed, drives)
        self.state = RobotState(self, self.task, self.axes)
        self.enabling = Enabling(self, self.task, self.axes, self.state)
        self.gate = ScriptGate(self.task, period_s > 0.0, bus.cycle_time_s)
        self.cycles = CyclicOperation(
            parameters,
            period_s,
            report_s,
            self.state,
            self.task,
            self.axes,
            self.services,
            faults,
            callbacks,
            self.gate,
            self._fall,
            now_s,
            now_ns,
            shared_clock,
        )
        self._awaited: Reason | None = (
            None  # why cyclic operation does not begin, beside what the bus waits for
        )
        self.control = Control(report_s)
        self.planners = PlannerWatch(report_s, identity)
        self.orders = Orders(parameters, self.state, self.control, self.planners, callbacks.check_faults)
        self.orders.begin_session(self.bus.session.decode())
        self.scripts = ScriptService(
            self.state,
            self.task,
            self.cycles,
            self.gate,
            self.orders,
            self.control,
            period_s > 0.0,
            parameters.in_position_cycles,
        )
        if parameters.motion.enable_cycle >= 0:
            self.task.enable(parameters.motion.enable_cycle)

    # the bus as RobotState knows it -----------------------------------------------------------------------------------

    @property
    def next_cycle(self) -> int:
        """Next cycle to start."""
        return self.cycles.next_cycle

    @property
    def answered(self) -> int:
        """Next cycle to be complete."""
        return self.cycles.answered

    def closed(self) -> Reason | None:
        """Say why nothing that needs cyclic operation can be done, None if it can."""
        return self.bus.closed()

    def waiting(self) -> Reason | None:
        """Say what the present phase waits for, None if it waits for nothing."""
        return self.bus.waiting or self._awaited

    def earliest(self) -> int:
        """First cycle at which something may start: all outstanding cycles are over then, and the drives follow."""
        enabled = self.task.enable_cycle
        follow = enabled + self._enabling_cycles if enabled < NEVER else 0
        if not self.next_cycle:
            return follow
        return max(self.next_cycle + self._parameters.bus.outstanding_cycles_max + 1, follow)

    # phases -----------------------------------------------------------------------------------------------------------

    def poll_start_up(self, doubled: Reason | None) -> None:
        """Advance the phases of the bus, knowing who writes what only one may write."""
        ready = not self.wait_for_program or self.state.starts != NEVER
        first = self.next_cycle
        self._awaited = None
        if ready and self.bus.phase is Phase.CP3:
            begins = self.cycles.first_cycle()
            self._awaited = ALL_READY if begins is None else None
            first = first if begins is None else begins
        self._do(self.bus.poll(first, doubled, ready and self._awaited is None))

    def receive_announcement(self, announcement: Announcement) -> None:
        """Take the announcement of a participant of the bus, or of a planner."""
        if announcement.name == UNIT_ROBOT:
            self.planners.receive_announcement(announcement.instance, announcement.identity)
        self._do(self.bus.announced(announcement, self.next_cycle, self.answered))

    def receive_greeting(self, index: int, content: Content) -> None:
        """Take the AT with which an axis answers a greeting; those of bus cycles go to ``cycles``."""
        if not self.bus.cyclic:
            self.bus.positioned(index, content[0][0])
            self.services.received(index, content[2])

    def _locate(self, motor_positions_rad: Sequence[float]) -> Reason | None:
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
                    self._callbacks.announce(action)
                case master.Greet():
                    self._callbacks.greet(action)
                case master.RobotReady(cycle):
                    if not self.state.fault:
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

    def _begin(self, cycle: int) -> None:
        if cycle or self.state.fault:
            self.task.disable()  # who comes back enables nothing by himself
        self.axes.begin()
        self.task.follow_belts(read_belts(self.bus.belts))
        self.cycles.begin(cycle, self.bus.inputs)
        if self._start_s is None:
            self._start_s = self.cycles.last_answer_s

    def _end_session(self, fault: RobotFault, session: bytes) -> None:
        self.cycles.end()
        self.axes.begin()
        self.services.close()
        self.state.handle_bus_loss(fault)
        self.enabling.handle_bus_loss(fault)
        self.wait_for_program = False
        self.orders.begin_session(session.decode())

    def _exclude_drive(self, index: int, fault: RobotFault) -> None:
        """Go on without a drive, to a stop; then the phase falls."""
        self.axes.drop(index)
        self.cycles.answers.drop(index)
        self.state.stop(fault, hard=True)
        if len(self.axes.absent) == len(self.services.drives):
            self._fall(fault)
        else:
            self.cycles.complete()

    # looks ------------------------------------------------------------------------------------------------------------

    def poll(self, now_s: float) -> None:
        """Look whether everybody is still there who should be."""
        if self.state.fault:
            self.gate.handle(GateEvent.FAIL)  # the bus waits for no script any more: the robot has to stop
        self._check_drives(now_s)
        lost = self.orders.poll(now_s)
        if lost is not None:
            # nobody could change the motion profile of the program any more
            silent = lost.code is Code.SILENT
            code = FaultCode.PLANNER_SILENT if silent else FaultCode.PLANNER_RESTARTED
            sentence = f'{lost}, in bus cycle {self.answered}'
            self.state.stop(RobotFault(code, sentence, UNIT_ROBOT, cycle=self.answered))
        self.scripts.poll()
        self.cycles.complete()  # what was answered while the bus waited for a script that is gone
        self.enabling.poll()

    def _check_drives(self, now_s: float) -> None:
        silence_s = self.cycles.watchdog.silence_s(now_s)
        answered, next_cycle = self.answered, self.next_cycle
        if not self.bus.cyclic or next_cycle == answered or self.gate.closed:
            self.cycles.watchdog.received(now_s)
            return
        answers, cycles = self.cycles.answers, self.cycles
        silent, ahead = answers.behind(answered), answers.ahead(answered)
        of_plant = 'the inputs' if cycles.belts.is_complete(answered) else 'the belts'
        self._do(self.bus.missed(silent, silence_s, ahead, next_cycle, answered, of_plant))

    # reports ----------------------------------------------------------------------------------------------------------

    def progress(self) -> dict[str, Any]:
        """Return the present state of bus and program, as published in ``motion/progress``."""
        task, state, cycles = self.task, self.state, self.cycles
        move, distance, speed = task.progress()
        cycle_time, answered, end = self._parameters.bus.cycle_time_s, cycles.answered, task.end_cycle
        operator = self.control.operator
        place = task.answer['tcp_actual'] if answered else state.tcp_m if state.located else None
        remaining = max(end - answered, 0) if end < NEVER else 0
        stops = task.loaded and task.held  # how long the rest takes then depends on the way to go on
        return {
            'session': self.bus.session.decode(),
            'phase': self.bus.phase.name,
            'waiting': str(self.waiting() or ''),
            'missing': list(self.bus.missing),
            'fault': str(state.fault or ''),
            **RobotFault.facts(state.fault),
            'state': str(state.motion),
            'finished': state.finished,
            'settling': task.settling(answered - 1),
            'in_torque': state.in_torque,
            'enabled': state.enabled,
            'operator': operator.name if operator else '',
            'operator_identity': operator.identity if operator else '',
            'control': self.control.changes,
            'tcp_m': None if place is None else place.tolist(),
            'cycles': answered,
            'bus_time_s': answered * cycle_time,
            'wall_time_s': cycles.last_answer_s - (self._start_s or 0.0),
            'move': move,
            'moves': task.moves,
            'end_s': (state.ends if state.ends < NEVER else answered) * cycle_time,
            'remaining_s': None if stops else remaining * cycle_time,
            'master_m': distance,
            'master_speed_m_s': speed,
            'rate': 1.0 if task.profile is None else task.profile.override,
            'outputs': task.outputs,
            'payload_kg': task.payload,
            'following_error_rad': max(abs(value) for value in task.answer['following_error'].tolist()),
            'overruns': cycles.scheduler.overruns,
            'slip_s': cycles.scheduler.slip_s,
            'lost_telegrams': cycles.answers.lost + cycles.inputs.lost,
            'learned_torques': task.learned.exist,
            'unlearned': task.learned.reason,
            'repeated_telegrams': cycles.answers.repeated,
            **({} if (turning := task.turning) is None else {'turn_rad': turning.feedback[1]}),
        }

    def totals(self) -> dict[str, Any]:
        """Return what the bus and the program did so far."""
        return {
            'at_losses': self.axes.losses,
            'input_losses': self.cycles.inputs.lost,
            **self.cycles.statistics.summary(),
            'figures': self.task.figures().to_dict(),
        }
