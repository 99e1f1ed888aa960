"""Evaluation of a pose given by a point or by arm angles."""

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.errors import UnreachableError
from delta3_pacdrive.numerics.singular_values import singular_values
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.vector3 import triple
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.capability import capability
from delta3_pacdrive.planning.limits.joint_forces import joint_forces
from delta3_pacdrive.planning.limits.limits import Bound, arm_bounds, workspace_bounds
from delta3_pacdrive.studies.places.pose.study import Margin, Pose, Solution

SAME_RAD = 1e-7  # tolerance for equal angles; two solutions meet at a serial singularity


def of_point(p: ArrayLike, parameters: Parameters) -> Pose:
    """Return the pose with the TCP at a point [m], shape (3,), and the elbows outward.

    If the arms cannot reach the point, the pose has no angles.
    """
    point = np.array(p, dtype=np.float64)
    solutions = _solutions(point, parameters)
    theta = solutions[0].arm_angle_rad
    if not np.isfinite(theta).all():
        reason = f'the point is out of reach of {_arms(np.flatnonzero(np.isnan(theta)).tolist())}'
        margins = _margins(workspace_bounds(point[None], parameters))
        broken = [margin.sentence for margin in margins if not margin.is_kept]
        return Pose(
            solutions=solutions,
            margins=margins,
            refusals=(reason, *broken),
            payload_kg=parameters.dynamics.payload_mass_kg,
            point_m=point,
        )
    return _pose(theta, point, solutions, parameters)


def of_angles(theta: ArrayLike, parameters: Parameters) -> Pose:
    """Return the pose with these arm angles [rad], shape (3,), and the plate below the elbow plane.

    If forward kinematics has no solution, the pose has no point.
    """
    angles = np.array(theta, dtype=np.float64)
    try:
        point = kinematics.forward(angles, parameters)
    except UnreachableError as error:
        return Pose(
            solutions=(),
            margins=(),
            refusals=(str(error),),
            payload_kg=parameters.dynamics.payload_mass_kg,
            arm_angle_rad=angles,
        )
    return _pose(angles, point, _solutions(point, parameters), parameters)


def _arms(indices: list[int]) -> str:
    """Return names of arms, counted from 0, as text."""
    names = [str(i + 1) for i in indices]
    return f'arm {names[0]}' if len(names) == 1 else f'arms {", ".join(names[:-1])} and {names[-1]}'


def _pose(theta: Floats, point: Floats, solutions: tuple[Solution, ...], parameters: Parameters) -> Pose:
    jacobian = kinematics.jacobian(theta, point, parameters)
    margins = _margins(_bounds(theta, point, parameters))
    refusals = [margin.sentence for margin in margins if not margin.is_kept]
    number = _number(theta, solutions)
    works = number == 0
    if not works:
        inward = _arms([i for i in range(3) if number is None or number >> i & 1])
        refusals.append(f'{inward} with the elbow inward: the robot works with all elbows outward')
    torque = dynamics.gravity(theta, parameters)
    per_ampere = parameters.dynamics.gear_ratio * parameters.motor.torque_constant_n_m_a
    finite = bool(np.isfinite(jacobian).all())
    return Pose(
        solutions=solutions,
        margins=margins,
        refusals=tuple(refusals),
        payload_kg=parameters.dynamics.payload_mass_kg,
        point_m=point,
        mirror_m=kinematics.forward(theta, parameters, above=True),
        arm_angle_rad=theta,
        number=number,
        jacobian=jacobian if finite else None,
        singular_values=np.array(singular_values(*map(triple, jacobian.T))) if finite else None,
        capability=capability(point, parameters) if works else None,
        holding_torque_n_m=torque,
        holding_current_a=torque / per_ampere,
        forces=joint_forces(point, np.zeros(3), np.zeros(3), parameters) if works else None,
    )


def _number(theta: Floats, solutions: tuple[Solution, ...]) -> int | None:
    """Return the number of the solution with these angles, modulo full turns; None if there is none."""
    apart = [float(np.abs(np.angle(np.exp(1j * (one.arm_angle_rad - theta)))).max()) for one in solutions]
    best = int(np.nanargmin(apart)) if np.isfinite(apart).any() else 0
    return best if apart and apart[best] < SAME_RAD else None


def _solutions(point: Floats, parameters: Parameters) -> tuple[Solution, ...]:
    k = parameters.kinematics
    found = []
    for number, theta in enumerate(kinematics.inverse_all(point, parameters)):
        degrees = np.degrees(theta)
        legal = bool(((degrees >= k.arm_angle_min_deg) & (degrees <= k.arm_angle_max_deg)).all())
        sides = tuple('in' if number >> i & 1 else 'out' for i in range(3))
        found.append(Solution(number, sides, theta, legal, loop_error(theta, point, parameters)))
    return tuple(found)


def elbows(theta: Floats, parameters: Parameters) -> Floats:
    """Return the elbows [m] of three arm angles, shifted by the plate radius to the TCP (4.2), shape (3, 3)."""
    g = kinematics.geometry(parameters.kinematics)[0]
    return np.array(
        [kinematics.elbow(i, float(np.cos(theta[i])), float(np.sin(theta[i])), g) for i in range(3)]
    )


def loop_error(theta: Floats, point: Floats, parameters: Parameters) -> float:
    """Return the largest deviation of the forearm lengths from l_B [m]; nan without angles."""
    if not np.isfinite(theta).all():
        return float('nan')
    lengths = np.linalg.norm(point - elbows(theta, parameters), axis=1)
    return float(np.abs(lengths - parameters.kinematics.forearm_lengths_m).max())


def _bounds(theta: Floats, point: Floats, parameters: Parameters) -> tuple[Bound, ...]:
    serial, parallel = kinematics.singularity(theta, point, parameters)
    swing = kinematics.forearm_swing(point, parameters.kinematics)
    arms = arm_bounds(theta[None], swing[None], serial[None], np.atleast_1d(parallel), parameters)
    return (*workspace_bounds(point[None], parameters), *arms)


def _margins(bounds: tuple[Bound, ...]) -> tuple[Margin, ...]:
    found = []
    for bound in bounds:
        of_arms = bound.values.ndim == 2
        values, distances, kept = bound.values.ravel(), bound.margin.ravel(), bound.kept.ravel()
        for i, (value, distance) in enumerate(zip(values.tolist(), distances.tolist(), strict=True)):
            arm = i + 1 if of_arms else None
            name = f'{bound.what} {arm}' if of_arms else bound.what
            limit = float(bound.limit)
            found.append(
                Margin(
                    name=name,
                    key=bound.key,
                    arm=arm,
                    value=value,
                    limit=limit,
                    is_upper=bound.is_upper,
                    distance=distance,
                    unit=bound.unit,
                    is_kept=bool(kept[i]),
                )
            )
    return tuple(found)
