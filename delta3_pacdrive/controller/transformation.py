"""The transformation task: one bus cycle of plan -> TCP -> arm angles -> motor commands, and what comes back.

In each cycle the plan gives the TCP, inverse kinematics the arm angles, the gear the motor shafts (thesis 6, 7). What
the drives answer serves only the following error and supervision, never the next command: cycles may be outstanding.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from delta3_pacdrive import kinematics
from delta3_pacdrive.controller.belt_tracking import BeltTracking
from delta3_pacdrive.controller.learned_torques import FAULT, LearnedTorques
from delta3_pacdrive.controller.position_wait import PositionWait
from delta3_pacdrive.controller.task_arrays import SETTLE_CYCLES, TASK, stand_at, task_constants
from delta3_pacdrive.controller.task_cycle import answer_cycle, command_cycle, give
from delta3_pacdrive.controller.turning import TurnFigures, Turning, require_turns
from delta3_pacdrive.dynamics import gravity, inertia
from delta3_pacdrive.errors import ProgramError, RobotFault, RunError
from delta3_pacdrive.kinematics import geometry
from delta3_pacdrive.motion.belt_meeting import BeltAxes
from delta3_pacdrive.motion.curves import point
from delta3_pacdrive.motion.execution import MasterState, MotionProfile, Timeline
from delta3_pacdrive.motion.learned import Learned
from delta3_pacdrive.motion.move import TRACK_BIT, Move, MoveKind
from delta3_pacdrive.motion.plan import Plan
from delta3_pacdrive.motion.virtual_master import rest
from delta3_pacdrive.motor import motor
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.sercos.bus_time import NEVER
from delta3_pacdrive.sercos.configuration_check import DRIVES
from delta3_pacdrive.sercos.words import (
    CONTROL_ENABLE,
    CONTROL_MEASURE,
    CONTROL_ON,
    CONTROL_PROGRAM,
    payload_on_grid,
)

# figures of a program, which begin with it
MEASURED = (
    'measured_cycles', 'error_max', 'error_square_sum', 'following_error_max', 'current_peak', 'current_square_sum'
)  # fmt: skip
# each makes the error some thousand times smaller: the weight hardly changes within a twist
TWIST_ITERATIONS = 4
TOOL = len(DRIVES)  # number of the rotary axis, behind the arms
DISABLE_CYCLES = 40  # after a stop: a drive that still follows needs them to see that its command stands


@dataclass(frozen=True)
class Figures:
    """A program has these results: TCP errors without the set-point delay, and currents of each axis.

    ``current_peak_a`` and ``current_rms_a`` are of all samples of the current loops, None until the drives have told
    them; ``at_current_peak_a`` and ``at_current_rms_a`` of the one sample in a bus cycle that an AT tells.
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
    turn: TurnFigures | None = None  # of a robot with a rotary axis

    @property
    def told(self) -> dict[str, Any]:
        """The figures under the names that results of runs have."""
        of_tool = {} if self.turn is None else self.turn.told
        return {name: value for name, value in vars(self).items() if name != 'turn'} | of_tool


