"""The plate of a built robot: hung from six rods, it need not stay parallel to the base (4.1, 12).

The thesis models a forearm as one rod and the plate as a point. A built forearm consists of two rods that form a
parallelogram with elbow and plate. If their lengths or the heights of the plate's joints differ, the plate tilts and
rotates, and moves the TCP, which is below the joints. Its pose solves six equations, one per rod,

    |p + Q a_ij - e_ij| = l_ij,

with e_ij a joint at the elbow, a_ij one at the plate in the frame of the plate, Q the rotation. The tilt is small, so
Newton's method with slopes for constant Q gains two digits or more per step.

The dynamics ignore the tilt: masses move with the mean of both rods, an error of some ten-thousandths.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.kinematics import elbow, plate_position
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.vector3 import combine, cross, dot
from delta3_pacdrive.parameters import Parameters

PLATE = np.dtype(
    [
        ('tilts', 'i8'),  # 0: stays parallel
        ('radius', 'f8'),  # R_B [m]
        ('half', 'f8'),  # half the spacing of the rods [m]
        ('difference', 'f8', (3,)),  # left less right rod length of a forearm [m]
        ('height', 'f8', (3,)),  # of the plate's joints above its plane [m]
        ('tool', 'f8'),  # distance of the TCP below it [m]
    ],
    align=True,
)
STEPS = 6  # of Newton's method; each reduces the error about a thousandfold
POSE = 6  # unknowns: position and rotation


def plate_constants(parameters: Parameters) -> NDArray[Any]:
    """Return one record of ``PLATE``."""
    effects, record = parameters.rich.effects, np.zeros(1, PLATE)
    record['tilts'] = effects.parallelogram
    record['radius'] = parameters.kinematics.plate_radius_m
    record['half'] = 0.5 * effects.rod_spacing_m
    record['difference'] = effects.rod_difference_m
    record['height'] = effects.plate_joint_height_m
    record['tool'] = effects.tool_length_m
    return record


@kernel
def turned(v, gibbs):
    """Rotate a vector by a rotation given as its axis times the tangent of half its angle."""
    once = cross(gibbs, v)
    factor = 2.0 / (1.0 + dot(gibbs, gibbs))
    return combine(1.0, v, factor, once, factor, cross(gibbs, once))


@kernel
def solve_pose(equations):
    """Solve six linear equations in place, shape (6, 7), by Gauss-Jordan with pivoting; last column: solution."""
    for k in range(POSE):
        best = k
        for row in range(k + 1, POSE):
            if abs(equations[row, k]) > abs(equations[best, k]):
                best = row
        for column in range(POSE + 1):
            equations[k, column], equations[best, column] = equations[best, column], equations[k, column]
        per = 1.0 / equations[k, k]
        for row in range(POSE):
            if row != k:
                factor = equations[row, k] * per
                for column in range(k, POSE + 1):
                    equations[row, column] -= factor * equations[k, column]
    for k in range(POSE):
        equations[k, POSE] /= equations[k, k]


@kernel
def plate_pose(theta, g, plate):
    """Position of the plate's centre [m] and its rotation (``turned``) for three arm angles; nan where FK fails."""
    place, gibbs = plate_position(theta, g), (0.0, 0.0, 0.0)
    equations = np.empty((POSE, POSE + 1))
    for _ in range(STEPS):
        for i in range(3):
            outward, left = (g.cos_alpha[i], g.sin_alpha[i], 0.0), (-g.sin_alpha[i], g.cos_alpha[i], 0.0)
            c = elbow(i, math.cos(theta[i]), math.sin(theta[i]), g)
            for n in range(2):
                side = 1.0 - 2.0 * n
                offset = side * plate.half
                fixed = combine(plate.radius, outward, offset, left, plate.height[i], (0.0, 0.0, 1.0))
                arm = turned(fixed, gibbs)
                at_elbow = combine(1.0, c, plate.radius, outward, offset, left)
                d = combine(1.0, place, 1.0, arm, -1.0, at_elbow)
                length = g.l_b[i] + 0.5 * side * plate.difference[i]
                turn = cross(arm, d)
                row = 2 * i + n
                for column in range(3):
                    equations[row, column], equations[row, 3 + column] = d[column], turn[column]
                equations[row, POSE] = 0.5 * (length * length - dot(d, d))
        solve_pose(equations)
        step = (equations[0, POSE], equations[1, POSE], equations[2, POSE])
        spin = (equations[3, POSE], equations[4, POSE], equations[5, POSE])
        place = combine(1.0, place, 1.0, step, 0.0, step)
        gibbs = combine(1.0, gibbs, 0.5, spin, 0.0, spin)
    return place, gibbs


@kernel
def tool_place(theta, g, plate):
    """TCP [m] as defined in the controller: above the tip by the length of a vertical tool."""
    place, gibbs = plate_pose(theta, g, plate)
    tip = turned((0.0, 0.0, -plate.tool), gibbs)
    return (place[0] + tip[0], place[1] + tip[1], place[2] + tip[2] + plate.tool)
