"""Limits that may keep a move from being faster, with what it asks of each, sample by sample."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.analysis.planning.study import Quantity
from delta3_pacdrive.motion.excess import compared
from delta3_pacdrive.motion.path_dynamics import PathDynamics
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

RMS_USED_UP = 0.99  # of the nominal current


@dataclass(frozen=True)
class Limiter:
    """One limit and what a move asks of it: factor of time that would keep it, value, and the limit itself."""

    quantity: Quantity
    axis: int | None
    stretch: Floats
    value: Floats
    limit: Floats
    unit: str

    @cached_property
    def used(self) -> Floats:
        """Share of the limit that is used, 1 = all of it."""
        return np.asarray(self.value / self.limit)


def of_motion(
    dynamics: PathDynamics,
    master: Floats,
    samples: Floats,
    limits: tuple[Floats, Floats, Floats] | None,
    parameters: Parameters,
) -> tuple[Limiter, ...]:
    """Return the limits of TCP and motors, with what a motion asks of them."""
    found, shape = [], dynamics.time_s.shape
    bends = _bends(master, samples)
    for demand in compared(dynamics, parameters, limits):
        limit = np.broadcast_to(np.asarray(demand.limit, dtype=np.float64), shape)
        quantity = Quantity[demand.quantity.name]
        bend = bends.get(quantity, np.zeros(shape, dtype=np.bool_))
        for kind, here in ((quantity, ~bend), (Quantity.CURVATURE, bend)):
            if here.any():
                stretch, value = demand.stretch * here, demand.value * here
                found.append(Limiter(kind, demand.axis, stretch, value, limit, demand.unit))
    return tuple(found)


def of_torque_rate(
    times: Floats, steps: int, torque_n_m: Floats, payload: NDArray[np.int64], limit: float
) -> tuple[Limiter, ...]:
    """Return how fast each motor's torque without friction, (n, 3), changes beside its limit [N m/s].

    It jumps where another ``payload``, (n,), is gripped or let go: that is none of the motion, and does not count.
    """
    even = np.linspace(0.0, times[-1], steps + 1)
    at = np.searchsorted(times, even)  # not between both sides of an end of a phase
    rate = np.zeros((len(even), torque_n_m.shape[1]))
    for piece in np.split(np.arange(len(even)), np.flatnonzero(np.diff(payload[at])) + 1):
        if len(piece) > 1:
            rate[piece] = np.abs(np.gradient(torque_n_m[at[piece]], even[piece], axis=0))
    found = []
    for axis, values in enumerate(rate.T):
        value, limits = np.interp(times, even, values), np.full(times.shape, limit)
        found.append(Limiter(Quantity.TORQUE_RATE, axis + 1, np.cbrt(value / limit), value, limits, 'N m/s'))
    return tuple(found)


def of_rms_current(
    times: Floats, rms_current_a: tuple[float, float, float], nominal_a: float
) -> Limiter | None:
    """Return the rms current of the program if it uses up the nominal one, so that no move may be faster; else None."""
    axis = int(np.argmax(rms_current_a))
    used = rms_current_a[axis] / nominal_a
    if used < RMS_USED_UP:
        return None
    stretch, value, limit = (
        np.full(times.shape, one) for one in (math.sqrt(used), rms_current_a[axis], nominal_a)
    )
    return Limiter(Quantity.RMS_CURRENT, axis + 1, stretch, value, limit, 'A')


def _bends(master: Floats, samples: Floats) -> dict[Quantity, NDArray[np.bool_]]:
    """Tell where the bend of the path takes more of the TCP's acceleration and jerk than the master does."""
    v, a, j = (column[:, None] for column in master.T[1:])
    _, first, second, third = np.moveaxis(samples, 1, 0)

    def is_larger(bend: Floats, along: Floats) -> NDArray[np.bool_]:
        return np.asarray(np.linalg.norm(bend, axis=1) > np.linalg.norm(along, axis=1))

    return {
        Quantity.TCP_ACCELERATION: is_larger(second * v**2, first * a),
        Quantity.TCP_JERK: is_larger(3.0 * second * (v * a) + third * v**3, first * j),
    }