class Transformation:
    """The task makes the cyclic calculations of the controller; it knows bus cycles, no clock and no messages.

    Parameters
    ----------
    parameters
        Of the robot.
    learned
        Torques that are commanded with the plan that they were learned for.

    Attributes
    ----------
    record, state, motors, torques, answer
        Arrays of the compiled code: one record ``TASK``, its state, its commands [rad] and [N m], what the answers of a
        cycle give (``ANSWER``).
    timeline, loaded
        The program in bus time, and whether it is loaded.
    next_cycle
        Cycle of the next command.
    own_profile
        The newest motion profile by which the task itself waits for the robot at an exact stop, or goes on.
    extensions
        How often a plan has become longer while it was driven.
    enable_cycle, disable_cycle
        From which cycle on the drives are enabled, and no longer; ``NEVER`` for none.
    learned
        Its learned torques, which are followed or not.
    tracking
        Of the belts on its bus; None: there are none.
    turning
        Commands of the rotary axis; None: the robot has none.
    current_peak, current_rms
        Of the motors in the program [A], by axis, as the drives have formed them of all samples; None: not known yet.

    """

    def __init__(self, parameters: Parameters, learned: Learned | None = None) -> None:
        self._parameters = parameters
        self.record = record = np.zeros(1, TASK)
        record['constants'], record['geometry'] = task_constants(parameters), geometry(parameters.kinematics)
        record['inertia'], record['motor'] = inertia(parameters), motor(parameters)
        self.state: NDArray[Any] = record['state']
        self.motors: Floats = record['motors'][0]
        self.torques: Floats = record['torques'][0]
        self.answer: np.void = record['answer'][0]
        self.state['start_cycle'] = self.state['end_cycle'] = NEVER
        self.state['payload'] = payload_on_grid(parameters.dynamics.payload_mass_kg)
        self.timeline = Timeline(_NO_PLAN, parameters.bus.cycle_time_s)
        self._coming: MotionProfile | None = None
        # a longer plan that is still to come, and how many moves it leaves out
        self._longer: tuple[Timeline, int] | None = None
        self.learned = LearnedTorques(parameters, learned, _NO_PLAN, self.state)
        self.next_cycle = 0  # of the next command
        self.loaded = False
        self.extensions = 0
        self._wait = PositionWait(parameters)
        self.tracking: BeltTracking | None = None
        self.turning = Turning(parameters) if parameters.rotary.present else None
        if self.turning is not None:
            self.turning.rehearse(record, self.timeline)
        self.own_profile: MotionProfile | None = None
        self.enable_cycle = self.disable_cycle = NEVER
        self._stop_cycle = NEVER
        self._stop_hard = False
        # first cycle whose currents are figures of the program, and the one after them
        self._measured = NEVER, NEVER
        self.current_peak: list[float | None] = [None] * 3
        self.current_rms: list[float | None] = [None] * 3

    def follow_belts(self, belts: Sequence[BeltAxes]) -> None:
        """Know these belts from now on, and forget what was known of any: the bus begins."""
        self.release()
        self.tracking = BeltTracking(self._parameters, belts) if belts else None

    def locate(self, motor_positions_rad: ArrayLike) -> Floats:
        """Take over where the motors stand, by forward kinematics in the first cycle (6); return the TCP [m].

        Behind those of the arms comes that of the rotary axis, where it is known.
        """
        theta, twist, tcp = self._place(motor_positions_rad)
        stand_at(theta, twist, tcp, self.state[0])
        self.locate_tool(motor_positions_rad)
        return tcp

    def locate_tool(self, motor_positions_rad: ArrayLike) -> None:
        """Take over where the tool stands, unless that is where it is commanded to be."""
        if self.tool_off_rad(motor_positions_rad) > 0.0 and self.turning is not None:
            self.turning.stand_behind(float(np.asarray(motor_positions_rad)[TOOL]))

    def tool_off_rad(self, motor_positions_rad: ArrayLike) -> float:
        """Return how far the tool is from where it is commanded to be [rad]; 0 within the window of its drive."""
        shafts = np.asarray(motor_positions_rad, dtype=np.float64)
        if self.turning is None or len(shafts) <= TOOL:
            return 0.0
        return self.turning.off_rad(float(shafts[TOOL]))

    def distance_m(self, motor_positions_rad: ArrayLike) -> float:
        """Return how far the TCP is from where it is commanded to be [m]; raises UnreachableError."""
        _, _, tcp = self._place(motor_positions_rad)
        return float(np.linalg.norm(tcp - self.state['tcp'][0]))

    def _place(self, motor_positions_rad: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return arm angles, twists of the gears [rad] and TCP [m] of a robot at rest."""
        parameters = self._parameters
        shaft = np.asarray(motor_positions_rad, dtype=np.float64)[:TOOL] / parameters.dynamics.gear_ratio
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
        """Take over a program; it waits for ``start``. Raises ProgramError if its tool stands elsewhere."""
        self.require_turns(plan)
        self.timeline = Timeline(plan, self._parameters.bus.cycle_time_s)
        if self.turning is not None:
            self.turning.follow(plan)
        self.state['end_cycle'] = self.timeline.end_cycle
        self._drop_coming()
        self.learned.load(plan)
        self.loaded = True
        state = self.state[0]
        state['start_cycle'] = NEVER
        state['move'] = state['event'] = 0
        self._mark_measured()

    def require_turns(self, plan: Plan) -> None:
        """Refuse a plan that turns a tool which is not there, or stands elsewhere; raises ProgramError."""
        require_turns(self.turning, plan)

    def start(self, cycle: int, override: float = 1.0) -> int:
        """Start the loaded program at a cycle to come; return the first one in which the TCP has arrived."""
        if not self.loaded:
            raise RunError('no program is loaded')
        if cycle < self.next_cycle:
            raise RunError(f'bus cycle {cycle} is over, the next one is {self.next_cycle}')
        self.timeline.start(cycle, override)
        self.state['end_cycle'] = self.timeline.end_cycle
        state = self.state[0]
        state['start_cycle'], state['move'], state['event'] = cycle, 0, 0
        state['payload'] = payload_on_grid(self.timeline.plan.move(0).payload_kg)
        for name in MEASURED:
            state[name] = 0
        if self.turning is not None:
            self.turning.begin()
        self.current_peak, self.current_rms = [None] * 3, [None] * 3
        self._mark_measured()
        self._wait.begin(self.timeline)
        self.learned.start(cycle, override)
        return self.end_cycle

    def hold(self, acceleration_m_s2: float = 0.0) -> MotionProfile:
        """Stop the master on its path from the next cycle on; return the motion profile of the stop.

        It takes the acceleration of the move, or that one if it is larger.
        """
        cycle = max(self.next_cycle, self.timeline.start_cycle)
        self._go_over(cycle)
        self._drop_coming()
        profile = self.timeline.stop(cycle, acceleration_m_s2)
        self._follow(profile)
        self._halt(hard=acceleration_m_s2 > 0.0)
        return profile

    def _halt(self, hard: bool) -> None:
        """Bring what goes with a belt to rest from the next cycle on."""
        if self.tracking is not None:
            self.tracking.halt(self.next_cycle, hard)
            if self.loaded:
                self.state['end_cycle'] = max(self.end_cycle, self.tracking.rest_cycle)

    def stop_at(self, cycle: int, hard: bool = False) -> None:
        """Stop on the path from a cycle on that is still to come, then take the torque off.

        A hard stop takes ``motion.fault_stop_acceleration_m_s2`` where the move allows less: an axis does not follow
        any more, and the farther the others go on without it, the farther the TCP is off its path.
        """
        self._stop_cycle = min(self._stop_cycle, max(cycle, self.next_cycle))
        self._stop_hard = self._stop_hard or hard

    def enable(self, cycle: int) -> None:
        """Enable the drives from a cycle on that is still to come."""
        self.enable_cycle = cycle

    def disable(self) -> None:
        """Enable the drives no longer, from the next cycle on."""
        self.enable_cycle = NEVER

    def give_up(self) -> None:
        """Forget program, stop and enabling: there are no more cycles."""
        self.unload()
        self.release()
        self.learned.drop(self.next_cycle, FAULT, for_good=True)
        self._stop_cycle = self.enable_cycle = self.disable_cycle = NEVER
        self._stop_hard = False

    def _stop(self, cycle: int) -> None:
        hard, self._stop_hard = self._stop_hard, False
        self._stop_cycle = NEVER
        self._drop_coming()  # who stands stays so
        self.learned.drop(cycle, FAULT, for_good=True)
        if self.enable_cycle > cycle:
            self.enable_cycle = NEVER
        if self.loaded and cycle < int(self.state['start_cycle'][0]):
            self.unload()
        if self.loaded and (not self.held or (hard and cycle < self.end_cycle)):
            self.hold(self._parameters.motion.fault_stop_acceleration_m_s2 if hard else 0.0)
        self._halt(hard)
        stands = max(self.end_cycle, cycle) if self.loaded else cycle
        if self.tracking is not None:
            stands = max(stands, self.tracking.rest_cycle)
        self.disable_cycle = min(self.disable_cycle, stands + DISABLE_CYCLES)

    def change(self, profile: MotionProfile) -> None:
        """Go over to another motion profile at its cycle, which is still to come; raises ProgramError."""
        if profile.cycle < self.next_cycle:
            raise ProgramError(f'bus cycle {profile.cycle} is over, the next one is {self.next_cycle}')
        self.timeline.check(profile)
        self._coming = profile

    def extend(self, first: int, kept: int, more: Plan, profile: MotionProfile) -> None:
        """Go over to a longer plan at the cycle of its motion profile, which is still to come; raises ProgramError."""
        timeline = self.timeline
        if self._coming is not None:
            timeline = timeline.copy()
            timeline.change(self._coming)
        if first != timeline.at(profile.cycle - 1).number:
            raise ProgramError(f'move {first} is not the one that is driven in bus cycle {profile.cycle - 1}')
        longer = timeline.plan.extended(first, kept, more)
        if timeline.plan.turns is None:
            self.require_turns(longer)
        self._longer = timeline.extended(longer, profile), first

    @property
    def extending(self) -> bool:
        """Whether a longer plan is still to come."""
        return self._longer is not None

    def _go_over(self, cycle: int) -> None:
        """Follow the longer plan that was to come, once its cycle is there."""
        if self._longer is None or cycle < self._longer[0].start_cycle:
            return
        self.timeline, left_out = self._longer
        self._longer = None
        if self.turning is not None:
            self.turning.follow(self.timeline.plan)
        self.state['move'] -= left_out
        self.state['end_cycle'] = self.timeline.end_cycle
        self._mark_measured()
        self._wait.lengthen(self.timeline, left_out)
        self.learned.drop(cycle, 'the program has become longer')
        self.extensions += 1

    def _drop_coming(self) -> None:
        self._coming = self._longer = None

    @property
    def coming_last_cycle(self) -> int:
        """Last cycle whose answer counts, once the motion profile that is still to come is followed."""
        if self._longer is not None:
            return self._longer[0].end_cycle + SETTLE_CYCLES - 1
        if self._coming is None:
            return self.last_cycle
        return self.timeline.end_cycle_of(self._coming) + SETTLE_CYCLES - 1

    def _follow(
        self, profile: MotionProfile, unlearned: str = 'the program is driven otherwise than planned'
    ) -> None:
        self.timeline.change(profile)
        self.learned.drop(profile.cycle, unlearned)
        self.state['end_cycle'] = self.timeline.end_cycle
        self._wait.follow(self.timeline)
        self._mark_measured()

    def _mark_measured(self) -> None:
        """Note which cycles count for the figures of the program, now that it begins or ends in other ones."""
        self._measured = int(self.state['start_cycle'][0]), self.last_cycle + 1

    def unload(self) -> None:
        """Forget the program; the TCP stays where it is commanded to be."""
        over = self.next_cycle >= self.end_cycle
        self.learned.drop(self.next_cycle, '' if over else 'the program was given up')
        self._wait.end()
        self._drop_coming()
        self.loaded = False
        self.state['start_cycle'] = self.state['end_cycle'] = NEVER
        self._mark_measured()

    @property
    def profile(self) -> MotionProfile | None:
        """What the master follows, ``None`` before a start."""
        return self.timeline.profile

    @property
    def held(self) -> bool:
        """Whether the master stops, or stands, on its path."""
        return self.profile is not None and self.profile.held

    def master(self, cycle: int) -> MasterState:
        """Return the master in a cycle of the present motion profile."""
        return self.timeline.at(cycle)

    @property
    def moves(self) -> int:
        """Number of moves of the last program that was loaded."""
        return len(self.timeline.plan) if self.timeline.plan is not _NO_PLAN else 0

    @property
    def outputs(self) -> int:
        """Outputs as bits: bit n = output n."""
        return int(self.state['outputs'][0]) & (TRACK_BIT - 1)

    @property
    def payload(self) -> float:
        """Payload [kg] that the outputs have gripped."""
        return float(self.state['payload'][0])

    @property
    def end_cycle(self) -> int:
        """First cycle in which the TCP stands at the end of the program, or of a stop."""
        return int(self.state['end_cycle'][0])

    @property
    def last_cycle(self) -> int:
        """Last cycle whose answer counts for the figures of the program."""
        return self.end_cycle + SETTLE_CYCLES - 1

    def control(self, cycle: int) -> int:
        """Control word S-0-0134 of a cycle, the same for all drives."""
        word = CONTROL_ENABLE if self.enable_cycle <= cycle < self.disable_cycle else CONTROL_ON
        first, end = self._measured
        if cycle < first:
            return word
        return word | (CONTROL_MEASURE if cycle < end else CONTROL_PROGRAM)

    def command(self, cycle: int) -> Floats:
        """Motor shaft commands [rad] of a cycle, on the increment grid; cycles are asked for in order."""
        if self._coming is not None and cycle >= self._coming.cycle:
            profile, self._coming = self._coming, None
            self._follow(profile)
        if self._longer is not None:
            self._go_over(cycle)
        if cycle >= self._stop_cycle:
            self._stop(cycle)
        if cycle >= self._wait.first_cycle:
            self._begin_wait(cycle)
        if cycle >= self.disable_cycle:
            self.enable_cycle = self.disable_cycle = NEVER
        if self.tracking is not None:
            self._track(cycle, self.tracking)
        command_cycle(cycle, self.record, self.timeline.arrays, self.learned.torques)
        if self.tracking is not None:
            self.tracking.watch_speed(cycle, self.timeline if self.loaded else None)
        if self.turning is not None:
            self.turning.command(cycle, self.record, self.timeline)
        self.next_cycle = cycle + 1
        return self.motors

    def _track(self, cycle: int, tracking: BeltTracking) -> None:
        """Add what goes with a belt to the command of a cycle; hold the plan if the robot cannot stay on its belt."""
        state = self.state[0]
        if tracking.lost is not None:
            if self.loaded and not self.held:
                self.own_profile = self.hold()
            self._halt(hard=False)
        if tracking.step(cycle, bool(state['outputs'] & TRACK_BIT)):
            state['tracks'], state['offset'] = 1, tracking.offset
        elif state['tracks']:
            state['tracks'], state['tcp'] = 0, state['planned']
        if tracking.forgets and not self.loaded and cycle > tracking.rest_cycle:
            self.release()

    @property
    def lost_belt(self) -> bool:
        """Whether the robot could not stay on a belt, and nobody has settled that."""
        return self.tracking is not None and self.tracking.lost is not None

    def leave_belt(self) -> None:
        """Stop what goes with a belt from the next cycle on, and forget it once it stands, as a program is over."""
        if self.tracking is not None and not self.tracking.free:
            self._halt(hard=False)
            self.tracking.forgets = True

    def release(self) -> None:
        """Forget belt and program of a robot that stands: it stands there beside the belt."""
        if self.tracking is None:
            return
        state = self.state[0]
        if self.loaded:
            self.unload()
        self.tracking.release()
        state['outputs'] &= TRACK_BIT - 1
        state['tracks'], state['planned'] = 0, state['tcp']

    def next_event(self, cycle: int) -> int:
        """Return the first cycle from a cycle on whose command does more than follow the present motion profile."""
        coming = NEVER if self._coming is None else self._coming.cycle
        longer = NEVER if self._longer is None else self._longer[0].start_cycle
        # at either end of the measured cycles the control word changes
        edge = next((edge for edge in self._measured if edge > cycle), NEVER)
        due = min(coming, longer, edge, self._stop_cycle, self.disable_cycle, self._wait.first_cycle)
        return max(cycle, due if self.enable_cycle < cycle else min(due, self.enable_cycle))

    def _begin_wait(self, cycle: int) -> None:
        self.own_profile = self._wait.rest_at(cycle, self.timeline)
        self._follow(self.own_profile, 'the program waits at an exact stop: how long is not known beforehand')

    def settling(self, cycle: int) -> bool:
        """Whether a program waits for the robot, at an exact stop or at its end, when a cycle has been answered."""
        if not self.loaded or self.held or cycle < int(self.state['start_cycle'][0]):
            return False
        return self._wait.waits or cycle >= self.end_cycle

    def in_position(self, cycle: int) -> bool:
        """Whether every drive has been within its position window for long enough when a cycle has been answered.

        That counts from the cycle on in which the set points stand: answers of earlier ones may still be on their way.
        """
        stood = cycle + 1 - (self._wait.since if self._wait.waits else self.end_cycle)
        return self._wait.is_long_enough(min(self.within, stood))

    @property
    def within(self) -> int:
        """For how many bus cycles every drive has been within its position window."""
        within = int(self.state['within'][0])
        return within if self.turning is None else min(within, self.turning.within)

    def settle(self, cycle: int) -> RobotFault | None:
        """Go on behind an exact stop once the answers of a cycle tell of a robot in position.

        Returns the fault of one that has not come to a stop, or to the end of its program, in time.
        """
        if not self.settling(cycle):
            return None
        wait, end = self._wait, self.end_cycle
        if self.in_position(cycle):
            if wait.waits and self._coming is None and self._longer is None:
                self._coming = self.own_profile = wait.way_on(cycle, self.timeline)
            return None
        if wait.waits:
            return wait.fault(
                cycle, wait.since, f'at the end of move {wait.number}', self.state[0], self._tool
            )
        if cycle < self.last_cycle:
            return None
        return wait.fault(cycle, end, 'at the end of the program', self.state[0], self._tool)

    @property
    def _tool(self) -> np.void | None:
        return None if self.turning is None else self.turning.state[0]

    def commanded_to(self, cycle: int) -> None:
        """Note that compiled code has given the commands of the cycles before this one."""
        self.next_cycle = cycle

    def receive(self, cycle: int, positions_rad: Floats, torques_n_m: Floats) -> np.void:
        """Evaluate the answers of a cycle, in order; return what they give (``ANSWER``).

        Behind the positions and torques of the arms come those of the rotary axis, where they are known.
        """
        answer_cycle(cycle, positions_rad, torques_n_m, self.record)
        if self.turning is not None and len(positions_rad) > TOOL:
            self.turning.receive(cycle, float(positions_rad[TOOL]), float(torques_n_m[TOOL]), self.record)
        return self.answer

    def progress(self) -> tuple[int, float, float]:
        """Number of the present move, master position [m] and speed [m/s]."""
        state = self.state[0]
        return int(state['move']), float(state['master']), float(state['master_speed'])

    def figures(self) -> Figures:
        """Results so far."""
        s = self.state[0]
        cycles = max(int(s['measured_cycles']), 1)
        return Figures(
            int(s['measured_cycles']),
            float(s['error_max']),
            math.sqrt(float(s['error_square_sum']) / cycles),
            float(s['following_error_max']),
            s['final_tcp'].tolist(),
            list(self.current_peak),
            list(self.current_rms),
            s['current_peak'].tolist(),
            np.sqrt(s['current_square_sum'] / cycles).tolist(),
            None if self.turning is None else self.turning.figures(),
        )


# before the first program: the types that the compiled code knows
_NO_PLAN = Plan.of([Move(MoveKind.DWELL, rest(1.0), point((0.0, 0.0, 0.0)).segments)])
