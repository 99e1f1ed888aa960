"""Sensor errors of a drive: measured current, and interpolation error of the encoder.

The random generators are part of the drive's record, so that results do not depend on the number of processes.
"""

import hashlib
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.sercos.increments import to_increments

_SHARES = 2.0**53


@kernel
def next_random(seed):
    """Advance a linear congruential generator of 64 bits."""
    return seed * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)


@kernel
def signed_share(seed):
    """Uniformly distributed number from -1 to 1 from the state of a generator."""
    return 2.0 * (np.float64(seed >> np.uint64(11)) / _SHARES) - 1.0


@kernel
def interpolation_error(position, c):
    """Error [rad] of an encoder's interpolation, periodic over its sine periods."""
    return c.encoder_error * math.sin(c.encoder_periods * position) if c.encoder_error != 0.0 else 0.0


@kernel
def measured_current(current, s, c, m):
    """Measured I_eff [A]; the offset of a phase rotates with the electrical angle."""
    measured = s.current_gain * current
    if s.current_offset != 0.0:
        measured += s.current_offset * math.cos(m.pole_pairs * s.position)
    if c.current_noise != 0.0:
        s.current_seed = next_random(s.current_seed)
        measured += c.current_noise * signed_share(s.current_seed)
    return measured


def _seed(axis: int, sensor: str, seed: int) -> int:
    digest = hashlib.sha256(f'{seed} {axis} {sensor}'.encode()).digest()
    return int.from_bytes(digest[:8], 'little')


def calibrate(axis: int, parameters: Parameters, state: NDArray[Any]) -> None:
    """Set the sensors of an axis, 0 to 2, in the record of a drive: ideal ones, or those of ``parameters.rich``.

    The machine's zero point is that of the calibrated arm angles. The drive knows it: positions on the bus refer to it.
    """
    effects = parameters.rich.effects
    distance = parameters.dynamics.gear_ratio * parameters.kinematics.corrections.angle_rad[axis]
    state['absolute_distance'] = to_increments(distance, parameters.bus.increments_per_rev / math.tau)
    state['current_gain'] = 1.0
    if effects.sensors:
        state['current_gain'] += effects.current_gain_error[axis]
        state['current_offset'] = effects.current_offset_a[axis]
        state['current_seed'] = _seed(axis, 'current', effects.sensor_seed)
        state['encoder_seed'] = _seed(axis, 'encoder', effects.sensor_seed)
