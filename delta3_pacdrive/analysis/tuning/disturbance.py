"""What a drive does about what it cannot know: a step of the load, and noise of its encoder."""

import math
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.analysis.tuning.loops import OUTPUTS, Entry, Shaft, linear_cascade
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

LOAD_N_M = 1.0  # of the step, motor side
WINDOW_S = 1.0
BACK = 0.05  # of the largest deviation, within which the shaft is back


@dataclass(frozen=True)
class Rejection:
    """How a drive bears disturbances with one set of gains, by its difference equations.

    Attributes
    ----------
    peak_rad
        Largest deviation of the motor shaft after a load step of 1 N m at the arm, motor side.
    peak_s, back_s
        When it is there, and from when on the shaft stays within 5 % of it; None: not within a second.
    noise_a
        Current reference that noise and steps of the encoder make [A rms].
    time_s, deviation_rad
        After the step, shape (samples,).

    """

    peak_rad: float
    peak_s: float
    back_s: float | None
    noise_a: float
    time_s: Floats
    deviation_rad: Floats

    def figures(self) -> dict[str, float | None]:
        """All but the signals, by name."""
        return {name: value for name, value in vars(self).items() if not isinstance(value, np.ndarray)}


def rejection(parameters: Parameters, shaft: Shaft) -> Rejection | None:
    """Return how a drive bears disturbances; None where its loops are not stable."""
    loaded = linear_cascade(parameters, shaft, Entry.LOAD)
    if not loaded.is_stable():
        return None
    period = parameters.drive.current_period_s
    count = round(WINDOW_S / period)
    deviation = loaded.run(np.full(count, LOAD_N_M))[:, OUTPUTS.index('position')]
    time: Floats = np.arange(count, dtype=np.float64) * period
    peak = int(np.argmax(np.abs(deviation)))
    size = float(abs(deviation[peak]))
    outside = np.flatnonzero(np.abs(deviation) > BACK * size)
    last = int(outside[-1])
    return Rejection(
        size,
        float(time[peak]),
        float(time[last + 1]) if last + 1 < count else None,
        encoder_noise_rad(parameters) * _gain_of_noise(parameters, shaft),
        time,
        deviation,
    )


def encoder_noise_rad(parameters: Parameters) -> float:
    """Noise of a reading [rad rms]: uniform within its amplitude, and within an increment."""
    increment = math.tau / parameters.bus.increments_per_rev
    return math.hypot(parameters.rich.encoder_noise_rad / math.sqrt(3.0), increment / math.sqrt(12.0))


def _gain_of_noise(parameters: Parameters, shaft: Shaft) -> float:
    steps = round(parameters.drive.velocity_period_s / parameters.drive.current_period_s)
    noisy = linear_cascade(parameters, shaft, Entry.ENCODER)
    return math.sqrt(noisy.variance('current_reference', steps))
