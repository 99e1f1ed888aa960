"""The transformation task: one bus cycle of plan -> TCP -> arm angles -> motor commands, and what comes back.

In each cycle the plan gives the TCP, inverse kinematics the arm angles, the gear the motor shafts (thesis 6, 7). What
the drives answer serves only the following error and supervision, never the next command: cycles may be outstanding.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from delta3_pacdrive import kinematics
from delta3_pacdrive.bus.increments import on_grid
from delta3_pacdrive.bus.words import CONTROL_ENABLE, CONTROL_ON
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.kernel import kernel
from delta3_pacdrive.kinematics import Floats, arm_angles, geometry, plate_position
from delta3_pacdrive.motion.plan import MOVE, Plan, plan_at
from delta3_pacdrive.parameters import Parameters

HISTORY = 64  # cycles of commands kept for the answers that are still on their way
SETTLE_CYCLES = 100  # after the end of a program, before the final position is taken
NEVER = 2**62

STATE = np.dtype(
    [
        ('start_cycle', 'i8'),
        ('end_cycle', 'i8'),
        ('move', 'i8'),
        ('master', 'f8'),  # [m]
        ('master_speed', 'f8'),  # [m/s]
        ('tcp', 'f8', (3,)),  # commanded [m]
        ('tcp_history', 'f8', (HISTORY, 3)),
        ('theta_history', 'f8', (HISTORY, 3)),
        # actual arm angles of the two cycles before
        ('theta_before', 'f8', (3,)),
        ('theta_before_that', 'f8', (3,)),
        # figures of the run, from the start of the program to SETTLE_CYCLES after its end
        ('measured_cycles', 'i8'),
        ('error_max', 'f8'),
        ('error_square_sum', 'f8'),
        ('following_error_max', 'f8'),
        ('current_peak', 'f8', (3,)),
        ('current_square_sum', 'f8', (3,)),
        ('final_tcp', 'f8', (3,)),
    ],
    align=True,
)

CONSTANTS = np.dtype(
    [
        ('gear_ratio', 'f8'),
        ('increments_per_rad', 'f8'),
        ('cycle_time', 'f8'),
        ('extrapolation', 'f8'),  # [cycles], of the actual value (7.3)
        ('set_point_delay', 'f8'),  # [cycles], of the actual TCP behind the command
        ('torque_constant', 'f8'),
    ],
    align=True,
)

# columns of the answer of one cycle
THETA, TCP_ACTUAL, TCP_COMMAND, FOLLOWING_ERROR, TCP_ERROR = (slice(3 * n, 3 * n + 3) for n in range(5))
ANSWER_COLUMNS = 15


@kernel
def _command(cycle, moves, phases, segments, motors, state, constants, geometry_record):
    """Fill the motor commands [rad] of a cycle; nan where the TCP is out of reach."""
    s, c = state[0], constants[0]
    if cycle >= s.start_cycle:
        time = (cycle - s.start_cycle) * c.cycle_time
        p, s.master, s.master_speed, s.move = plan_at(time, s.move, moves, phases, segments)
        for axis in range(3):
            s.tcp[axis] = p[axis]
    theta = arm_angles((s.tcp[0], s.tcp[1], s.tcp[2]), geometry_record[0])
    row = cycle % HISTORY
    for i in range(3):
        s.tcp_history[row, i] = s.tcp[i]
        s.theta_history[row, i] = theta[i]
        motors[i] = on_grid(theta[i] * c.gear_ratio, c.increments_per_rad)


@kernel
def _answer(cycle, positions, torques, out, state, constants, geometry_record):
    """Forward kinematics and errors of a cycle from the drives' answers."""
    s, c = state[0], constants[0]
    theta = (positions[0] / c.gear_ratio, positions[1] / c.gear_ratio, positions[2] / c.gear_ratio)
    p = plate_position(theta, geometry_record[0])
    row = cycle % HISTORY
    # the command that the actual position answers to, on the chord between two commands
    whole = math.floor(c.set_point_delay)
    share = c.set_point_delay - whole
    newer = max(cycle - int(whole), 0) % HISTORY
    older = max(cycle - int(whole) - 1, 0) % HISTORY
    error_square = 0.0
    for i in range(3):
        out[i] = theta[i]
        out[3 + i] = p[i]
        out[6 + i] = s.tcp_history[row, i]
        before = s.theta_before[i]
        extrapolated = before + c.extrapolation * (before - s.theta_before_that[i])
        out[9 + i] = s.theta_history[row, i] - extrapolated
        due = (1.0 - share) * s.tcp_history[newer, i] + share * s.tcp_history[older, i]
        out[12 + i] = due - p[i]
        error_square += out[12 + i] * out[12 + i]
        s.theta_before_that[i] = before
        s.theta_before[i] = theta[i]
    if s.start_cycle <= cycle < s.end_cycle + SETTLE_CYCLES:
        s.measured_cycles += 1
        s.error_square_sum += error_square
        s.error_max = max(s.error_max, math.sqrt(error_square))
        for i in range(3):
            current = torques[i] / c.torque_constant
            s.current_peak[i] = max(s.current_peak[i], abs(current))
            s.current_square_sum[i] += current * current
            s.following_error_max = max(s.following_error_max, abs(out[9 + i]))
            s.final_tcp[i] = p[i]


