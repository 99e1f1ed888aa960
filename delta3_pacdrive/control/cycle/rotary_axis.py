"""A rotary axis in the controller: its command in each bus cycle, and the evaluation of its feedback.

The angle of the tool is a function of the distance on the path, so it stays synchronous with the TCP through override,
hold and resume. Without an angle in the plan the tool keeps its commanded angle.

Arguments of the kernels here:

``cycle``
    Number of a bus cycle.
``task``, ``timeline``
    As in ``task_cycle``: array of one record ``TASK``, shape (1,), and ``planning.execution.TimelineArrays``.
``turns``
    Rotations of the plan: a ``planning.paths.rotations.TurnTables``, empty if the plan contains none.
``rotary``
    Array of one record ``ROTARY``, shape (1,).
``position``, ``torque``
    Position [rad] and torque [N m] of the motor shaft in the AT of the axis.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.control.cycle.stages import Stage
from delta3_pacdrive.control.cycle.task_arrays import SETTLE_CYCLES
from delta3_pacdrive.control.cycle.task_cycle import is_over
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.parameters import ARMS, Parameters, rotary_axis_parameters
from delta3_pacdrive.planning.execution import Timeline, plan_time_at, profile_at
from delta3_pacdrive.planning.paths.rotations import JOINED_RAD, TURN_COLUMNS, TurnTables, turn_at
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.planning.rotating_move import require_rotary_axes
from delta3_pacdrive.robot.motor import MOTOR, friction_torque, motor
from delta3_pacdrive.robot.sercos.bus_time import HISTORY
from delta3_pacdrive.robot.sercos.increments import on_grid

STATE = np.dtype(
    [
        ('angle', 'f8'),  # of the tool, commanded [rad]
        ('angle_history', 'f8', (HISTORY,)),
        ('move', 'i8'),  # number of the active move; one more after the end of the program
        # cycles from the end of a move to this cycle, if within the last one; else PASSED_NONE
        ('passed_history', 'f8', (HISTORY,)),
        # of the last answer
        ('answered', 'f8'),  # commanded angle of its cycle [rad]
        ('due', 'f8'),  # commanded angle that the actual one corresponds to [rad]
        ('actual', 'f8'),  # angle of the tool by the motor encoder [rad]
        ('error', 'f8'),  # due - actual [rad]
        ('off', 'f8'),  # deviation of the motor from its command [rad]
        ('within', 'i8'),  # consecutive cycles within the position window
        # results of the program, as in STATE
        ('measured_cycles', 'i8'),
        ('error_max', 'f8'),
        ('place_error_max', 'f8'),
        ('current_peak', 'f8'),
        ('current_square_sum', 'f8'),
    ],
    align=True,
)

CONSTANTS = np.dtype(
    [
        ('index', 'i8'),  # of the axis, after the arms
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

ROTARY = np.dtype([('state', STATE), ('constants', CONSTANTS), ('motor', MOTOR)], align=True)


# reset at the start of a program
MEASURED = ('measured_cycles', 'error_max', 'place_error_max', 'current_peak', 'current_square_sum')
PASSED_NONE = -1.0


@dataclass(frozen=True)
class TurnFigures:
    """Results of a program at the rotary axis, from encoder and current in the AT of its drive."""

    measured_cycles: int
    error_max_rad: float  # set-point delay removed
    place_error_max_rad: float  # at the ends of moves
    current_peak_a: float
    current_rms_a: float

    def to_dict(self) -> dict[str, float]:
        """Return the results under their names in run results."""
        return {
            'turn_error_max_rad': self.error_max_rad,
            'turn_encoder_place_error_max_rad': self.place_error_max_rad,
            'turn_current_peak_a': self.current_peak_a,
            'turn_current_rms_a': self.current_rms_a,
        }


def combined_turns(figures: Sequence[TurnFigures]) -> TurnFigures:
    """Return the combined results of several programs at the same axis."""
    cycles = sum(one.measured_cycles for one in figures)
    square_sum = sum(one.measured_cycles * one.current_rms_a**2 for one in figures)
    return TurnFigures(
        cycles,
        max(one.error_max_rad for one in figures),
        max(one.place_error_max_rad for one in figures),
        max(one.current_peak_a for one in figures),
        math.sqrt(square_sum / max(cycles, 1)),
    )


def _constants(parameters: Parameters, number: int) -> NDArray[Any]:
    rotary, axis = parameters.rotary_axes[number], rotary_axis_parameters(parameters, number)
    record = np.zeros(1, CONSTANTS)
    record['index'] = ARMS + number
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
def command_turn(cycle, task, timeline, turns, rotary):
    """Set the command of the axis in the task for a bus cycle, after ``command_cycle`` for the same one."""
    s, t, c = task[0].state, rotary[0].state, rotary[0].constants
    turns_now = turns.rows.shape[0] > 0 and cycle >= s.start_cycle
    if turns_now:
        t.angle, _, _ = turn_at(s.master, s.move, turns)
    t.angle_history[cycle % HISTORY] = t.angle
    t.passed_history[cycle % HISTORY] = _passed(cycle, s, timeline, t, c)
    task[0].motors[c.index] = on_grid(t.angle * c.gear_ratio, c.increments_per_rad)
    task[0].torques[c.index] = 0.0
    if c.sends_torque != 0.0:
        speed, acceleration = 0.0, 0.0
        if turns.rows.shape[0] > 0 and (s.start_cycle - cycle) * c.cycle_time <= c.torque_lead:
            time = (cycle - timeline.profile[0].cycle) * c.cycle_time + c.torque_lead
            number, distance, v, a = profile_at(time, s.move, timeline)
            _, first, second = turn_at(distance, number, turns)
            speed, acceleration = first * v, second * v * v + first * a
        inertia = c.inertia + c.part_inertia * s.coming_payload
        torque = inertia * c.gear_ratio * acceleration
        torque += friction_torque(c.gear_ratio * speed, rotary[0].motor)
        task[0].torques[c.index] = min(max(torque, -c.torque_max), c.torque_max)


@kernel
def _passed(cycle, s, timeline, t, c):
    """Return the cycles since the end of a move, ``PASSED_NONE`` if none has ended since the last command.

    ``s`` is the state of the task, ``t`` and ``c`` are state and constants of the axis.
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
def error_at_places(cycle, error, before, rotary):
    """Return the error of the tool at the end of a move [rad], 0 if no move ends between the last two set points.

    Parameters
    ----------
    cycle, rotary
        As above.
    error, before
        Errors of the angle [rad], set-point delay removed, in the feedback of this cycle and of the one before.

    """
    passed, delay = rotary[0].state.passed_history, rotary[0].constants.set_point_delay
    whole = math.floor(delay)
    share, found = delay - whole, 0.0
    for back in range(2):
        ended = passed[max(cycle - int(whole) - back, 0) % HISTORY]
        since = ended + back - share
        if ended != PASSED_NONE and 0.0 <= since < 1.0:
            found = max(found, abs((1.0 - since) * error + since * before))
    return found


