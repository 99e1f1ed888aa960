"""Cyclic operation of the controller: starts bus cycles when they are due, and evaluates complete ones.

All of it runs in each bus cycle: a thousand times a second with a clock, more often without one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from delta3_pacdrive.belts.image import BeltImage
from delta3_pacdrive.belts.tracking import BeltReading
from delta3_pacdrive.control.cycle.cycle import ControllerCycle, emergency_stop
from delta3_pacdrive.control.cycle.transformation import Command, Transformation
from delta3_pacdrive.control.operation.robot_state import RobotState
from delta3_pacdrive.control.operation.script_gate import GateEvent, ScriptGate
from delta3_pacdrive.errors import FaultCode, RobotFault
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.faults.fault import AT_FAULTS, Fault
from delta3_pacdrive.robot.faults.schedule import Schedule
from delta3_pacdrive.robot.faults.telegram_faults import FaultyLink
from delta3_pacdrive.robot.sercos.axis_monitor import AxisMonitor
from delta3_pacdrive.robot.sercos.buffers import AnswerBuffer, InputImage
from delta3_pacdrive.robot.sercos.bus_time import NEVER
from delta3_pacdrive.robot.sercos.losses import NO_ANSWER
from delta3_pacdrive.robot.sercos.master import Announce, Greet
from delta3_pacdrive.robot.sercos.scheduler import BusStatistics, CycleScheduler
from delta3_pacdrive.robot.sercos.service_requests import ServiceRequests
from delta3_pacdrive.robot.sercos.shared_clock import SharedClock
from delta3_pacdrive.robot.sercos.watchdog import Watchdog

Content = tuple[Any, int, int]  # position, speed, torque; status word; word of the service channel


class ControllerCallbacks(Protocol):
    """Functions that the controller calls to act on the ROS graph."""

    def announce(self, announcement: Announce) -> None:
        """Announce a phase of the bus."""

    def greet(self, greeting: Greet) -> None:
        """Send a greeting to the drives outside cyclic operation."""

    def check_faults(self, faults: Sequence[Fault]) -> None:
        """Raise ProgramError for faults of a program that cannot be injected."""

    def start_ticks(self, delay_s: float) -> None:
        """Start the timer of bus cycles after a delay [s]; the first cycle is due at its first tick."""

    def send(self, cycle: int, command: Command) -> None:
        """Send the MDT of a bus cycle."""

    def publish_answers(self, cycle: int) -> None:
        """Publish the feedback of a bus cycle."""

    def reject_telegram(self, reason: str) -> None:
        """Report a rejected telegram."""

    def run_actions(self) -> None:
        """Carry out the actions of the robot state."""

    def publish_status(self) -> None:
        """Carry out the actions of the robot state, and publish status and progress."""


@dataclass(frozen=True)
class Timing:
    """Clocks and periods of a controller."""

    period_s: float  # wall-clock time per cycle, 0 = as fast as possible
    poll_s: float  # between two calls of ``RobotController.poll``
    now_s: Callable[[], float]  # monotonic time
    now_ns: Callable[[], int]  # time of day
    shared_clock: SharedClock | None = None  # with other robots


@dataclass(frozen=True)
class RobotParts:
    """Parts of a controller that bus cycles work on."""

    state: RobotState
    task: Transformation
    axes: AxisMonitor
    services: ServiceRequests


class CyclicOperation:
    """Bus cycles of one controller."""

    def __init__(
        self,
        parameters: Parameters,
        timing: Timing,
        parts: RobotParts,
        faults: Schedule,
        callbacks: ControllerCallbacks,
        gate: ScriptGate,
        fall: Callable[[RobotFault], None],
    ) -> None:
        self._state, self._axes, self._services, self._faults = (
            parts.state,
            parts.axes,
            parts.services,
            faults,
        )
        self._callbacks, self._gate, self._fall = callbacks, gate, fall
        self._task, self._cycle = parts.task, ControllerCycle(parts.task, parts.axes, parameters)
        self.watchdog = Watchdog(timing.poll_s)  # of complete cycles
        self.statistics = BusStatistics(parameters.bus.outstanding_cycles_max)
        self._now_s, self._now_ns = timing.now_s, timing.now_ns
        self._link: FaultyLink[Content] = FaultyLink(faults, AT_FAULTS, callbacks.reject_telegram)
        self.scheduler = CycleScheduler(
            timing.period_s, parameters.bus.outstanding_cycles_max, timing.shared_clock
        )
        # feedback of the drives, inputs and belts, until a cycle is complete
        self.answers: AnswerBuffer[Content] = AnswerBuffer(len(parts.services.drives))
        self.inputs, self.belts = InputImage(), BeltImage()
        self._observed = NEVER  # last bus cycle with belt readings known to the task; NEVER without belts
        self.running = False
        self.next_cycle = self.answered = 0  # next cycle to start, and first one without complete feedback
        self.last_answer_s = 0.0  # time of the last complete cycle

    def first_cycle(self) -> int | None:
        """Return the first cycle of cyclic operation, None while robots on a shared clock are not ready."""
        return self.scheduler.first_cycle(self.next_cycle, self._now_s())

    def begin(self, cycle: int, inputs: Sequence[str] = ()) -> None:
        """Start cyclic operation with a cycle; ``inputs`` are the names of the inputs of the plant."""
        self.next_cycle = self.answered = cycle
        self.answers.begin(cycle)
        self.inputs.begin(cycle, inputs)
        belts = self._task.tracking.belts
        self.belts.begin(cycle, len(belts))
        self._observed = cycle - 1 if belts else NEVER
        # a command requires the belt readings of the cycle before, so two cycles cannot start together
        self.scheduler.catches_up = not belts
        self._link.clear()
        self.last_answer_s = self._now_s()
        self.watchdog.received(self.last_answer_s)
        delay_s = self.scheduler.begin(cycle, self.last_answer_s + self.scheduler.period_s)
        self._callbacks.start_ticks(delay_s)  # immediately: any delay here makes every cycle late
        self.running = True

    def end(self) -> None:
        """End cyclic operation."""
        self.running = False
        self.scheduler.end()

    def due(self, index: int) -> bool:
        """Whether further AT of an axis are expected; outside cyclic operation their number is unknown."""
        return not self.running or self.answers.expected[index] < self.next_cycle

    def start_due(self) -> None:
        """Start every cycle that is due."""
        scheduler, state, gate = self.scheduler, self._state, self._gate
        while self.running and not gate.closed:
            cycle = self.next_cycle
            outstanding = cycle - self.answered
            if self.belts.expected < cycle:  # the command needs the readings of the cycle before
                outstanding = scheduler.outstanding_max
            if not scheduler.may_start(cycle, outstanding, self._now_s()):
                break
            if cycle >= self._faults.next_cycle:
                self._begin_faults(cycle)
            if self._observed < cycle - 1:
                self._observe(cycle - 1)
            command = self._task.command(cycle)
            sent_ns = self._now_ns()
            self._callbacks.send(cycle, command)
            self.statistics.sent(cycle, outstanding, scheduler.late_s, sent_ns)
            self.next_cycle = cycle + 1
            state.commanded(cycle)
            if gate.commanded(cycle):
                if gate.cancels_motion:
                    gate.rest_cycle = state.cancel_motion()
                else:
                    state.hold()
                gate.note(cycle)
            if state.actions:
                self._callbacks.run_actions()

    def _observe(self, cycle: int) -> None:
        """Pass the belt readings up to a bus cycle to the task."""
        tracking = self._task.tracking
        while self._observed < cycle:
            self._observed += 1
            tracking.observe(self._observed, self.belts.take(self._observed))

    def _begin_faults(self, cycle: int) -> None:
        """Start injected faults; after a frozen process, bus time continues as after any delay."""
        for fault, _ in self._faults.due(cycle):
            if fault.kind == 'emergency_stop':
                self._state.stop_for(emergency_stop(cycle))
                self._callbacks.run_actions()

    def take(self, index: int, cycle: int, content: Content, received_ns: int) -> None:
        """Take the AT of an axis and its time of arrival [ns], 0 if unknown."""
        if not self.running:
            return
        axis = self._services.drives[index]
        if cycle >= self.next_cycle:
            sentence = f'{axis} went on to bus cycle {cycle} without the master ({NO_ANSWER})'
            self._fall(RobotFault(FaultCode.BUS_TIME, sentence, axis, NO_ANSWER))
            return
        for arrived, what in self._link.arrivals(axis, cycle, content):
            if not self.running:
                return
            if self.answers.put(index, arrived, what):
                self.complete(received_ns)
            else:
                sentence = f'{axis}: two different AT of bus cycle {arrived}: there is a second writer'
                self._state.stop(RobotFault(FaultCode.SECOND_WRITER, sentence, axis))
                self._callbacks.publish_status()

    def take_inputs(self, cycle: int, bits: int) -> None:
        """Take the inputs of the plant in a bus cycle, as bits."""
        if not self.running:
            return
        if self.next_cycle <= cycle:
            self._callbacks.reject_telegram(f'inputs of bus cycle {cycle} are ahead of bus time')
            return
        self.inputs.put(cycle, bits)
        self.complete()

    def take_belts(self, cycle: int, readings: Sequence[BeltReading]) -> None:
        """Take the belt readings of a bus cycle, which the next command has waited for."""
        if not self.running:
            return
        if self.next_cycle <= cycle:
            self._callbacks.reject_telegram(f'belts of bus cycle {cycle} are ahead of bus time')
            return
        self.belts.put(cycle, readings)
        self.complete()
        if not self.scheduler.period_s:
            self.start_due()

    def complete(self, received_ns: int = 0) -> None:
        """Evaluate all cycles with complete feedback; an AT counts as lost once a later one has arrived."""
        buffer, inputs, state, services = self.answers, self.inputs, self._state, self._services
        belts, gate, first = self.belts, self._gate, self.answered
        while not gate.closed and (cycle := self.answered) < self.next_cycle:
            if not (buffer.is_complete(cycle) and inputs.is_complete(cycle) and belts.is_complete(cycle)):
                break
            answers = buffer.get(cycle)
            if services.busy:
                for index, answer in enumerate(answers):
                    services.received(index, None if answer is None else answer[2])
            self.statistics.answered(cycle, received_ns or self._now_ns())
            self.last_answer_s = self._now_s()
            self.watchdog.received(self.last_answer_s)
            self.answered = cycle + 1
            stop = self._cycle.evaluate(cycle, answers, state.checked_from, bool(state.fault))
            if self._observed < cycle:
                self._observe(cycle)
            self._callbacks.publish_answers(cycle)
            if stop is not None:
                state.stop_for(stop)
                self._callbacks.publish_status()
            if state.ended(cycle):
                state.answered(cycle)
                self._callbacks.publish_status()
            if state.fault:
                gate.handle(GateEvent.FAIL)
            gate.answered(cycle, inputs.take(cycle))
            if state.fault and self._axes.absent and state.without_torque:
                self._fall(state.fault)
                return
        if self.answered > first and not self.scheduler.period_s and self.running:
            self.start_due()
