"""Margins of many sets of gains, from plant frequency responses that are computed only once.

The plant from the current reference to the measured speed and position does not depend on the outer loops. Their
controllers are closed-form, so that a set of gains costs three products of arrays:

    velocity  L_v = N C_v V,  C_v = K_Pvel + K_Ivel T_vel / (1 - z^-1)
    position  L_p = K_Ppos H P C_v N / (1 + L_v),  H: hold of the position loop
    cascade   L_c = N C_v (V + K_Ppos H P),  cut at the current set point

Aliases of the slower sampling rates are neglected, which costs less than 0.1 dB; ``analysis`` includes them.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.parameters.notch import Notch, notches
from delta3_pacdrive.robot.drive.notch import coefficients
from delta3_pacdrive.studies.drives.loops.analysis import NYQUIST_SHARE
from delta3_pacdrive.studies.drives.loops.loops import Entry, Shaft, linear_cascade
from delta3_pacdrive.studies.drives.loops.response import Complex

LOWEST_HZ, POINTS = 1.0, 260
AT_ONCE = 8  # candidates per batch: their arrays fit the cache of a core
NEVER_DB, NEVER_DEG = 60.0, 180.0  # margins of a loop without the crossing


# returns the responses from the current reference to the speed and to the position, shape (loads, F), over F
# frequencies [Hz]
PlantResponse = Callable[[Floats], tuple[Complex, Complex]]


@dataclass(frozen=True)
class Gains:
    """Candidate gains of velocity and position loop."""

    velocity_a_s_rad: float  # K_Pvel
    integral_a_rad: float  # K_Ivel
    position_1_s: float  # K_Ppos
    notch: Notch | None = None  # first filter; None: as in the parameters

    @property
    def stiffness(self) -> float:
        """K_Ivel K_Ppos [A/(rad s)]; inversely proportional to the time integral of the deflection under load."""
        return self.integral_a_rad * self.position_1_s

    def values(self) -> dict[str, float]:
        """Return the values by name of the group ``drive``."""
        values = {
            'velocity_gain_a_s_rad': self.velocity_a_s_rad,
            'velocity_integral_gain_a_rad': self.integral_a_rad,
            'position_gain_rad_s_rad': self.position_1_s,
        }
        if self.notch is not None:
            values |= {f'notch_1_{name}': value for name, value in self.notch._asdict().items()}
        return values

    def of(self, parameters: Parameters) -> Parameters:
        """Return parameters with these gains; raises ParameterError."""
        return parameters.replace(**{f'drive__{name}': value for name, value in self.values().items()})


@dataclass(frozen=True)
class Least:
    """Least margins of each candidate over loops and loads, shapes (candidates,)."""

    gain_db: Floats
    phase_deg: Floats
    stable: NDArray[np.bool_]


class Candidates:
    """Evaluator of candidate gains for a robot with several loads, given as shafts or by measured responses."""

    def __init__(self, parameters: Parameters, plant: Sequence[Shaft] | PlantResponse) -> None:
        drive = parameters.drive
        self._period = drive.velocity_period_s
        steps = round(self._period / drive.current_period_s)
        self.frequencies_hz: Floats = np.geomspace(LOWEST_HZ, NYQUIST_SHARE / (2.0 * self._period), POINTS)
        if callable(plant):
            speed, position = plant(self.frequencies_hz)
        else:
            speed, position = _of_shafts(parameters, plant, self.frequencies_hz, steps)
        back = np.exp(-2j * np.pi * self.frequencies_hz * self._period)
        held = round(drive.position_period_s / self._period)
        self._integrator = self._period / (1.0 - back)
        self._speed = speed
        # the position loop reads once per period and holds its output
        self._position = position * sum(back**n for n in range(held)) / held
        # both loops use the reading of the same instant
        self._back = back
        self._filters = [self._response(*coefficients(one, self._period)) for one in notches(drive)]

    def _response(self, b0: float, b1: float, b2: float, a1: float, a2: float) -> Complex:
        back = self._back
        return np.asarray((b0 + b1 * back + b2 * back**2) / (1.0 + a1 * back + a2 * back**2))

    def least(self, gains: Sequence[Gains]) -> Least:
        """Return the least margins of each candidate."""
        found = [self._least(gains[k : k + AT_ONCE]) for k in range(0, len(gains), AT_ONCE)]
        return Least(
            *(np.concatenate([getattr(one, name) for one in found]) for name in Least.__annotations__)
        )

    def _least(self, gains: Sequence[Gains]) -> Least:
        velocity, integral, position = (
            np.array([getattr(g, name) for g in gains])[:, None, None]
            for name in ('velocity_a_s_rad', 'integral_a_rad', 'position_1_s')
        )
        firsts = [
            self._filters[0] if g.notch is None else self._response(*coefficients(g.notch, self._period))
            for g in gains
        ]
        controller = (velocity + integral * self._integrator) * (np.array(firsts) * self._filters[1])[
            :, None, :
        ]
        inner = controller * self._speed
        outer = controller * position * self._position
        gain, phase = np.full(len(gains), NEVER_DB), np.full(len(gains), NEVER_DEG)
        stable = np.ones(len(gains), dtype=bool)
        for loop in (inner, outer / (1.0 + inner), inner + outer):
            for k, (db, degrees, good) in enumerate(_worst_of(loop)):
                gain[k], phase[k] = min(gain[k], db), min(phase[k], degrees)
                stable[k] &= good
        return Least(gain, phase, stable)


def _of_shafts(
    parameters: Parameters, shafts: Sequence[Shaft], frequencies_hz: Floats, steps: int
) -> tuple[Complex, Complex]:
    speed, position = [], []
    for shaft in shafts:
        plant = linear_cascade(parameters, shaft, Entry.CURRENT_SET_POINT)
        speed.append(plant.respond(frequencies_hz, 'speed_filtered', steps))
        position.append(plant.respond(frequencies_hz, 'read', steps))
    return np.array(speed), np.array(position)


def _worst_of(loops: Complex) -> Iterator[tuple[float, float, bool]]:
    """Yield the least gain margin [dB] and phase margin [deg] over the loads of each candidate, and their stability.

    The gain margin is the smaller one of increase and reduction.
    """
    size = np.log(np.abs(loops))
    real, imaginary = loops.real, loops.imag
    # crossings of the negative real axis
    share = _crossing(imaginary)
    at_real = real[..., :-1] + share * np.diff(real)
    with np.errstate(invalid='ignore', divide='ignore'):
        decibels = np.where(at_real < 0.0, np.abs(20.0 * np.log10(np.abs(at_real))), NEVER_DB)
    gain = np.where(np.isfinite(decibels), decibels, NEVER_DB).min(axis=(1, 2))
    # crossings of the unit circle
    share = _crossing(size)
    crossing = loops[..., :-1] + share * np.diff(loops)
    over = np.abs(np.degrees(np.angle(-crossing)))
    phase = np.where(np.isfinite(over), over, NEVER_DEG).min(axis=(1, 2))
    # stable: arg(1 + L) goes from the phase of L, between -360 and 0 degrees, to 0 without encircling -1
    turned = np.unwrap(np.angle(1.0 + loops), axis=-1)
    start = np.where(turned[..., 0] > 0.0, turned[..., 0] - math.tau, turned[..., 0])
    end = start + turned[..., -1] - turned[..., 0]
    stable = np.asarray((np.abs(end) < math.pi).all(axis=1))
    yield from zip(gain.tolist(), phase.tolist(), stable.tolist(), strict=True)


def _crossing(values: Floats) -> Floats:
    """Return the fraction of a sampling interval at which a signal crosses 0; nan without a crossing."""
    one, other = values[..., :-1], values[..., 1:]
    with np.errstate(invalid='ignore', divide='ignore'):
        return np.asarray(np.where((one < 0.0) != (other < 0.0), one / (one - other), np.nan))
