"""Disturbance rejection of a drive: response to a load step and to encoder noise."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.studies.drives.loops.loops import OUTPUTS, Entry, Shaft, linear_cascade
from delta3_pacdrive.studies.framework.columns import HIDDEN

LOAD_N_M = 1.0  # load step, motor side
WINDOW_S = 1.0
BACK = 0.05  # share of the largest deviation that counts as recovered


@dataclass(frozen=True)
class Rejection:
    """Response of a linear drive to disturbances with one set of gains."""

    peak_rad: float  # largest deviation of the motor shaft after a load step of 1 N m at the arm, motor side
    peak_s: float
    back_s: float | None  # time after which the shaft stays within 5 % of peak_rad; None: more than a second
    noise_a: float  # current reference caused by noise and resolution of the encoder [A rms]
    time_s: Annotated[Floats, HIDDEN]  # since the step, shape (samples,)
    deviation_rad: Annotated[Floats, HIDDEN]  # shape (samples,)


def rejection(parameters: Parameters, shaft: Shaft) -> Rejection | None:
    """Return the disturbance response of a drive; None if its loops are unstable."""
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
        peak_rad=size,
        peak_s=float(time[peak]),
        back_s=float(time[last + 1]) if last + 1 < count else None,
        noise_a=encoder_noise_rad(parameters) * _gain_of_noise(parameters, shaft),
        time_s=time,
        deviation_rad=deviation,
    )


def encoder_noise_rad(parameters: Parameters) -> float:
    """Return the noise of an encoder reading [rad rms]: uniform noise and quantization."""
    increment = math.tau / parameters.bus.increments_per_rev
    return math.hypot(parameters.rich.encoder_noise_rad / math.sqrt(3.0), increment / math.sqrt(12.0))


def _gain_of_noise(parameters: Parameters, shaft: Shaft) -> float:
    steps = round(parameters.drive.velocity_period_s / parameters.drive.current_period_s)
    noisy = linear_cascade(parameters, shaft, Entry.ENCODER)
    return math.sqrt(noisy.variance('current_reference', steps))
