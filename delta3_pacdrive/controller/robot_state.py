"""The state of one robot: its motion, and what has stopped it; programs that start, change, are held and given up.

Pure: requests, orders and answers of bus cycles come in as calls, what has to be told or asked goes out as actions.
This is the only owner of stops and faults; ``Transformation`` carries them out in the right bus cycle. What leads out
of a fault, and who may be enabled, stands in ``enabling``.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Protocol

from delta3_pacdrive.configuration.checked import counted
from delta3_pacdrive.controller import robot_actions
from delta3_pacdrive.controller.cycle import Stop, emergency_stop
from delta3_pacdrive.controller.motion_state import TRANSITIONS, UNDER_WAY, Event, MotionState
from delta3_pacdrive.controller.motion_state import sentence as motion_sentence
from delta3_pacdrive.controller.plan_intake import MoreMoves, Order
from delta3_pacdrive.controller.transformation import Transformation
from delta3_pacdrive.drive.diagnostics import FAULT_OF_NUMBER, fault_text
from delta3_pacdrive.errors import Code, ProgramError, Reason, RobotFault
from delta3_pacdrive.motion.execution import MotionProfile
from delta3_pacdrive.motion.learned import followed_text
from delta3_pacdrive.motion.plan import STANDING_M
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.sercos.axis_monitor import AxisMonitor
from delta3_pacdrive.sercos.bus_time import NEVER
from delta3_pacdrive.sercos.configuration_check import DRIVES
from delta3_pacdrive.sercos.service_channel import Access, Answer, Operation, parse_idn
from delta3_pacdrive.sercos.words import in_torque

DIAGNOSTIC_NUMBER = Access(parse_idn('S-0-0390'), Operation.READ)
# of the motor current in the program that has ended, of all samples of the current loop
PEAK_CURRENT, RMS_CURRENT = (Access(parse_idn(idn), Operation.READ) for idn in ('P-0-0073', 'P-0-0074'))
START_CYCLES_MAX = 1_000_000  # how far ahead a program may be told to start
FAULTS_LEAD_CYCLES = 60  # from acceptance to the earliest fault: every node knows of it by then
ENABLE_FIRST = 'the drives are not enabled: enable them first'
STOPPED_BESIDE = Reason(Code.BELT, 'somebody has stopped the robot, which goes with its belt no longer')


Told = Callable[[Reason | None, str], None]


class Bus(Protocol):
    """What has to be known of the bus."""

    @property
    def next_cycle(self) -> int:
        """Next cycle to start."""

    @property
    def answered(self) -> int:
        """Next cycle to be complete."""

    def closed(self) -> Reason | None:
        """Say why nothing that needs cyclic operation can be done, None if it can."""

    def waiting(self) -> Reason | None:
        """Say what the present phase waits for, None if it waits for nothing."""

    def earliest(self) -> int:
        """First cycle at which something may start: all outstanding cycles are over then, and the drives follow."""


class RobotState:
    """State of one robot.

    Attributes
    ----------
    actions
        What has to be done, in this order; whoever does it takes them away.
    motion
        What is done with the TCP.
    fault
        First cause of a stop, None while there is none.
    starts, ends
        Cycle at which the program begins, and the last one whose answer belongs to it (``NEVER`` while none is under
        way or it is held).
    finished
        Whether a program came to its end.
    located, tcp_m, turn_rad
        How often the robot was found to stand ready for a program, where [m], and where its tool; None: it has no
        rotary axis.

    """

    def __init__(self, bus: Bus, task: Transformation, axes: AxisMonitor) -> None:
        self._bus, self._task, self._axes = bus, task, axes
        self.actions: list[robot_actions.Action] = []
        self.motion = MotionState.IDLE
        self.fault: RobotFault | None = None
        self.starts = self.ends = NEVER
        self.finished = False
        self.located = 0
        self.tcp_m: Floats = task.state['tcp'][0].copy()
        self.turn_rad: float | None = None
        self._aborting = False
        self._beside = False  # something is added to the plan that goes with a belt
        self._due = NEVER  # command cycle at which something ends
        self._told: MotionProfile | None = None  # the motion profile that was told last
        self._own_told: MotionProfile | None = None  # the same of those that the task goes over to by itself
        self._outputs, self._payload = task.outputs, task.payload
        # how often the plan became longer before, and who is told what becomes of the next time
        self._extending: tuple[int, Told] | None = None
        self._reporting: int | None = None  # drive whose report is the first cause of the fault

    # what is known --------------------------------------------------------------------------------------------------

    @property
    def enabled(self) -> bool:
        """Whether the drives are enabled, or about to be."""
        return not self.fault and self._task.enable_cycle < NEVER and self._task.disable_cycle == NEVER

    @property
    def followed(self) -> MotionProfile | None:
        """The motion profile that was told last."""
        return self._told

    @property
    def in_torque(self) -> bool:
        """Whether any drive holds its motor."""
        return any(in_torque(status) for status in self._axes.status)

    @property
    def without_torque(self) -> bool:
        """Whether no drive holds its motor, or is about to."""
        return self._task.enable_cycle == NEVER and not self.in_torque

    @property
    def checked_from(self) -> int:
        """Bus cycle from which on every drive must be in torque, because the TCP moves; ``NEVER`` if it stands."""
        if self.motion in (MotionState.MOVING, MotionState.STOPPING):
            return self.starts
        return 0 if self._goes_with_belt and self.motion is MotionState.IDLE else NEVER

    @property
    def moves(self) -> bool:
        """Whether the TCP moves, on its path or with a belt."""
        return self.checked_from < NEVER

    @property
    def _goes_with_belt(self) -> bool:
        return self._task.tracking is not None and not self._task.tracking.free

    def refusal(self) -> Reason | None:
        """Say why no program can be started now, None if one can."""
        if self.fault:
            return self._faulty(self.fault)
        if not self.located:
            waiting = f', {self._bus.waiting()}' if self._bus.waiting() else ''
            return Reason(
                Code.BUS, f'the robot is not ready: {self._bus.closed() or "it is starting"}{waiting}'
            )
        if (self.motion, Event.START) not in TRANSITIONS or self.starts != NEVER:
            return Reason(Code.STATE, motion_sentence(self.motion))
        if not self.enabled:
            return Reason(Code.DISABLED, ENABLE_FIRST)
        return None

    def _refused(self, event: Event) -> Reason | None:
        """Say why an event cannot happen now, None if it can."""
        if (self.motion, event) in TRANSITIONS:
            return None
        return self._faulty(self.fault) if self.fault else Reason(Code.STATE, motion_sentence(self.motion))

    def _faulty(self, fault: RobotFault) -> Reason:
        return Reason(Code.FAULT, f'there is a fault: {fault}', fault)

    def _enter(self, event: Event) -> None:
        """Let an event that can happen happen."""
        self.motion = TRANSITIONS[self.motion, event]
        self.actions.append(robot_actions.Entered(self.motion, event))

    # where it stands ------------------------------------------------------------------------------------------------

    def locate(self, tcp_m: Floats, cycle: int) -> None:
        """Take note of where the robot stands: it can take a program from there."""
        self.located += 1
        self.tcp_m = tcp_m.copy()
        self.turn_rad = None if self._task.turning is None else self._task.turning.angle_rad
        self.actions.append(robot_actions.Located(self.tcp_m, cycle))
        self.actions.append(robot_actions.Switched(cycle))

    # programs -------------------------------------------------------------------------------------------------------

    def start(self, order: Order) -> Reason | None:
        """Start a program; returns why not."""
        reason = self.refusal() or self._beside_belt() or self._misplaced(order) or self._belated(order)
        if reason is not None:
            return reason
        self._task.load(order.plan)
        self.finished = False
        self.starts = max(int(order.cycle), self._earliest(order))
        self._task.start(self.starts, order.override)
        self._follow()
        if order.faults:
            self.actions.append(robot_actions.Injected(order.faults, self.starts))
        self.actions.append(
            robot_actions.Said(
                f'program of {counted(len(order.plan), "move")} starts in bus cycle {self.starts}'
            )
        )
        if self._task.learned.exist:
            self.actions.append(robot_actions.Said(followed_text(self._task.learned.reason)))
        self._enter(Event.START)
        return None

    def abandon(self) -> int:
        """Stop path and belt motion from the next cycle on, forget both then; return from which cycle on they stand.

        It is 0 if nothing moves.
        """
        task, tracking = self._task, self._task.tracking
        if self.motion in UNDER_WAY:
            self.abort()
        stands = task.end_cycle if task.loaded else 0
        if tracking is None:
            return stands
        task.leave_belt()
        tracking.settle()
        return max(tracking.rest_cycle, stands)

    def _beside_belt(self) -> Reason | None:
        """Say why a robot that was stopped while it went with a belt takes no moves yet, None if it takes them."""
        tracking = self._task.tracking
        return STOPPED_BESIDE if tracking is not None and tracking.forgets else None

    def _misplaced(self, order: Order) -> Reason | None:
        """Say why an order fits neither the present bus time nor the place of the robot, None if it does."""
        latest = self._task.next_cycle + START_CYCLES_MAX
        if not -1 <= order.cycle <= latest:
            sentence = (
                f'an order starts in bus cycle {order.cycle:g}, but must be between 0 and {latest}, or -1'
            )
            return Reason(Code.CONTENT, sentence)
        # beside what goes with a belt
        stands = self._task.state['tcp' if self._task.tracking is None else 'planned'][0]
        away = float(sum((order.plan.start_m() - stands) ** 2)) ** 0.5
        if away > STANDING_M:
            return Reason(Code.CONTENT, f'it starts {away * 1e3:.3f} mm away from where the robot stands')
        try:
            self._task.require_turns(order.plan)
        except ProgramError as error:
            return Reason.of(error)
        return None

    def _earliest(self, order: Order) -> int:
        """Return the first bus cycle in which an order can begin."""
        earliest = self._bus.earliest()
        return max(earliest, self._task.next_cycle + FAULTS_LEAD_CYCLES) if order.faults else earliest

    def _belated(self, order: Order) -> Reason | None:
        """Say why an order that must begin in its bus cycle cannot, None if it can."""
        earliest = self._earliest(order)
        if not order.exact or order.cycle >= earliest:
            return None
        sentence = f'it came too late for bus cycle {order.cycle:g}: the first one in which it can begin is {earliest}'
        return Reason(Code.LATE, sentence)

    def change(self, profile: MotionProfile) -> Reason | None:
        """Go over to another motion profile: override or resume; returns why not."""
        timely = self._in_time(Event.CHANGE, profile)
        if isinstance(timely, Reason):
            return timely
        profile = timely
        reason = self._cannot_get_on_again()
        if reason is not None:
            return reason
        try:
            self._task.change(profile)
        except ProgramError as error:
            return Reason.of(error)
        if self.motion is MotionState.STOPPED and self._task.tracking is not None:
            self._task.tracking.go_on()
        self.ends = self._task.coming_last_cycle
        self._due = NEVER
        self._told = profile
        self.actions.append(robot_actions.Followed(profile))
        self._enter(Event.CHANGE)
        return None

    def _cannot_get_on_again(self) -> Reason | None:
        """Say why a robot that was held while it went with a belt cannot go on, None if it can."""
        tracking = self._task.tracking
        if self.motion is not MotionState.STOPPED or tracking is None or tracking.free:
            return None
        if tracking.again_cycle < 0:
            return Reason(
                Code.STATE, 'the robot stands beside its belt: nobody has said when it gets on again'
            )
        if tracking.again_cycle < self._task.next_cycle:
            over = f'bus cycle {tracking.again_cycle} is over, the next one is {self._task.next_cycle}'
            return Reason(Code.LATE, f'{over}: the robot cannot get on its belt again')
        return None

    def _in_time(self, event: Event, profile: MotionProfile) -> MotionProfile | Reason:
        """Return a motion profile for a bus cycle that is still to come; or why it cannot be followed now."""
        reason = self._refused(event)
        if reason is None and self._aborting:
            reason = Reason(Code.STATE, 'the program is being given up')
        if reason is None and not self.enabled:
            reason = Reason(Code.DISABLED, ENABLE_FIRST)
        if reason is None and self._task.extending:
            reason = Reason(Code.STATE, 'the moves that follow are still to be taken')
        if reason is not None:
            return reason
        if self.motion == MotionState.STOPPED:
            # who stands has time: an order that came late is as good as one in time
            profile = replace(profile, cycle=max(profile.cycle, self._bus.earliest()))
        next_cycle = self._task.next_cycle
        if profile.cycle < next_cycle:
            return Reason(Code.LATE, f'bus cycle {profile.cycle} is over, the next one is {next_cycle}')
        if profile.cycle > next_cycle + START_CYCLES_MAX:
            return Reason(Code.CONTENT, f'bus cycle {profile.cycle} is too far ahead')
        return profile

    def extend(self, order: MoreMoves, tell: Told) -> Reason | None:
        """Let more moves follow; returns why not, else ``tell`` is called when they do, or when a stop was earlier."""
        told = order.told
        profile = self._in_time(Event.EXTEND, told.profile)
        if isinstance(profile, Reason):
            return profile
        try:
            self._task.extend(told.first, told.kept, order.more, profile)
        except ProgramError as error:
            return Reason.of(error)
        self._extending = self._task.extensions, tell
        if not profile.held:
            self.ends = self._task.coming_last_cycle
            self._due = NEVER
        self._enter(Event.EXTEND)
        return None

    def _look_at_extension(self) -> None:
        """Tell whether more moves follow, once that is certain."""
        if self._extending is None or self._task.extending:
            return
        (before, tell), self._extending = self._extending, None
        reason = None
        if self._task.extensions == before:
            reason = Reason(Code.LATE, 'the robot was stopped before the moves that follow were taken')
        else:
            self._tell_profile()
        self.actions.append(robot_actions.Answered(tell, reason, ''))

    def hold(self) -> Reason | str:
        """Stop on the path from the next cycle on; returns why not, or what happens."""
        return self._refused(Event.HOLD) or self._stop_on_path(Event.HOLD)

    def stand(self) -> Reason | str:
        """Stop on the path, or a robot that goes with a belt beside that; returns why not, or what happens."""
        outcome = self.hold()
        return outcome if isinstance(outcome, str) else self._stop_beside_belt() or outcome

    def _stop_beside_belt(self) -> str:
        """Stop a robot that goes with a belt though no moves are left; returns what happens, empty if it does not."""
        tracking = self._task.tracking
        if tracking is None or not tracking.works or self.motion is not MotionState.IDLE:
            return ''
        self._task.leave_belt()
        return f'goes with its belt no longer, in bus cycle {tracking.rest_cycle} it stands'

    def _stop_on_path(self, event: Event) -> str:
        profile = self._task.hold()
        self._look_at_extension()
        self._follow()
        self._enter(event)
        return f'stops from bus cycle {profile.cycle} on, in cycle {self._task.end_cycle} it stands'

    def abort(self) -> Reason | str:
        """Stop on the path and forget the program; returns why not, or what happens."""
        reason = self._refused(Event.ABORT)
        if reason is not None:
            return self._stop_beside_belt() or reason
        if self.motion == MotionState.MOVING:
            sentence = self._stop_on_path(Event.ABORT)
        else:
            sentence = 'the program is given up'
            self._due = min(self._due, self._task.end_cycle)
            self._enter(Event.ABORT)
        self._aborting = True
        return sentence

    def _follow(self) -> None:
        """Tell the present motion profile, and note when it ends."""
        task = self._task
        self._due = task.end_cycle if task.held else NEVER
        self.ends = NEVER if task.held else task.last_cycle
        self._tell_profile()

    def _tell_profile(self) -> None:
        self._told = self._task.profile
        if self._told is not None:
            self.actions.append(robot_actions.Followed(self._told))

    def ended(self, cycle: int) -> bool:
        """Whether a program is over with the answers of a cycle: the last ones, of a robot that is in position."""
        return cycle >= self.ends and self._task.in_position(cycle)

    def commanded(self, cycle: int) -> None:
        """Look at what the command of a cycle has brought about."""
        task = self._task
        if task.own_profile is not self._own_told:
            self._own_told = task.own_profile
            if self._own_told is not None and self.motion == MotionState.MOVING and task.lost_belt:
                self._look_at_extension()
                self._follow()
                self._enter(Event.HOLD)
            elif self._own_told is not None and self.motion == MotionState.MOVING:
                self._told = self._own_told
                self.actions.append(robot_actions.Followed(self._told))
                self.ends = task.coming_last_cycle
        if self._extending is not None:
            self._look_at_extension()
        if task.outputs != self._outputs or task.payload != self._payload:
            self._outputs, self._payload = task.outputs, task.payload
            self.actions.append(robot_actions.Switched(cycle))
        if self.motion == MotionState.ERROR and task.loaded and task.profile is not self._told:
            self._tell_profile()
        if task.tracking is not None:
            self._look_at_belt(cycle)
        if cycle >= self._due:
            self._due = NEVER
            if self._aborting:
                self._end(Event.GIVE_UP, cycle)
            elif task.held:
                self._enter(Event.STAND)

    def _look_at_belt(self, cycle: int) -> None:
        """Tell where the robot stands that goes with no belt any more."""
        beside = self._task.tracking is not None and not self._task.tracking.free
        if self._beside and not beside and self.motion is MotionState.IDLE:
            self.locate(self._task.state['tcp'][0], cycle)
        self._beside = beside

    def answered(self, cycle: int) -> None:
        """Note that the last answer of a program is there, and ask the drives for its currents."""
        self.finished = True
        self._end(Event.END, cycle)
        asked = (PEAK_CURRENT, self._task.current_peak), (RMS_CURRENT, self._task.current_rms)
        for access, told in asked:
            take = partial(self._take_current, told)
            self.actions.extend(robot_actions.Asked(index, access, take) for index in range(len(DRIVES)))

    @staticmethod
    def _take_current(told: list[float | None], index: int, answer: Answer) -> None:
        """Take a current that a drive has answered; the next program has lists of its own."""
        if not answer.error:
            told[index] = answer.value

    def _forget_program(self) -> None:
        self._aborting = False
        self.starts = self.ends = self._due = NEVER

    def _end(self, event: Event, cycle: int) -> None:
        self._forget_program()
        self._task.unload()
        if event is Event.GIVE_UP:
            self._task.release()
        self._look_at_extension()
        self._enter(event)
        self.locate(self._task.state['tcp'][0], cycle)

    # faults ---------------------------------------------------------------------------------------------------------

    def note(self, fault: RobotFault) -> None:
        """Keep the first cause of a stop and say it; the program is given up, only a reset leads out."""
        if self.fault is not None:
            return
        self.fault = fault if fault.cycle >= 0 else replace(fault, cycle=self._bus.answered)
        self.actions.append(robot_actions.Said(fault.sentence, error=True))
        self._forget_program()
        self._enter(Event.FAIL)

    def stop(self, fault: RobotFault, hard: bool = False) -> None:
        """Note a fault that leaves the bus working: the TCP stops on its path, then all drives are disabled."""
        self._task.stop_at(0, hard)
        self.note(fault)

    def stop_for(self, stop: Stop) -> None:
        """Stop as the evaluation of a bus cycle asks, and ask faulty drives for the cause."""
        if self.fault is None:
            self._reporting = stop.drive
            asked = self._axes.faulty()
            self.actions.extend(
                robot_actions.Asked(index, DIAGNOSTIC_NUMBER, self._take_number) for index in asked
            )
        self._task.stop_at(stop.first, stop.hard)
        self.note(stop.fault)

    def lose_bus(self, fault: RobotFault) -> None:
        """Give everything up that needs cyclic operation, which has ended."""
        self.note(fault)
        self._task.give_up()
        self._look_at_extension()

    def _take_number(self, index: int, answer: Answer) -> None:
        """Take the number of the diagnostic message that a drive has answered."""
        number = 0 if answer.error else int(answer.value)
        told = FAULT_OF_NUMBER.get(number)
        if told and self.fault and index == self._reporting:
            sentence = f'{self.fault}: {fault_text(told)}'
            self.fault = replace(self.fault, sentence=sentence, number=number)
            self.actions.append(robot_actions.Said(sentence, error=True))

    def recover(self, tcp_m: Floats) -> None:
        """Stand ready where the motors are, without a fault and without a program."""
        self.fault = self._reporting = None
        self._axes.clear_losses()
        self._task.give_up()
        self._look_at_extension()
        self._forget_program()
        self._enter(Event.RESET)
        self.locate(tcp_m, self._bus.answered)

    def emergency_stop(self) -> str:
        """Stop on the path, then take the torque off (stop category 1); returns the first cause of a stop."""
        self.stop(emergency_stop(self._bus.next_cycle).fault)
        return str(self.fault)
