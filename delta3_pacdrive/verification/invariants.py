"""Conditions that hold in every cycle of a robot, and those that hold without a disturbance."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from delta3_pacdrive import kinematics
from delta3_pacdrive import parameters as core
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.robot.drive.arrays import IMPLAUSIBLE_SPEED, SHORT_CIRCUIT
from delta3_pacdrive.verification.fault_catalogue.signatures import TORQUE
from delta3_pacdrive.verification.telegram_log import AT, CODECS, MDT, SHAFTS, Telegrams

STOP_DEPTH_DEG = 3.0  # penetration of an end stop
COMMAND_M = 1e-3  # tolerance of the workspace for commands
ROUNDING = 1e-4  # share of a limit
ARM_DEG = 0.5  # tolerance of the control limits of an arm
# of an undisturbed program; random programs have 0.41 mm and 0.5 um
TCP_ERROR_M = 1.5e-3
END_M = 0.01e-3
# growth limit of the unshared memory of a robot's processes in 100,000 cycles; the planner grows most
MEMORY_MB = 5.0
MEMORY_CYCLES = 100_000  # minimum number of cycles after warming up
BLOCKS = 8  # of samples: memory grows in steps, so single samples are not independent
CONFIDENCE = 0.99


@dataclass(frozen=True)
class Growth:
    """Memory growth in 100,000 cycles [MB], with half of its confidence interval and the number of measured cycles."""

    slope_mb: float = 0.0
    half_width_mb: float = math.inf
    cycles: int = 0


def growth_of(cycles: Sequence[int], memory_mb: Sequence[float]) -> Growth:
    """Estimate memory growth by a line through the means of blocks of samples."""
    if len(cycles) < 2 * BLOCKS or cycles[-1] == cycles[0]:
        return Growth()
    blocks = np.array_split(np.arange(len(cycles)), BLOCKS)
    x = np.array([np.mean(np.take(cycles, block)) for block in blocks]) / 1e5
    y = np.array([np.mean(np.take(memory_mb, block)) for block in blocks])
    offset = x - x.mean()
    square = float(offset @ offset)
    slope = float(offset @ y) / square
    residuals = y - y.mean() - slope * offset
    deviation = math.sqrt(float(residuals @ residuals) / (BLOCKS - 2) / square)
    quantile = float(special.stdtrit(BLOCKS - 2, 0.5 + 0.5 * CONFIDENCE))
    return Growth(slope, quantile * deviation, cycles[-1] - cycles[0])


class Invariants:
    """Checks telegrams against the limits of a robot; ``violate`` is called with a message and a bus cycle."""

    def __init__(self, robot: core.Parameters, violate: Callable[[str, int], None]) -> None:
        motor, drive, dynamics = robot.motor, robot.drive, robot.dynamics
        self._robot, self._violate = robot, violate
        self.session = b''  # of the newest MDT
        self.unseen = dict.fromkeys(CODECS, 0)  # published but not received telegrams, by topic
        self._ratio = dynamics.gear_ratio
        self._torque_nominal = motor.peak_current_a * motor.torque_constant_n_m_a
        self._torque_max = SHORT_CIRCUIT * self._torque_nominal
        self._speed_nominal = motor.max_speed_rad_s
        self._speed_max = motor.max_speed_rad_s * drive.overspeed_factor * IMPLAUSIBLE_SPEED
        self._stops = dynamics.end_stop_min_deg - STOP_DEPTH_DEG, dynamics.end_stop_max_deg + STOP_DEPTH_DEG
        self._range = (
            robot.kinematics.arm_angle_min_deg - ARM_DEG,
            robot.kinematics.arm_angle_max_deg + ARM_DEG,
        )
        self._last: dict[str, tuple[int, int, bytes] | None] = dict.fromkeys(CODECS)

    def check_all(self, telegrams: Mapping[str, Telegrams]) -> None:
        """Check telegrams by topic."""
        for topic, own in telegrams.items():
            self.check(topic, own)
        if MDT in telegrams:
            self.session = telegrams[MDT].sessions[-1]

    def check(self, topic: str, telegrams: Telegrams) -> None:
        """Check order and physical limits of the telegrams of a topic, in the order of reception."""
        self._check_order(topic, telegrams)
        if topic == SHAFTS:
            self._check_shafts(telegrams, self._stops, self._speed_max)
        elif topic == MDT:
            self._check_commands(telegrams)
        else:
            self._check_torque(topic, telegrams, self._torque_max)

    def _check_order(self, topic: str, telegrams: Telegrams) -> None:
        """Check that bus time advances by one cycle per telegram, or by more across a phase start-up."""
        last = self._last[topic]
        received = zip(telegrams.cycles.tolist(), telegrams.numbers.tolist(), telegrams.sessions, strict=True)
        for cycle, number, session in received:
            if last is not None:
                before, number_before, session_before = last
                same, steps = session_before == session, max(number - number_before, 1)
                if cycle <= before or (same and cycle != before + steps):
                    self._violate(f'{topic}: bus cycle {cycle} after {before}', cycle)
                self.unseen[topic] += steps - 1 if same else 0
            last = cycle, number, session
        self._last[topic] = last

    def _check_shafts(self, shafts: Telegrams, range_deg: tuple[float, float], speed_max: float) -> None:
        arms = np.degrees(shafts.values[:, :3] / self._ratio)
        low, high = range_deg
        self._outside('an arm is at', 'deg', telegrams=shafts, values=arms, low=low, high=high)
        limit = speed_max * (1.0 + ROUNDING)
        self._outside(
            'a shaft turns at',
            'rad/s',
            telegrams=shafts,
            values=shafts.values[:, 3:6],
            low=-limit,
            high=limit,
        )

    def _check_torque(self, topic: str, answers: Telegrams, torque_max: float) -> None:
        limit = torque_max * (1.0 + ROUNDING)
        self._outside(
            f'{topic}: torque',
            'N m',
            telegrams=answers,
            values=answers.values[:, [TORQUE]],
            low=-limit,
            high=limit,
        )

    def _check_commands(self, commands: Telegrams) -> None:
        limits = self._robot.kinematics
        tcp = kinematics.forward(commands.values / self._ratio, limits)
        radius = np.hypot(tcp[:, [0]], tcp[:, [1]])
        edge = 0.5 * limits.workspace_diameter_m + COMMAND_M
        self._outside(
            'the TCP is commanded to a radius of', 'm', telegrams=commands, values=radius, low=0.0, high=edge
        )
        low, high = limits.workspace_bottom_m - COMMAND_M, limits.workspace_top_m + COMMAND_M
        self._outside(
            'the TCP is commanded to z', 'm', telegrams=commands, values=tcp[:, [2]], low=low, high=high
        )

    def _outside(
        self, what: str, unit: str, telegrams: Telegrams, values: Floats, low: float, high: float
    ) -> None:
        """Report the largest excess of values (n, k) over their limits; nan exceeds them."""
        excess = np.nan_to_num(np.maximum(low - values, values - high), nan=np.inf)
        row, column = np.unravel_index(int(excess.argmax()), excess.shape)
        if excess[row, column] > 0.0:
            text = f'{what} {values[row, column]:.4f} {unit}, the limits are {low:.4f} and {high:.4f}'
            self._violate(text, int(telegrams.cycles[row]))

    def check_undisturbed(
        self, recorded: dict[str, Telegrams], end_m: Sequence[float]
    ) -> tuple[float, float]:
        """Check an undisturbed program against nominal limits, its commands and its end point.

        Returns
        -------
        tuple
            Maximum distance [m] of the true TCP from its command, and distance of its end from the intended point.

        """
        shafts, commands = recorded[SHAFTS], recorded[MDT]
        self._check_shafts(shafts, self._range, self._speed_nominal)
        for topic in AT:
            self._check_torque(topic, recorded[topic], self._torque_nominal)
        tcp = kinematics.forward(shafts.values[:, :3] / self._ratio, self._robot.kinematics)
        due = shafts.cycles - self._robot.set_point_delay_cycles
        known = (due >= commands.cycles[0]) & (due <= commands.cycles[-1])
        wanted = np.column_stack([np.interp(due, commands.cycles, row) for row in commands.values.T])
        errors = np.linalg.norm(
            tcp - kinematics.forward(wanted / self._ratio, self._robot.kinematics), axis=1
        )
        errors[~known] = 0.0
        worst = int(errors.argmax())
        if errors[worst] > TCP_ERROR_M:
            self._violate(
                f'the true TCP is {errors[worst] * 1e3:.3f} mm from its command', int(shafts.cycles[worst])
            )
        off = float(np.linalg.norm(tcp[-1] - np.array(end_m)))
        if off > END_M:
            self._violate(f'the program ends {off * 1e3:.4f} mm off', int(shafts.cycles[-1]))
        return float(errors[worst]), off

    def check_losses(self, what: str, lost: int, injected: int, complete: bool, cycle: int) -> None:
        """Compare lost telegrams with injected losses; ``complete``: all of these were due."""
        if lost > injected or (complete and lost < injected):
            self._violate(f'{what}: {lost} lost, {injected} were injected', cycle)

    def check_memory(self, growth: Growth, now: int) -> None:
        """Check the growth of unshared memory: the whole interval has to exceed the limit."""
        if growth.cycles >= MEMORY_CYCLES and growth.slope_mb - growth.half_width_mb > MEMORY_MB:
            self._violate(
                f'memory grows by {growth.slope_mb:.2f} +- {growth.half_width_mb:.2f} MB in 100,000 cycles '
                f'({growth.cycles} cycles after warming up), the limit is {MEMORY_MB:.2f} MB',
                now,
            )
