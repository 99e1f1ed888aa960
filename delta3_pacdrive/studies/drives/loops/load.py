"""Load of a drive: inertia and gravity at the shaft, which depend on the pose, and the slope of the friction.

Three drives with equal gains decouple along the eigenvectors of A (4.26). Each mode moves like a single drive with the
inertia lambda / k_r^2. An axis that moves while the others are at rest has the inertia A_ii / k_r^2.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.errors import TuningError, UnreachableError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

RADII, DIRECTIONS, HEIGHTS = 7, 12, 6  # of the grid over the workspace


@dataclass(frozen=True)
class Load:
    """Load of one drive, motor side."""

    name: str
    inertia_kg_m2: float  # including the rotor; infinite for a locked shaft
    gravity_n_m: float = 0.0


@dataclass(frozen=True)
class Gear:
    """Elastic gear in contact, as seen by the linear loops; motor side."""

    rotor_kg_m2: float  # rotor and brake
    stiffness_n_m_rad: float
    damping_n_m_s_rad: float

    def torque(self, twist: Any, rate: Any) -> Any:
        """Return the torque [N m] on the arm from twist [rad] and its rate [rad/s]."""
        return self.stiffness_n_m_rad * twist + self.damping_n_m_s_rad * rate


def gear_of(parameters: Parameters) -> Gear | None:
    """Return the elastic gear of a built robot; None for a rigid one."""
    effects, ratio = parameters.rich.effects, parameters.dynamics.gear_ratio
    if not effects.gear:
        return None
    return Gear(
        dynamics.rotor_inertia(parameters) / ratio**2,
        effects.gear_stiffness_n_m_rad / ratio**2,
        effects.gear_damping_n_m_s_rad / ratio**2,
    )


@dataclass(frozen=True)
class Modes:
    """Modes of the arms in a pose."""

    inertia_kg_m2: Floats  # lambda / k_r^2, motor side, ascending, shape (3,)
    shares: Floats  # squared components of the eigenvectors: row axis, column mode; rows and columns sum to 1


def load_at(point_m: Sequence[float], axis: int, parameters: Parameters) -> Load:
    """Return the load of an axis, 0 to 2, in a pose while the other axes are at rest.

    Raises
    ------
    UnreachableError
        The arms do not reach the point.

    """
    theta = kinematics.inverse(np.asarray(point_m, dtype=np.float64), parameters.kinematics)
    ratio = parameters.dynamics.gear_ratio
    inertia = float(dynamics.mass_matrix(theta, parameters)[axis, axis]) / ratio**2
    gravity = float(dynamics.gravity(theta, parameters)[axis]) / ratio
    x, y, z = point_m
    return Load(f'axis{axis + 1} at ({x:g}, {y:g}, {z:g}) m', inertia, gravity)


def modes_at(point_m: Sequence[float], parameters: Parameters) -> Modes:
    """Return the modes of a pose; raises UnreachableError."""
    theta = kinematics.inverse(np.asarray(point_m, dtype=np.float64), parameters.kinematics)
    values, vectors = np.linalg.eigh(dynamics.mass_matrix(theta, parameters))
    return Modes(values / parameters.dynamics.gear_ratio**2, vectors**2)


def extremes(parameters: Parameters) -> tuple[Load, Load]:
    """Return the lightest and the heaviest mode on a grid over the workspace; their names contain the position.

    Raises
    ------
    TuningError
        No point of the workspace can be reached.

    """
    p = parameters.kinematics
    found = []
    for z in np.linspace(p.workspace_bottom_m, p.workspace_top_m, HEIGHTS):
        for radius in np.linspace(0.0, p.workspace_diameter_m / 2.0, RADII):
            for angle in np.arange(DIRECTIONS) * math.tau / DIRECTIONS:
                point = (float(radius * math.cos(angle)), float(radius * math.sin(angle)), float(z))
                try:
                    inertia = modes_at(point, parameters).inertia_kg_m2
                except UnreachableError:
                    continue
                found += [(float(inertia[0]), point), (float(inertia[-1]), point)]
    if not found:
        raise TuningError(
            'no point of the workspace can be reached: kinematics.workspace_* do not fit the arms'
        )
    lightest, heaviest = min(found), max(found)
    return tuple(  # type: ignore[return-value]
        Load(f'{kind} mode, ({x:.2f}, {y:.2f}, {z:.2f}) m', inertia)
        for kind, (inertia, (x, y, z)) in (('lightest', lightest), ('heaviest', heaviest))
    )


def friction_slope(speed_rad_s: float, parameters: Parameters) -> float:
    """Return the slope [N m s/rad] of F_s tanh(w/w_s) + F_v w, the viscous friction for small signals (8.2)."""
    motor = parameters.motor
    ratio = min(abs(speed_rad_s) / motor.friction_smoothing_rad_s, 100.0)
    steep = motor.static_friction_n_m / motor.friction_smoothing_rad_s / math.cosh(ratio) ** 2
    return motor.viscous_friction_n_m_s_rad + steep
