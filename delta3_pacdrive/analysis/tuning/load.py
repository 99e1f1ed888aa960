"""What a drive has to move: inertia and gravity at the shaft, which depend on the pose, and the slope of friction.

Three drives with equal gains decouple along the eigenvectors of A (4.26): a motion along one of them is that of a
single drive with the inertia lambda / k_r^2. An axis that moves while the others stand still feels A_ii / k_r^2.
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
    """The load is what one drive moves, motor side.

    Attributes
    ----------
    name
        For people.
    inertia_kg_m2
        Rotor included; infinite for a shaft that is held.
    gravity_n_m
        Torque that gravity asks for.

    """

    name: str
    inertia_kg_m2: float
    gravity_n_m: float = 0.0


@dataclass(frozen=True)
class Gear:
    """A gear that gives, as the linear loops see it: flanks that touch, motor side.

    Attributes
    ----------
    rotor_kg_m2
        Inertia in front of it: rotor and brake.
    stiffness_n_m_rad, damping_n_m_s_rad
        Of the spring between rotor and arm.

    """

    rotor_kg_m2: float
    stiffness_n_m_rad: float
    damping_n_m_s_rad: float

    def torque(self, twist: Any, rate: Any) -> Any:
        """Torque [N m] that it passes on to the arm, from twist [rad] and its rate [rad/s]."""
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
    """The modes say how the three drives move the arms in a pose.

    Attributes
    ----------
    inertia_kg_m2
        lambda / k_r^2 of the modes, motor side, ascending; shape (3,).
    shares
        Squares of the components of the eigenvectors: row axis, column mode; each row and column sums to 1.

    """

    inertia_kg_m2: Floats
    shares: Floats


def load_at(point_m: Sequence[float], axis: int, parameters: Parameters) -> Load:
    """Load of an axis, 0 to 2, in a pose while the other axes stand still.

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
    """Modes of a pose; raises UnreachableError."""
    theta = kinematics.inverse(np.asarray(point_m, dtype=np.float64), parameters.kinematics)
    values, vectors = np.linalg.eigh(dynamics.mass_matrix(theta, parameters))
    return Modes(values / parameters.dynamics.gear_ratio**2, vectors**2)


def extremes(parameters: Parameters) -> tuple[Load, Load]:
    """Lightest and heaviest mode over the workspace, on a grid; names tell where they are found.

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
        Load(f'{what} mode, ({x:.2f}, {y:.2f}, {z:.2f}) m', inertia)
        for what, (inertia, (x, y, z)) in (('lightest', lightest), ('heaviest', heaviest))
    )


def friction_slope(speed_rad_s: float, parameters: Parameters) -> float:
    """Slope [N m s/rad] of F_s tanh(w/w_s) + F_v w at a speed: small signals feel it as viscous friction (8.2)."""
    motor = parameters.motor
    ratio = min(abs(speed_rad_s) / motor.friction_smoothing_rad_s, 100.0)
    steep = motor.static_friction_n_m / motor.friction_smoothing_rad_s / math.cosh(ratio) ** 2
    return motor.viscous_friction_n_m_s_rad + steep
