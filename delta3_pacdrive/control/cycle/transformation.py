"""The transformation task: computes the motor commands of each bus cycle and evaluates the drives' feedback.

Each cycle evaluates the plan for the TCP position, the inverse kinematics for the arm angles and the gear ratio for the
motor shafts (thesis 6, 7). Feedback is used only for the following error and supervision, never for the next command,
because several cycles may be outstanding.

The module is long because all commands to the task, their events and the calls of its stages are in one class; the
stages themselves are modules of their own.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from delta3_pacdrive import kinematics
from delta3_pacdrive.belts.meeting import BeltAxes
from delta3_pacdrive.control.cycle.rotary_axis import RotaryAxis, TurnFigures, require_turns
from delta3_pacdrive.control.cycle.servo import Servo
from delta3_pacdrive.control.cycle.stages import (
    FAULT,
    BeltStage,
    Event,
    LearnedTorques,
    PositionWait,
    Schedule,
    Stage,
)
from delta3_pacdrive.control.cycle.task_arrays import SETTLE_CYCLES, TASK, initialize_history, task_constants
from delta3_pacdrive.control.cycle.task_cycle import answer_cycle, command_cycle, give
from delta3_pacdrive.dynamics import gravity, inertia
from delta3_pacdrive.errors import ProgramError, RobotFault, RunError
from delta3_pacdrive.kinematics import geometry
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, Parameters, numbered
from delta3_pacdrive.planning.execution import MotionProfile, Timeline
from delta3_pacdrive.planning.learned_torques import Learned
from delta3_pacdrive.planning.paths.curves import point
from delta3_pacdrive.planning.paths.move import TRACK_BIT, Move, MoveKind
from delta3_pacdrive.planning.paths.virtual_master import rest
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.robot.motor import motor
from delta3_pacdrive.robot.sercos.bus_time import NEVER
from delta3_pacdrive.robot.sercos.words import (
    CONTROL_ENABLE,
    CONTROL_MEASURE,
    CONTROL_ON,
    CONTROL_PROGRAM,
    payload_on_grid,
)

# reset at the start of a program
MEASURED = (
    'measured_cycles', 'error_max', 'error_square_sum', 'following_error_max', 'current_peak', 'current_square_sum'
)  # fmt: skip
# each iteration reduces the error about a thousandfold, as gravity torque hardly changes within the twist
TWIST_ITERATIONS = 4
DISABLE_CYCLES = 40  # from standstill of the set points to disabling, for drives to detect their standstill


class Command(NamedTuple):
    """Command to the drives in the MDT of a bus cycle."""

    motors: Floats  # (axes,) motor shafts [rad], on the increment grid; overwritten by the next command
    torques: Floats  # (axes,) additive motor torques [N m], S-0-0081, if enabled in the parameters, else 0
    control: int  # S-0-0134, the same for all drives
    payload: float  # gripped [kg]
    outputs: int  # bit n is output n


@dataclass(frozen=True)
class Figures:
    """Results of a program: TCP errors, set-point delay removed, and currents by axis.

    ``current_peak_a`` and ``current_rms_a`` cover all samples of the current loops; None until read from the drives.
    ``at_current_peak_a`` and ``at_current_rms_a`` cover the one sample per bus cycle in the AT.
    """

    measured_cycles: int
    tcp_error_max_m: float
    tcp_error_rms_m: float
    following_error_max_rad: float
    final_tcp_m: list[float]
    current_peak_a: list[float | None]
    current_rms_a: list[float | None]
    at_current_peak_a: list[float]
    at_current_rms_a: list[float]
    turns: tuple[TurnFigures, ...] = ()  # of the rotary axes

    def to_dict(self) -> dict[str, Any]:
        """Return the figures under their names in run results."""
        of_rotary = {
            numbered(name, number): value
            for number, turn in enumerate(self.turns)
            for name, value in turn.to_dict().items()
        }
        return {name: value for name, value in vars(self).items() if name != 'turns'} | of_rotary


class Transformation:
    """Cyclic calculations of the controller, in bus cycles, without clock or messages.

    Parameters
    ----------
    parameters
        Parameters of the robot.
    learned
        Torques commanded in addition to the model's, only with the plan they were learned for.

    """

    def __init__(self, parameters: Parameters, learned: Learned | None = None) -> None:
        self._parameters = parameters
        # arrays of the compiled code: one record TASK, its state, commands [rad] and [N m], and ANSWER of the last AT
        self.record = record = np.zeros(1, TASK)
        record['constants'], record['geometry'] = task_constants(parameters), geometry(parameters.kinematics)
        record['inertia'], record['motor'] = inertia(parameters), motor(parameters)
        self.state: NDArray[Any] = record['state']
        axes = len(parameters.axes)
        self._state: np.void = self.state[0]
        self.motors: Floats = record['motors'][0, :axes]
        self.torques: Floats = record['torques'][0, :axes]
        self.answer: np.void = record['answer'][0]
        self.state['start_cycle'] = self.state['end_cycle'] = NEVER
        self.state['payload'] = payload_on_grid(parameters.dynamics.payload_mass_kg)
        self.timeline = Timeline(_NO_PLAN, parameters.bus.cycle_time_s)
        self._schedule = Schedule(
            {
                Event.PROFILE: lambda _, profile: self._follow(profile),
                Event.PLAN: lambda cycle, pending: self._switch_plan(cycle, *pending),
                Event.STOP: self._stop,
                Event.EXACT_STOP: self._begin_wait,
                Event.DISABLE: lambda *_: self.disable(),
            }
        )
        self.next_cycle = 0  # also set after compiled code has commanded the cycles before it
        self.loaded = False
        self.extensions = 0  # plan extensions so far
        self.own_profile: MotionProfile | None = None  # the last one that the task generated itself
        self.enable_cycle = NEVER  # drives are enabled from this cycle to before ``disable_cycle``
        self.learned = LearnedTorques(parameters, learned, _NO_PLAN, self.state)
        self._wait = PositionWait(parameters, self._schedule)
        self.rotary = tuple(RotaryAxis(parameters, number) for number in range(axes - ARMS))
        for axis in self.rotary:
            axis.precompile(record, self.timeline)
        self.servo = Servo(parameters, record, self._servo_changed)
        self.follow_belts(())
        # first cycle that counts for the figures of the program, and the first after those
        self._measured = NEVER, NEVER
        # motor currents of the program [A] by axis over all samples; None until read from the drives
        self.current_peak: list[float | None] = [None] * 3
        self.current_rms: list[float | None] = [None] * 3

    def follow_belts(self, belts: Sequence[BeltAxes]) -> None:
        """Use these belts from now on and discard all earlier belt state."""
        self.tracking = BeltStage(self._parameters, belts, self.state, self._stop_off_belt)
        self._collect_stages()

    def _servo_changed(self) -> None:
        """Call the servo stage while it is active."""
        self._collect_stages()
        self._mark_measured()

    def _collect_stages(self) -> None:
        belts, steering = (
            [self.tracking] if self.tracking.belts else [],
            [self.servo] if self.servo.active else [],
        )
        # stages that take part in the command of each bus cycle
        self._commanding: list[Stage] = [*belts, *steering, *self.rotary]
        self._stages: list[Stage] = [self.learned, self._wait, *self._commanding]

    def locate(self, motor_positions_rad: ArrayLike) -> Floats:
        """Set the commanded position from the motor shafts by forward kinematics (6); return the TCP [m].

        ``motor_positions_rad`` are those of the arms, followed by the rotary axes if known.
        """
        theta, twist, tcp = self._place(motor_positions_rad)
        initialize_history(theta, twist, tcp, self.state[0])
        self.locate_tool(motor_positions_rad)
        return tcp

    def locate_tool(self, motor_positions_rad: ArrayLike) -> None:
        """Set the commanded tool angles from the shafts that are not within their position windows."""
        for axis, position in self._shafts(motor_positions_rad):
            axis.set_position(position)

    def tool_off_rad(self, motor_positions_rad: ArrayLike) -> float:
        """Return the largest deviation of a tool angle from its command [rad]; 0 within the position windows."""
        return max(
            (axis.off_rad(position) for axis, position in self._shafts(motor_positions_rad)), default=0.0
        )

    def _shafts(self, motor_positions_rad: ArrayLike) -> list[tuple[RotaryAxis, float]]:
        """Return the rotary axes with their shafts [rad], if known."""
        shafts = np.asarray(motor_positions_rad, dtype=np.float64)[ARMS:]
        return list(zip(self.rotary, shafts.tolist(), strict=False))

    def distance_m(self, motor_positions_rad: ArrayLike) -> float:
        """Return the distance of the TCP from its commanded position [m]; raises UnreachableError."""
        _, _, tcp = self._place(motor_positions_rad)
        return float(np.linalg.norm(tcp - self.state['tcp'][0]))

    def _place(self, motor_positions_rad: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return arm angles and gear twists [rad], and the TCP [m], of a robot at rest."""
        parameters = self._parameters
        shaft = np.asarray(motor_positions_rad, dtype=np.float64)[:ARMS] / parameters.dynamics.gear_ratio
        theta, twist = shaft, np.zeros(3)
        if parameters.gear_gives:
            compliance, half = parameters.gear_compliance_rad_n_m, 0.5 * parameters.control.gear_backlash_rad
            loaded = parameters.replace(dynamics__payload_mass_kg=self.payload)
            for _ in range(TWIST_ITERATIONS):
                weight = gravity(theta, loaded).tolist()
                twist = np.array([give(torque, compliance, half) for torque in weight])
                theta = shaft - twist
        return theta, twist, kinematics.forward(theta, parameters.kinematics)

    def load(self, plan: Plan) -> None:
        """Load a program, to be started by ``start``; raises ProgramError if its tool starts at another angle."""
        self.require_turns(plan)
        self.timeline = Timeline(plan, self._parameters.bus.cycle_time_s)
        self._schedule.cancel(Event.PROFILE, Event.PLAN)
        self.loaded = True
        state = self.state[0]
        state['start_cycle'], state['end_cycle'] = NEVER, self.timeline.end_cycle
        state['move'] = state['event'] = 0
        self._mark_measured()
        for stage in self._stages:
            stage.load(plan)

    def require_turns(self, plan: Plan) -> None:
        """Raise ProgramError if the plan starts at another tool angle, or turns a tool that does not exist."""
        require_turns(self.rotary, plan)

    def start(self, cycle: int, override: float = 1.0, smoothed: bool = False) -> int:
        """Start the loaded program at a future cycle; return the first cycle in which the TCP is at its end.

        A ``smoothed`` plan may jump: the servo stage follows it.
        """
        if not self.loaded:
            raise RunError('no program is loaded')
        if cycle < self.next_cycle:
            raise RunError(f'bus cycle {cycle} is over, the next one is {self.next_cycle}')
        self.timeline.start(cycle, override)
        state = self.state[0]
        state['start_cycle'], state['end_cycle'] = cycle, self.timeline.end_cycle
        state['move'] = state['event'] = 0
        state['payload'] = payload_on_grid(self.timeline.plan.move(0).payload_kg)
        for name in MEASURED:
            state[name] = 0
        self.current_peak, self.current_rms = [None] * 3, [None] * 3
        self._mark_measured()
        for stage in self._stages:
            stage.start(self.timeline)
        if smoothed:
            self.servo.smooth(cycle, self.timeline)
        return self.end_cycle

    def hold(self, acceleration_m_s2: float = 0.0) -> MotionProfile:
        """Stop the master on its path from the next cycle on; return the motion profile of the stop.

        The deceleration is that of the move, or ``acceleration_m_s2`` if larger.
        """
        cycle = max(self.next_cycle, self.timeline.start_cycle)
        if cycle >= self._schedule.cycles[Event.PLAN]:
            self._switch_plan(cycle, *self._schedule.contents[Event.PLAN])
        self._schedule.cancel(Event.PROFILE, Event.PLAN)
        profile = self.timeline.stop(cycle, acceleration_m_s2)
        self._follow(profile)
        self._halt(hard=acceleration_m_s2 > 0.0)
        return profile

    def _halt(self, hard: bool) -> None:
        """Bring the belt offset and a steered robot to rest from the next cycle on."""
        self.tracking.halt(self.next_cycle, hard)
        self.servo.halt(self.next_cycle, hard)
        if self.loaded:
            self.state['end_cycle'] = max(self.end_cycle, self.tracking.rest_cycle)

    def _stop_off_belt(self) -> None:
        """Stop plan and belt offset of a robot that cannot stay on its belt."""
        if self.loaded and not self.held:
            self.own_profile = self.hold()
        self._halt(hard=False)

    def stop_at(self, cycle: int, hard: bool = False) -> None:
        """Stop on the path from a future cycle on, then disable the drives.

        A hard stop uses ``motion.fault_stop_acceleration_m_s2`` where the move allows less: while one axis does not
        follow, the TCP leaves its path the more, the longer the other axes move.
        """
        first = min(self._schedule.cycles[Event.STOP], max(cycle, self.next_cycle))
        self._schedule.set(Event.STOP, first, hard or bool(self._schedule.contents[Event.STOP]))

    def enable(self, cycle: int) -> None:
        """Enable the drives from a future cycle on."""
        self.enable_cycle = cycle

    def disable(self) -> None:
        """Disable the drives from the next cycle on."""
        self.enable_cycle = NEVER

    @property
    def disable_cycle(self) -> int:
        """First cycle in which a stop disables the drives; ``NEVER`` without a stop."""
        return self._schedule.cycles[Event.DISABLE]

    def clear(self) -> None:
        """Clear program, pending stop and enabling, because cyclic operation has ended."""
        self.clear_program()
        self.tracking.clear()
        self.servo.clear()
        self.learned.fade_out(self.next_cycle, FAULT, for_good=True)
        self._schedule.cancel(Event.STOP, Event.DISABLE)
        self.disable()

    def _stop(self, cycle: int, hard: bool) -> None:
        self._schedule.cancel(Event.PROFILE, Event.PLAN)  # a robot at rest stays at rest
        self.learned.fade_out(cycle, FAULT, for_good=True)
        if self.enable_cycle > cycle:
            self.disable()
        if self.loaded and cycle < int(self.state['start_cycle'][0]):
            self.clear_program()
        if self.loaded and (not self.held or (hard and cycle < self.end_cycle)):
            self.hold(self._parameters.motion.fault_stop_acceleration_m_s2 if hard else 0.0)
        self._halt(hard)
        self.servo.halt(self.next_cycle, hard, leaves_plan=True)  # the drives are disabled at rest
        rest_cycle = max(
            cycle, self.tracking.rest_cycle, self.servo.rest_cycle, self.end_cycle if self.loaded else 0
        )
        self._schedule.set(Event.DISABLE, min(self.disable_cycle, rest_cycle + DISABLE_CYCLES))

    def change(self, profile: MotionProfile) -> None:
        """Switch to another motion profile at its cycle, which must be in the future; raises ProgramError."""
        if profile.cycle < self.next_cycle:
            raise ProgramError(f'bus cycle {profile.cycle} is over, the next one is {self.next_cycle}')
        self.timeline.check(profile)
        self._schedule.set(Event.PROFILE, profile.cycle, profile)

    def extend(self, first: int, kept: int, more: Plan, profile: MotionProfile) -> None:
        """Switch to an extended plan at its profile's cycle, which must be in the future; raises ProgramError."""
        timeline = self.timeline
        if self._schedule.cycles[Event.PROFILE] < NEVER:
            timeline = timeline.copy()
            timeline.change(self._schedule.contents[Event.PROFILE])
        if first != timeline.at(profile.cycle - 1).number:
            raise ProgramError(f'move {first} is not the one that is driven in bus cycle {profile.cycle - 1}')
        longer = timeline.plan.extended(first, kept, more)
        if not timeline.plan.turns:
            self.require_turns(longer)
        self._schedule.set(Event.PLAN, profile.cycle, (timeline.extended(longer, profile), first))

    def replace(self, plan: Plan, cycle: int, override: float) -> None:
        """Follow another plan that begins in a cycle, smoothed, instead of the running one; raises ProgramError.

        A plan that has begun already is joined in progress.
        """
        timeline = Timeline(plan, self._parameters.bus.cycle_time_s)
        timeline.start(cycle, override)
        first = max(cycle, self.next_cycle)
        if first >= timeline.end_cycle:
            raise ProgramError(f'its last bus cycle {timeline.end_cycle} is over, the next one is {first}')
        if first <= self._schedule.cycles[Event.PROFILE] < NEVER:
            raise ProgramError('the override changes in a later cycle')
        self._schedule.set(Event.PLAN, first, (timeline, self.moves))

    @property
    def extending(self) -> bool:
        """Whether an extended plan is pending."""
        return self._schedule.cycles[Event.PLAN] < NEVER

    def _switch_plan(self, cycle: int, timeline: Timeline, left_out: int) -> None:
        """Follow an extended plan, which omits the first ``left_out`` moves of the present one, or all of them."""
        if left_out == self.moves:
            self.servo.smooth(cycle, timeline, self.timeline)
            self.state['move'], self.state['event'] = left_out, 0
        self.timeline = timeline
        self.state['move'] -= left_out
        self.state['end_cycle'] = timeline.end_cycle
        self._mark_measured()
        for stage in self._stages:
            stage.extend(timeline, left_out)
        self.extensions += 1

    @property
    def pending_last_cycle(self) -> int:
        """``last_cycle`` once the pending profile or plan takes effect."""
        if self.extending:
            return int(self._schedule.contents[Event.PLAN][0].end_cycle) + SETTLE_CYCLES - 1
        if self._schedule.cycles[Event.PROFILE] == NEVER:
            return self.last_cycle
        return self.timeline.end_cycle_of(self._schedule.contents[Event.PROFILE]) + SETTLE_CYCLES - 1

    def _follow(self, profile: MotionProfile, reason: str = 'the program is not executed as planned') -> None:
        self.timeline.change(profile)
        self.state['end_cycle'] = self.timeline.end_cycle
        self._mark_measured()
        for stage in self._stages:
            stage.follow(self.timeline, reason)

    def _mark_measured(self) -> None:
        """Set the range of cycles that count for the figures of the program."""
        self._measured = int(self.state['start_cycle'][0]), self.last_cycle + 1

    def clear_program(self) -> None:
        """Clear the program; the TCP stays at its commanded position."""
        over = self.next_cycle >= self.end_cycle
        for stage in self._stages:
            stage.clear_program(self.next_cycle, '' if over else 'the program was aborted')
        self._schedule.cancel(Event.PROFILE, Event.PLAN)
        self.loaded = False
        self.state['start_cycle'] = self.state['end_cycle'] = NEVER
        self._mark_measured()

    @property
    def profile(self) -> MotionProfile | None:
        """The active motion profile, None before a start."""
        return self.timeline.profile

    @property
    def held(self) -> bool:
        """Whether the master is stopping or at rest on its path."""
        return self.profile is not None and self.profile.held

    @property
    def moves(self) -> int:
        """Number of moves of the program loaded last."""
        return len(self.timeline.plan) if self.timeline.plan is not _NO_PLAN else 0

    @property
    def outputs(self) -> int:
        """Outputs as bits, bit n for output n."""
        return int(self._state['outputs']) & (TRACK_BIT - 1)

    @property
    def payload(self) -> float:
        """Gripped payload [kg]."""
        return float(self._state['payload'])

    @property
    def end_cycle(self) -> int:
        """First cycle in which the set points are at rest at the end of the program, or of a stop."""
        return int(self.state['end_cycle'][0])

    @property
    def last_cycle(self) -> int:
        """Last cycle that counts for the figures of the program."""
        return self.end_cycle + SETTLE_CYCLES - 1

    def control(self, cycle: int) -> int:
        """Return the control word S-0-0134 of a cycle, the same for all drives."""
        enabled = self.enable_cycle <= cycle < self._schedule.cycles[Event.DISABLE]
        word = CONTROL_ENABLE if enabled else CONTROL_ON
        first, end = self._measured
        if cycle < first:
            return word
        return word | (CONTROL_MEASURE if cycle < end else CONTROL_PROGRAM)

    def command(self, cycle: int) -> Command:
        """Return the command of a cycle; call once per cycle, in order."""
        if cycle >= self._schedule.next_cycle:
            self._schedule.handle(cycle)
        for stage in self._commanding:
            stage.prepare(cycle)
        command_cycle(cycle, self.record, self.timeline.arrays, self.learned.torques)
        for stage in self._commanding:
            stage.command(cycle, self.record, self.timeline)
        self.next_cycle = cycle + 1
        state = self._state
        return Command(
            self.motors,
            self.torques,
            self.control(cycle),
            float(state['payload']),
            int(state['outputs']) & (TRACK_BIT - 1),
        )

    def cancel_tracking(self) -> None:
        """Stop the belt offset from the next cycle on, and clear belt and program once it is at rest."""
        if not self.tracking.free:
            self._halt(hard=False)
            self.tracking.clears_at_rest = True

    def clear_belt(self) -> None:
        """Clear belt and program of a robot at rest; the belt offset becomes part of its position."""
        if self.tracking.belts:
            if self.loaded:
                self.clear_program()
            self.tracking.clear()

    def next_event(self, cycle: int) -> int:
        """Return the first cycle from a cycle on in which more happens than continuing the motion profile."""
        if self.servo.active:
            return cycle
        # the control word changes at both ends of the measured range
        edge = next((edge for edge in self._measured if edge > cycle), NEVER)
        due = min(edge, self._schedule.next_cycle)
        return max(cycle, due if self.enable_cycle < cycle else min(due, self.enable_cycle))

    def _begin_wait(self, cycle: int, _: Any) -> None:
        self.own_profile = self._wait.rest_at(cycle, self.timeline)
        self._follow(self.own_profile, 'the program waits at an exact stop, for a time unknown in advance')

    def settling(self, cycle: int) -> bool:
        """Whether the program waits, after the feedback of a cycle, for the robot at an exact stop or at its end."""
        if not self.loaded or self.held or cycle < int(self.state['start_cycle'][0]):
            return False
        return self._wait.waits or cycle >= self.end_cycle

    def in_position(self, cycle: int) -> bool:
        """Whether every drive has been within its position window for long enough, by the feedback of a cycle.

        The count starts at the cycle in which the set points came to rest: earlier feedback may still arrive.
        """
        stood = cycle + 1 - (self._wait.since if self._wait.waits else self.end_cycle)
        return self._wait.is_long_enough(min(self.within, stood))

    @property
    def turns_rad(self) -> tuple[float, ...]:
        """Commanded tool angles of the rotary axes."""
        return tuple(axis.angle_rad for axis in self.rotary)

    @property
    def within(self) -> int:
        """Number of consecutive bus cycles for which every drive has been within its position window."""
        return min([int(self.state['within'][0]), *(axis.within for axis in self.rotary)])

    def settle(self, cycle: int) -> RobotFault | None:
        """Leave an exact stop once the feedback of a cycle shows the robot in position.

        Returns a fault if the robot did not settle in time, at an exact stop or at the end of its program.
        """
        if not self.settling(cycle):
            return None
        wait = self._wait
        if self.in_position(cycle):
            if wait.waits and self._schedule.cycles[Event.PROFILE] == NEVER and not self.extending:
                self.own_profile = wait.departure(cycle, self.timeline)
                self._schedule.set(Event.PROFILE, self.own_profile.cycle, self.own_profile)
            return None
        if wait.waits:
            return wait.fault(
                cycle, wait.since, f'at the end of move {wait.number}', self._off(), self.within
            )
        if cycle < self.last_cycle:
            return None
        return wait.fault(cycle, self.end_cycle, 'at the end of the program', self._off(), self.within)

    def _off(self) -> Floats:
        """Return the deviations of all motors from their commands [rad]."""
        return np.concatenate([self.state['off'][0], *(axis.state['off'] for axis in self.rotary)])

    def receive(self, cycle: int, positions_rad: Floats, torques_n_m: Floats) -> np.void:
        """Evaluate the feedback of a cycle, in order; return it as a record ``ANSWER``.

        Values of the rotary axes follow those of the arms, if known.
        """
        answer_cycle(cycle, positions_rad, torques_n_m, self.record)
        answers = zip(self.rotary, positions_rad[ARMS:], torques_n_m[ARMS:], strict=False)
        for axis, position_rad, torque_n_m in answers:
            axis.receive(cycle, float(position_rad), float(torque_n_m), self.record)
        return self.answer

    def progress(self) -> tuple[int, float, float]:
        """Return the number of the active move, master position [m] and speed [m/s]."""
        state = self.state[0]
        return int(state['move']), float(state['master']), float(state['master_speed'])

    def figures(self) -> Figures:
        """Return the results so far."""
        s = self.state[0]
        cycles = max(int(s['measured_cycles']), 1)
        return Figures(
            measured_cycles=int(s['measured_cycles']),
            tcp_error_max_m=float(s['error_max']),
            tcp_error_rms_m=math.sqrt(float(s['error_square_sum']) / cycles),
            following_error_max_rad=float(s['following_error_max']),
            final_tcp_m=s['final_tcp'].tolist(),
            current_peak_a=list(self.current_peak),
            current_rms_a=list(self.current_rms),
            at_current_peak_a=s['current_peak'].tolist(),
            at_current_rms_a=np.sqrt(s['current_square_sum'] / cycles).tolist(),
            turns=tuple(axis.figures() for axis in self.rotary),
        )


# placeholder before the first program, with the types that the compiled code expects
_NO_PLAN = Plan.of([Move(MoveKind.DWELL, rest(1.0), point((0.0, 0.0, 0.0)).segments)])