@dataclass(frozen=True)
class Figures:
    """Results of a program: TCP errors with the set-point delay removed, currents from the drives' answers."""

    measured_cycles: int
    tcp_error_max_m: float
    tcp_error_rms_m: float
    following_error_max_rad: float
    final_tcp_m: list[float]
    current_peak_a: list[float]
    current_rms_a: list[float]


class Transformation:
    """Cyclic calculations of the controller; knows bus cycles, no clock and no messages."""

    def __init__(self, parameters: Parameters) -> None:
        bus = parameters.bus
        self._parameters = parameters
        self._geometry = geometry(parameters.kinematics)
        self._constants = np.zeros(1, CONSTANTS)
        self._constants['gear_ratio'] = parameters.dynamics.gear_ratio
        self._constants['increments_per_rad'] = bus.increments_per_rev / math.tau
        self._constants['cycle_time'] = bus.cycle_time_s
        self._constants['extrapolation'] = parameters.following_error_delay_cycles
        self._constants['set_point_delay'] = parameters.set_point_delay_cycles
        self._constants['torque_constant'] = parameters.motor.torque_constant_n_m_a
        self.state: NDArray[Any] = np.zeros(1, STATE)
        self.state['start_cycle'] = self.state['end_cycle'] = NEVER
        self._plan: Plan | None = None
        self._tables: tuple[Any, Floats, Floats] | None = None
        self.enable_cycle = NEVER
        self.motors: Floats = np.zeros(3)
        self.answer: Floats = np.zeros(ANSWER_COLUMNS)

    def locate(self, motor_positions_rad: ArrayLike) -> Floats:
        """Take over where the motors stand, by forward kinematics in the first cycle (6); return the TCP [m]."""
        theta = np.asarray(motor_positions_rad, dtype=np.float64) / self._parameters.dynamics.gear_ratio
        tcp = kinematics.forward(theta, self._parameters.kinematics)
        state = self.state[0]
        state['tcp'] = tcp
        state['tcp_history'], state['theta_history'] = tcp, theta
        state['theta_before'] = state['theta_before_that'] = theta
        return tcp

    def load(self, plan: Plan) -> None:
        """Take over a program; it waits for ``start``."""
        self._plan = plan
        self._tables = (plan.moves, plan.phases, plan.segments)
        state = self.state[0]
        state['start_cycle'] = state['end_cycle'] = NEVER
        state['move'] = 0

    def start(self, cycle: int) -> int:
        """Start the loaded program at a cycle; return the first cycle in which the TCP stands at its end."""
        if self._plan is None:
            raise RunError('no program is loaded')
        end = cycle + math.ceil(self._plan.duration_s / self._parameters.bus.cycle_time_s - 1e-9)
        state = self.state[0]
        state['start_cycle'], state['end_cycle'], state['move'] = cycle, end, 0
        for name in ('measured_cycles', 'error_max', 'error_square_sum', 'following_error_max'):
            state[name] = 0
        for name in ('current_peak', 'current_square_sum'):
            state[name] = 0.0
        return end

    @property
    def loaded(self) -> bool:
        """Whether a program was loaded."""
        return self._plan is not None

    @property
    def moves(self) -> int:
        """Number of moves of the loaded program."""
        return 0 if self._plan is None else len(self._plan.moves)

    @property
    def end_cycle(self) -> int:
        """First cycle in which the TCP stands at the end of the program."""
        return int(self.state['end_cycle'][0])

    @property
    def last_cycle(self) -> int:
        """Last cycle whose answer counts for the figures of the program."""
        return self.end_cycle + SETTLE_CYCLES - 1

    def control(self, cycle: int) -> int:
        """Control word S-0-0134 of a cycle, the same for all drives."""
        return CONTROL_ENABLE if cycle >= self.enable_cycle else CONTROL_ON

    def command(self, cycle: int) -> Floats:
        """Motor shaft commands [rad] of a cycle, on the increment grid; cycles are asked for in order."""
        if cycle < self.state['start_cycle'][0] or self._tables is None:
            moves, phases, segments = _NO_TABLES
        else:
            moves, phases, segments = self._tables
        _command(cycle, moves, phases, segments, self.motors, self.state, self._constants, self._geometry)
        return self.motors

    def receive(self, cycle: int, positions_rad: Floats, torques_n_m: Floats) -> Floats:
        """Evaluate the answers of a cycle, in order; columns ``THETA`` ... ``TCP_ERROR`` of the result."""
        _answer(cycle, positions_rad, torques_n_m, self.answer, self.state, self._constants, self._geometry)
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
            s['current_peak'].tolist(),
            np.sqrt(s['current_square_sum'] / cycles).tolist(),
        )


def _no_tables() -> tuple[Any, Floats, Floats]:
    """Tables of an empty plan, of the types that the compiled code knows."""
    return np.zeros(1, MOVE), np.zeros((1, 5)), np.zeros((1, 13))


_NO_TABLES = _no_tables()
