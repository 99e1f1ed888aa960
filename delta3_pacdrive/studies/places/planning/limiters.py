"""Limits of a move with its demand on each, sample by sample."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.violations import compared
from delta3_pacdrive.planning.paths.path_dynamics import PathDynamics
from delta3_pacdrive.studies.places.planning.study import Quantity

RMS_USED_UP = 0.99  # of the nominal current


@dataclass(frozen=True)
class Limiter:
    """One limit and the demand of a move on it, at n samples."""

    quantity: Quantity
    axis: int | None  # 1 to 3; None for the TCP
    stretch: Floats  # factor on the time that would keep the limit
    value: Floats
    limit: Floats
    unit: str

    @cached_property
    def used(self) -> Floats:
        """Used share of the limit."""
        return np.asarray(self.value / self.limit)


def of_motion(
    dynamics: PathDynamics,
    master: Floats,
    samples: Floats,
    limits: tuple[Floats, Floats, Floats] | None,
    parameters: Parameters,
) -> tuple[Limiter, ...]:
    """Return the limits of TCP and motors with the demand of a motion."""
    found, shape = [], dynamics.time_s.shape
    bends = _bends(master, samples)
    for demand in compared(dynamics, parameters, limits):
        limit = np.broadcast_to(np.asarray(demand.limit, dtype=np.float64), shape)
        quantity = Quantity[demand.quantity.name]
        bend = bends.get(quantity, np.zeros(shape, dtype=np.bool_))
        for kind, rows in ((quantity, ~bend), (Quantity.CURVATURE, bend)):
            if rows.any():
                found.append(
                    Limiter(
                        quantity=kind,
                        axis=demand.axis,
                        stretch=demand.stretch * rows,
                        value=demand.value * rows,
                        limit=limit,
                        unit=demand.unit,
                    )
                )
    return tuple(found)


def of_torque_rate(
    times: Floats, steps: int, torque_n_m: Floats, payload: NDArray[np.int64], limit: float
) -> tuple[Limiter, ...]:
    """Return the rates of the motor torques without friction, (n, 3), with their limit [N m/s].

    Steps where the ``payload`` index, (n,), changes are not part of the motion and are ignored.
    """
    even = np.linspace(0.0, times[-1], steps + 1)
    at = np.searchsorted(times, even)  # not between the two samples at the end of a phase
    rate = np.zeros((len(even), torque_n_m.shape[1]))
    for piece in np.split(np.arange(len(even)), np.flatnonzero(np.diff(payload[at])) + 1):
        if len(piece) > 1:
            rate[piece] = np.abs(np.gradient(torque_n_m[at[piece]], even[piece], axis=0))
    found = []
    for axis, values in enumerate(rate.T):
        value, limits = np.interp(times, even, values), np.full(times.shape, limit)
        found.append(
            Limiter(
                quantity=Quantity.TORQUE_RATE,
                axis=axis + 1,
                stretch=np.cbrt(value / limit),
                value=value,
                limit=limits,
                unit='N m/s',
            )
        )
    return tuple(found)


def of_rms_current(
    times: Floats, rms_current_a: tuple[float, float, float], nominal_a: float
) -> Limiter | None:
    """Return the rms current of the program if it uses up the nominal current, else None."""
    axis = int(np.argmax(rms_current_a))
    used = rms_current_a[axis] / nominal_a
    if used < RMS_USED_UP:
        return None
    stretch, value, limit = (
        np.full(times.shape, one) for one in (math.sqrt(used), rms_current_a[axis], nominal_a)
    )
    return Limiter(
        quantity=Quantity.RMS_CURRENT, axis=axis + 1, stretch=stretch, value=value, limit=limit, unit='A'
    )


def _bends(master: Floats, samples: Floats) -> dict[Quantity, NDArray[np.bool_]]:
    """Return where the curvature causes more of the TCP acceleration and jerk than the motion along the path."""
    v, a, j = (column[:, None] for column in master.T[1:])
    _, first, second, third = np.moveaxis(samples, 1, 0)

    def is_larger(bend: Floats, along: Floats) -> NDArray[np.bool_]:
        return np.asarray(np.linalg.norm(bend, axis=1) > np.linalg.norm(along, axis=1))

    return {
        Quantity.TCP_ACCELERATION: is_larger(second * v**2, first * a),
        Quantity.TCP_JERK: is_larger(3.0 * second * (v * a) + third * v**3, first * j),
    }
