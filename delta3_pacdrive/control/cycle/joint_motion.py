"""Joint speeds and accelerations from the TCP set points, through the Jacobian, cycle by cycle.

    thetadot  = J^-1 Xdot                        (4.12)
    thetaddot = J^-1 (Xddot - Jdot thetadot)     (4.16)

As the controller of 11.2, this differentiates the set points by central and second differences. The motion of a cycle
is known with the set point of the next one.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.kinematics import arm_angles, forearms, geometry, jacobian_columns
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.vector3 import dot, triple
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.paths.path_dynamics import arm_motion

SPEED, ACCELERATION, NORMS, JACOBIAN = slice(0, 3), slice(3, 6), slice(6, 8), slice(8, 17)
COLUMNS = 17


@kernel
def _joint_motions(places, out, period, geometry_record):
    """Fill a row of ``out`` for each position that has two neighbours.

    Parameters
    ----------
    places
        TCP positions in successive bus cycles [m], shape (n, 3).
    out
        Receives arm speeds [rad/s] and accelerations [rad/s^2], TCP speed [m/s] and acceleration [m/s^2], and J by rows
        [m/rad], shape (n - 2, 17); nan where an arm cannot reach.
    period
        Bus cycle [s].
    geometry_record
        Array of one record ``kinematics.GEOMETRY``, shape (1,).

    """
    g = geometry_record[0]
    for n in range(out.shape[0]):
        before, place, after = triple(places[n]), triple(places[n + 1]), triple(places[n + 2])
        velocity = (
            (after[0] - before[0]) / (2.0 * period),
            (after[1] - before[1]) / (2.0 * period),
            (after[2] - before[2]) / (2.0 * period),
        )
        acceleration = (
            (after[0] - 2.0 * place[0] + before[0]) / (period * period),
            (after[1] - 2.0 * place[1] + before[1]) / (period * period),
            (after[2] - 2.0 * place[2] + before[2]) / (period * period),
        )
        theta = arm_angles(place, g)
        speeds, accelerations = arm_motion(theta, (place, velocity, acceleration), 1.0, 0.0, g)
        s, b = forearms(theta, place, g)
        columns = jacobian_columns(s, b)
        for i in range(3):
            out[n, i] = speeds[i]
            out[n, 3 + i] = accelerations[i]
            for axis in range(3):
                out[n, 8 + 3 * axis + i] = columns[i][axis]
        out[n, 6] = math.sqrt(dot(velocity, velocity))
        out[n, 7] = math.sqrt(dot(acceleration, acceleration))


def joint_motions(places: Floats, period_s: float, geometry_record: NDArray[Any]) -> dict[str, Floats]:
    """Return the joint motion signals at every position but the first and the last one.

    Parameters
    ----------
    places
        TCP positions in successive bus cycles [m], shape (n, 3).
    period_s
        Bus cycle [s].
    geometry_record
        ``kinematics.geometry`` of the robot.

    Returns
    -------
    dict
        ``joint_speed`` [rad/s], ``joint_acceleration`` [rad/s^2], and ``jacobian``: condition of J, speed [m/s] and
        acceleration [m/s^2] of the TCP; shapes (n - 2, 3). Nan where the TCP is out of reach.

    """
    out = np.empty((max(len(places) - 2, 0), COLUMNS))
    _joint_motions(np.ascontiguousarray(places, dtype=np.float64), out, period_s, geometry_record)
    condition = np.full(len(out), np.nan)
    known = np.isfinite(out[:, JACOBIAN]).all(axis=1)
    condition[known] = np.linalg.cond(out[known, JACOBIAN].reshape(-1, 3, 3))
    return {
        'joint_speed': out[:, SPEED].copy(),
        'joint_acceleration': out[:, ACCELERATION].copy(),
        'jacobian': np.column_stack([condition, out[:, NORMS]]),
    }


class JointMotion:
    """Joint motion of a robot, computed cycle by cycle from its set points."""

    def __init__(self, parameters: Parameters) -> None:
        self._period_s, self._geometry = parameters.bus.cycle_time_s, geometry(parameters)
        self._places = np.zeros((3, 3))  # of the last three bus cycles
        self._cycle, self._known = -1, 0  # last cycle, and number of consecutive cycles up to it
        # compile and load before the first bus cycle
        joint_motions(np.tile(parameters.motion.home_m, (3, 1)), self._period_s, self._geometry)

    def take(self, cycle: int, place: Floats) -> bool:
        """Take the TCP set point [m] of a bus cycle; return whether the motion of the cycle before is known."""
        self._known = self._known + 1 if cycle == self._cycle + 1 else 1
        self._cycle = cycle
        self._places[:2] = self._places[1:]
        self._places[2] = place
        return self._known >= len(self._places)

    def signals(self) -> dict[str, list[float]]:
        """Return the joint motion signals of the cycle before the last one taken."""
        found = joint_motions(self._places, self._period_s, self._geometry)
        return {name: values[0].tolist() for name, values in found.items()}
