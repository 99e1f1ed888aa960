"""Continuous approximation of the velocity loop, and the gain margin that each of its simplifications costs.

    L(s) = (K_Pvel + K_Ivel/s) F(s) C/(1 + C) K_m/(J s + b) exp(-s T_vel/2) exp(-s T_vel/2)
    C(s) = (K_Pcurr + K_Icurr/s) 2/(R + s L) exp(-1.5 s T_cur),  F(s) = 1/(1 + s F_currRef)

The dead times model the difference of two encoder readings, the hold of the current set point, and computation and hold
in the current loop. ``steps`` replaces the simplifications one by one by the difference equations of the drive.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.studies.drives.loops.analysis import (
    LOOPS,
    OperatingPoint,
    exact_shaft,
    grid_hz,
    linear_loop,
)
from delta3_pacdrive.studies.drives.loops.loops import Shaft
from delta3_pacdrive.studies.drives.loops.response import Complex, margins


class Piece(StrEnum):
    """A simplification of the approximation, named by the property of the drive that it neglects."""

    REFERENCE_FILTER = 'low-pass of the current set point is sampled'
    HOLD = 'its hold is not counted twice'
    SINC = 'means over a period are smaller, not only later'
    INTEGRATORS = 'integrators are sampled'


REST = 'the rest'


@dataclass(frozen=True)
class Step:
    """Approximation after replacing one more simplification; the name is empty for the approximation itself."""

    name: str
    frequencies_hz: Floats  # shape (F,)
    loop: Complex  # open velocity loop, shape (F,)
    gain_margin_db: float
    gained_db: float  # change of the gain margin caused by this piece


def steps(parameters: Parameters, operation: OperatingPoint) -> list[Step]:
    """Return the velocity loop from the approximation to the exact difference equations, one piece at a time."""
    shaft = exact_shaft(parameters, operation.load, operation.speed_rad_s)
    frequencies = grid_hz(parameters.drive.velocity_period_s)
    pieces: list[Piece] = []
    found = [_step('', frequencies, velocity_loop(frequencies, parameters, shaft, pieces), None)]
    for piece in Piece:
        pieces.append(piece)
        loop = velocity_loop(frequencies, parameters, shaft, pieces)
        found.append(_step(piece.value, frequencies, loop, found[-1]))
    exact = linear_loop(LOOPS[1], parameters, operation)
    return [*found, _step(REST, exact.frequencies_hz, exact.open_loop, found[-1])]


def _step(name: str, frequencies: Floats, loop: Complex, before: Step | None) -> Step:
    margin = margins(frequencies, loop).gain_margin_db or math.inf
    return Step(name, frequencies, loop, margin, margin - before.gain_margin_db if before else 0.0)


def velocity_loop(
    frequencies_hz: Floats, parameters: Parameters, shaft: Shaft, pieces: list[Piece]
) -> Complex:
    """Return the open velocity loop of the approximation; ``pieces`` are modelled exactly as in the drive."""
    drive, motor = parameters.drive, parameters.motor
    slow, fast = drive.velocity_period_s, drive.current_period_s
    s = 2j * np.pi * frequencies_hz

    def mean(period_s: float) -> Floats:
        """Return the attenuation of a sine by averaging over a period."""
        return np.sinc(frequencies_hz * period_s) if Piece.SINC in pieces else np.ones(len(s))

    def integral(period_s: float) -> Complex:
        if Piece.INTEGRATORS in pieces:
            return np.asarray(period_s / (1.0 - np.exp(-s * period_s)), dtype=np.complex128)
        return np.asarray(1.0 / s, dtype=np.complex128)

    current = drive.current_gain_v_a + drive.current_integral_gain_v_a_s * integral(fast)
    current = current * 2.0 / (motor.winding_resistance_ohm + s * motor.winding_inductance_h)
    current = current * np.exp(-1.5 * fast * s) * mean(fast)
    # the current loop samples the held set point and holds its output: its half period is included above
    hold_s = slow - fast if Piece.HOLD in pieces else slow
    low_pass = 1.0 / (1.0 + s * drive.current_reference_filter_s)
    if Piece.REFERENCE_FILTER in pieces and drive.current_reference_filter_s > 0.0:
        kept = math.exp(-fast / drive.current_reference_filter_s)
        low_pass = (1.0 - kept) / (1.0 - kept * np.exp(-s * fast))
    controller = drive.velocity_gain_a_s_rad + drive.velocity_integral_gain_a_rad * integral(slow)
    plant = motor.torque_constant_n_m_a / (shaft.inertia_kg_m2 * s + shaft.friction_n_m_s_rad)
    late = np.exp(-0.5 * s * (slow + hold_s)) * mean(slow)
    if Piece.SINC in pieces:
        # mean over the instants at which the current loop samples the held value
        late = late * np.mean([np.cos(math.tau * frequencies_hz * at) for at in _around(slow, fast)], axis=0)
    return np.asarray(controller * low_pass * current / (1.0 + current) * plant * late)


def _around(slow_s: float, fast_s: float) -> Floats:
    """Instants of the fast loop [s] within a period of the slow loop, relative to its middle."""
    count = round(slow_s / fast_s)
    return np.asarray(fast_s * (np.arange(count) - 0.5 * (count - 1)))
