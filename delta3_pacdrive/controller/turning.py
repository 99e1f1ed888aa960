"""The rotary axis in the controller: a command in each bus cycle beside those of the arms, and what comes back.

The angle of the tool is a function of the distance on the path, so that it stays with the TCP through override, hold
and resume. Where the plan says nothing of the tool, it stands where it is commanded to be.

Arguments of the kernels here:

``cycle``
    Number of a bus cycle.
``task``, ``timeline``
    As in ``task_cycle``: array of one record ``TASK``, shape (1,), and ``motion.execution.TimelineArrays``.
``turns``
    Those of the plan: a ``motion.turns.TurnTables``, with no piece if the plan says nothing of the tool.
``turning``
    Array of one record ``TURNING``, shape (1,).
``position``, ``torque``
    Of the motor shaft of the axis, as its drive has answered [rad], [N m].
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.controller.task_arrays import HISTORY, SETTLE_CYCLES
from delta3_pacdrive.controller.task_cycle import coming_payload, is_over
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion.execution import Timeline, plan_time_at, profile_at
from delta3_pacdrive.motion.plan import Plan
from delta3_pacdrive.motion.turning_move import NO_AXIS
from delta3_pacdrive.motion.turns import JOINED_RAD, TURN_COLUMNS, TurnTables, turn_at
from delta3_pacdrive.motor import MOTOR, friction_torque, motor
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.parameters import Parameters, of_tool_axis
from delta3_pacdrive.sercos.increments import on_grid

TURNING_STATE = np.dtype(
    [
        ('angle', 'f8'),  # of the tool, commanded [rad]
        ('angle_history', 'f8', (HISTORY,)),
        ('motor', 'f8'),  # motor command [rad]
        ('torque', 'f8'),  # that the motor is to have beside it [N m], else 0
        ('move', 'i8'),  # number of the move that is driven; one more once the program is over
        (
            'passed_history',
            'f8',
            (HISTORY,),
        ),  # how many cycles before it a move has ended, in the last one; else PASSED_NONE
        # of the last answer
        ('answered', 'f8'),  # angle that was commanded in its cycle [rad]
        ('due', 'f8'),  # angle that the actual one answers to [rad]
        ('actual', 'f8'),  # angle of the tool by the encoder of the motor [rad]
        ('error', 'f8'),  # of that, set-point delay removed [rad]
        ('off', 'f8'),  # of the motor from its command [rad]
        ('within', 'i8'),  # cycles for which that was no farther than the window
        # figures of the program, as those of STATE
        ('measured_cycles', 'i8'),
        ('error_max', 'f8'),
        ('place_error_max', 'f8'),
        ('current_peak', 'f8'),
        ('current_square_sum', 'f8'),
    ],
    align=True,
)

TURNING_CONSTANTS = np.dtype(
    [
        ('gear_ratio', 'f8'),
        ('increments_per_rad', 'f8'),
        ('cycle_time', 'f8'),
        ('set_point_delay', 'f8'),  # [cycles]
        ('position_window', 'f8'),  # motor side [rad]
        ('sends_torque', 'f8'),
        ('torque_lead', 'f8'),  # [s]: see ``task_cycle.feed_forward``
        ('torque_max', 'f8'),  # [N m]
        ('inertia', 'f8'),  # of rotor, bar and tool, motor side [kg m^2]
        ('part_inertia', 'f8'),  # of a part per mass, motor side [m^2]
    ],
    align=True,
)

TURNING = np.dtype([('state', TURNING_STATE), ('constants', TURNING_CONSTANTS), ('motor', MOTOR)], align=True)


# figures of a program, which begin with it
MEASURED = ('measured_cycles', 'error_max', 'place_error_max', 'current_peak', 'current_square_sum')
PASSED_NONE = -1.0


@dataclass(frozen=True)
class TurnFigures:
    """A program has these results at the rotary axis, by the encoder and the currents that the AT of its drive tell.

    Attributes
    ----------
    measured_cycles
        Bus cycles that they are of.
    error_max_rad, place_error_max_rad
        Largest error of the angle, set-point delay removed: at any time, and where moves end.
    current_peak_a, current_rms_a
        Of its motor.

    """

    measured_cycles: int
    error_max_rad: float
    place_error_max_rad: float
    current_peak_a: float
    current_rms_a: float

    def to_dict(self) -> dict[str, float]:
        """The figures under the names that results of runs have."""
        return {
            'turn_error_max_rad': self.error_max_rad,
            'turn_encoder_place_error_max_rad': self.place_error_max_rad,
            'turn_current_peak_a': self.current_peak_a,
            'turn_current_rms_a': self.current_rms_a,
        }


def combined_turns(figures: Sequence[TurnFigures]) -> TurnFigures | None:
    """Return the figures of several programs together; None: there are none."""
    if not figures:
        return None
    cycles = sum(one.measured_cycles for one in figures)
    square_sum = sum(one.measured_cycles * one.current_rms_a**2 for one in figures)
    return TurnFigures(
        cycles,
        max(one.error_max_rad for one in figures),
        max(one.place_error_max_rad for one in figures),
        max(one.current_peak_a for one in figures),
        math.sqrt(square_sum / max(cycles, 1)),
    )


def _constants(parameters: Parameters) -> NDArray[Any]:
    rotary, axis = parameters.rotary, of_tool_axis(parameters)
    record = np.zeros(1, TURNING_CONSTANTS)
    record['gear_ratio'] = rotary.gear_ratio
    record['increments_per_rad'] = parameters.bus.increments_per_rev / math.tau
    record['cycle_time'] = parameters.bus.cycle_time_s
    record['set_point_delay'] = parameters.set_point_delay_cycles
    record['position_window'] = axis.drive.position_window_rad
    record['sends_torque'] = parameters.sends_torque
    record['torque_lead'] = parameters.drive.position_period_s + axis.torque_dead_time_s
    record['torque_max'] = axis.torque_max_n_m
    record['inertia'] = rotary.shaft_inertia_kg_m2(0.0)
    record['part_inertia'] = rotary.shaft_inertia_kg_m2(1.0) - rotary.shaft_inertia_kg_m2(0.0)
    return record


@kernel
def command_turn(cycle, task, timeline, turns, turning):
    """Fill the command of the axis for a bus cycle, behind ``command_cycle`` for the same one."""
    s, t, c = task[0].state, turning[0].state, turning[0].constants
    turns_now = turns.rows.shape[0] > 0 and cycle >= s.start_cycle
    if turns_now:
        t.angle, _, _ = turn_at(s.master, s.move, turns)
    t.angle_history[cycle % HISTORY] = t.angle
    t.passed_history[cycle % HISTORY] = _passed(cycle, s, timeline, t, c)
    t.motor = on_grid(t.angle * c.gear_ratio, c.increments_per_rad)
    t.torque = 0.0
    if c.sends_torque != 0.0:
        speed, acceleration = 0.0, 0.0
        if turns.rows.shape[0] > 0 and (s.start_cycle - cycle) * c.cycle_time <= c.torque_lead:
            time = (cycle - timeline.profile[0].cycle) * c.cycle_time + c.torque_lead
            number, distance, v, a = profile_at(time, s.move, timeline)
            _, first, second = turn_at(distance, number, turns)
            speed, acceleration = first * v, second * v * v + first * a
        inertia = c.inertia + c.part_inertia * coming_payload(cycle, task, timeline)
        torque = inertia * c.gear_ratio * acceleration
        torque += friction_torque(c.gear_ratio * speed, turning[0].motor)
        t.torque = min(max(torque, -c.torque_max), c.torque_max)


@kernel
def _passed(cycle, s, timeline, t, c):
    """Return how many cycles before this one a move has ended, ``PASSED_NONE`` if none has since the last command.

    ``s``, ``t`` and ``c`` are the state of the task, and state and constants of the axis.
    """
    profile, before = timeline.profile[0], t.move
    if cycle < s.start_cycle:
        return PASSED_NONE
    t.move = s.move + 1 if is_over(cycle, s, profile) else s.move
    if t.move <= before:
        return PASSED_NONE
    since = plan_time_at((cycle - profile.cycle) * c.cycle_time, profile) - timeline.tables.starts[t.move]
    return min(max(since / (profile.override * c.cycle_time), 0.0), 1.0)


@kernel
def error_at_places(cycle, error, before, turning):
    """Return how far the tool is off where a move ends [rad], 0 if none ends between two set points that are due.

    Parameters
    ----------
    cycle, turning
        As above.
    error, before
        Of the angle [rad], set-point delay removed, in the answers of this cycle and of the one before.

    """
    passed, delay = turning[0].state.passed_history, turning[0].constants.set_point_delay
    whole = math.floor(delay)
    share, found = delay - whole, 0.0
    for back in range(2):
        ended = passed[max(cycle - int(whole) - back, 0) % HISTORY]
        since = ended + back - share
        if ended != PASSED_NONE and 0.0 <= since < 1.0:
            found = max(found, abs((1.0 - since) * error + since * before))
    return found


@kernel
def answer_turn(cycle, position, torque, task, turning):
    """Evaluate the answer of the axis in a bus cycle."""
    s, t, c = task[0].state, turning[0].state, turning[0].constants
    whole = math.floor(c.set_point_delay)
    share = c.set_point_delay - whole
    newer = max(cycle - int(whole), 0) % HISTORY
    older = max(cycle - int(whole) - 1, 0) % HISTORY
    t.due = (1.0 - share) * t.angle_history[newer] + share * t.angle_history[older]
    t.answered = t.angle_history[cycle % HISTORY]
    t.actual = position / c.gear_ratio
    before, t.error = t.error, t.due - t.actual
    t.off = t.answered * c.gear_ratio - position
    t.within = t.within + 1 if abs(t.off) <= c.position_window else 0
    if s.start_cycle <= cycle < s.end_cycle + SETTLE_CYCLES:
        current = torque / turning[0].motor.torque_constant
        t.measured_cycles += 1
        t.error_max = max(t.error_max, abs(t.error))
        t.place_error_max = max(t.place_error_max, error_at_places(cycle, t.error, before, turning))
        t.current_peak = max(t.current_peak, abs(current))
        t.current_square_sum += current * current


NO_TURNS = TurnTables(
    np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, TURN_COLUMNS))
)


class Turning:
    """The commands of the rotary axis; its tool stands at ``rotary.home_deg`` at first.

    Parameters
    ----------
    parameters
        Of a robot that has one.

    Attributes
    ----------
    record, state
        Array of one record ``TURNING``, and its state, shapes (1,).
    turns
        Those of the plan that is driven, as the compiled code reads them.

    """

    def __init__(self, parameters: Parameters) -> None:
        self.record: NDArray[Any] = np.zeros(1, TURNING)
        self.record['constants'] = _constants(parameters)
        self.record['motor'] = motor(of_tool_axis(parameters))
        self.state: NDArray[Any] = self.record['state']
        self.turns = NO_TURNS
        self.state['passed_history'] = PASSED_NONE
        self.set_angle(parameters.rotary.home_rad)

    def precompile(self, task: NDArray[Any], timeline: Timeline) -> None:
        """Call the compiled code once, so that none is compiled in the middle of a bus cycle; nothing changes by it."""
        record = self.record.copy()
        command_turn(0, task, timeline.arrays, self.turns, record)
        answer_turn(0, 0.0, 0.0, task, record)

    def set_angle(self, angle_rad: float) -> None:
        """Take over where the tool stands: it has always stood there."""
        state = self.state
        state['angle'] = state['angle_history'] = angle_rad
        state['answered'] = state['due'] = state['actual'] = angle_rad

    def set_position(self, position_rad: float) -> None:
        """Take over where the tool stands by the position of its motor shaft."""
        self.set_angle(position_rad / float(self.record['constants']['gear_ratio'][0]))

    def off_rad(self, position_rad: float) -> float:
        """Return how far the tool is from its command, by its motor shaft; 0 within the position window."""
        constants = self.record['constants'][0]
        off = abs(position_rad - self.angle_rad * float(constants['gear_ratio']))
        return off / float(constants['gear_ratio']) if off > constants['position_window'] else 0.0

    @property
    def angle_rad(self) -> float:
        """Where the tool is commanded to be."""
        return float(self.state['angle'][0])

    @property
    def commanded(self) -> tuple[float, float]:
        """Motor shaft [rad] and torque [N m] of the last command."""
        state = self.state[0]
        return float(state['motor']), float(state['torque'])

    @property
    def feedback(self) -> list[float]:
        """Where the tool is commanded to be, where it is by its motor, and its error, of the last answer [rad]."""
        state = self.state[0]
        return [float(state['answered']), float(state['actual']), float(state['error'])]

    @property
    def within(self) -> int:
        """For how many bus cycles the motor has been within its position window."""
        return int(self.state['within'][0])

    def follow(self, plan: Plan) -> None:
        """Follow the turns of a plan from the next command on."""
        self.turns = NO_TURNS if plan.turns is None else plan.turns

    def begin(self) -> None:
        """Begin the figures of a program that is started."""
        self.state['move'] = 0
        for name in MEASURED:
            self.state[name] = 0

    def figures(self) -> TurnFigures:
        """Results so far."""
        s = self.state[0]
        cycles = int(s['measured_cycles'])
        return TurnFigures(
            cycles,
            float(s['error_max']),
            float(s['place_error_max']),
            float(s['current_peak']),
            math.sqrt(float(s['current_square_sum']) / max(cycles, 1)),
        )

    def command(self, cycle: int, task: NDArray[Any], timeline: Timeline) -> None:
        """Form the command of a bus cycle, behind that of the arms: see ``command_turn``."""
        command_turn(cycle, task, timeline.arrays, self.turns, self.record)

    def receive(self, cycle: int, position_rad: float, torque_n_m: float, task: NDArray[Any]) -> None:
        """Evaluate the answer of a bus cycle: see ``answer_turn``."""
        answer_turn(cycle, position_rad, torque_n_m, task, self.record)


def require_turns(turning: Turning | None, plan: Plan) -> None:
    """Refuse a plan that turns a tool that is not there, or from where it does not stand; raises ProgramError."""
    start = plan.start_turn_rad
    if start is None:
        return
    if turning is None:
        raise ProgramError(f'the plan cannot be loaded: {NO_AXIS}')
    if not abs(start - turning.angle_rad) <= JOINED_RAD:
        raise ProgramError(
            f'the plan begins with the tool at {math.degrees(start):.6g} deg, but it stands at '
            f'{math.degrees(turning.angle_rad):.6g} deg'
        )