@kernel
def answer_turn(cycle, position, torque, task, rotary):
    """Evaluate the feedback of the axis in a bus cycle."""
    s, t, c = task[0].state, rotary[0].state, rotary[0].constants
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
        current = torque / rotary[0].motor.torque_constant
        t.measured_cycles += 1
        t.error_max = max(t.error_max, abs(t.error))
        t.place_error_max = max(t.place_error_max, error_at_places(cycle, t.error, before, rotary))
        t.current_peak = max(t.current_peak, abs(current))
        t.current_square_sum += current * current


NO_TURNS = TurnTables(
    np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, TURN_COLUMNS))
)


class RotaryAxis(Stage):
    """Commands of rotary axis ``number``, from 0, starting with the tool at its home angle."""

    def __init__(self, parameters: Parameters, number: int) -> None:
        self._number = number
        self.record: NDArray[Any] = np.zeros(1, ROTARY)
        self.record['constants'] = _constants(parameters, number)
        self.record['motor'] = motor(rotary_axis_parameters(parameters, number))
        self.state: NDArray[Any] = self.record['state']
        self.turns = NO_TURNS  # of the active plan
        self.state['passed_history'] = PASSED_NONE
        self.set_angle(parameters.rotary_axes[number].home_rad)

    def precompile(self, task: NDArray[Any], timeline: Timeline) -> None:
        """Call the compiled code once on a copy, so that it is not compiled during a bus cycle."""
        record = self.record.copy()
        command_turn(0, task, timeline.arrays, self.turns, record)
        answer_turn(0, 0.0, 0.0, task, record)

    def set_angle(self, angle_rad: float) -> None:
        """Initialize command and history as if the tool had always been at this angle."""
        state = self.state
        state['angle'] = state['angle_history'] = angle_rad
        state['answered'] = state['due'] = state['actual'] = angle_rad

    def set_position(self, position_rad: float) -> None:
        """Initialize command and history by the position of the motor shaft, unless it is within its window."""
        if self.off_rad(position_rad) > 0.0:
            self.set_angle(position_rad / float(self.record['constants']['gear_ratio'][0]))

    def off_rad(self, position_rad: float) -> float:
        """Return the deviation of the tool from its command; 0 within the position window of the motor."""
        constants = self.record['constants'][0]
        off = abs(position_rad - self.angle_rad * float(constants['gear_ratio']))
        return off / float(constants['gear_ratio']) if off > constants['position_window'] else 0.0

    @property
    def angle_rad(self) -> float:
        """Commanded angle of the tool."""
        return float(self.state['angle'][0])

    @property
    def feedback(self) -> list[float]:
        """Commanded angle, actual angle by the motor encoder, and error [rad] in the last feedback."""
        state = self.state[0]
        return [float(state['answered']), float(state['actual']), float(state['error'])]

    @property
    def within(self) -> int:
        """Number of consecutive bus cycles within the position window of the motor."""
        return int(self.state['within'][0])

    def load(self, plan: Plan) -> None:
        """Use the rotations of a plan from the next command on."""
        self.turns = plan.turns[self._number] if plan.turns else NO_TURNS

    def extend(self, timeline: Timeline, left_out: int) -> None:
        """Use the rotations of an extended plan."""
        self.load(timeline.plan)

    def start(self, timeline: Timeline) -> None:
        """Reset the results at the start of a program."""
        self.state['move'] = 0
        for name in MEASURED:
            self.state[name] = 0

    def figures(self) -> TurnFigures:
        """Return the results so far."""
        s = self.state[0]
        cycles = int(s['measured_cycles'])
        return TurnFigures(
            cycles,
            float(s['error_max']),
            float(s['place_error_max']),
            float(s['current_peak']),
            math.sqrt(float(s['current_square_sum']) / max(cycles, 1)),
        )

    def command(self, cycle: int, record: NDArray[Any], timeline: Timeline) -> None:
        """Compute the command of a bus cycle, after that of the arms; see ``command_turn``."""
        command_turn(cycle, record, timeline.arrays, self.turns, self.record)

    def receive(self, cycle: int, position_rad: float, torque_n_m: float, task: NDArray[Any]) -> None:
        """Evaluate the feedback of a bus cycle; see ``answer_turn``."""
        answer_turn(cycle, position_rad, torque_n_m, task, self.record)


def require_turns(rotary: Sequence[RotaryAxis], plan: Plan) -> None:
    """Raise ProgramError if a plan starts at another tool angle, or turns a tool that does not exist."""
    starts = plan.start_turns_rad
    require_rotary_axes(len(starts), len(rotary), 'the plan cannot be loaded: ')
    for start, axis in zip(starts, rotary, strict=False):
        if not abs(start - axis.angle_rad) <= JOINED_RAD:
            raise ProgramError(
                f'the plan begins with the tool at {math.degrees(start):.6g} deg, but it is at '
                f'{math.degrees(axis.angle_rad):.6g} deg'
            )
