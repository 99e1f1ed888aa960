"""Display of the telescopic bar of a rotary axis: a tube at its motor, and a rod that slides in it, at the tool.

It reaches from the centre of the motor axes to the top of the tool, with a universal joint at each end. Its mass only
contributes to the inertia about its own axis (``rotary.tool_inertia_kg_m2``). Additional parts of such a robot:

    motor4     in ``base``: motor of the axis on the base plate, with its shaft
    bar_tube   in the joint below the motor, z along the bar, away from the tool
    bar_rod    in the joint on the tool, with the orientation of the tube
    pointer    in the TCP: a bar across the mouth of the tool that rotates with it, its head towards x of the tool
"""

import math

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, Kinematics, Parameters, Rotary
from delta3_pacdrive.scene.shapes import Box, Cylinder, Shape, Sphere

MOTOR = 'motor4'
NAMES = (MOTOR, 'bar_tube', 'bar_rod', 'pointer')
TUBE_SHARE, LEFT_SHARE = 0.9, 0.05  # length of the tube and minimum overlap, relative to the shortest bar
# relative to the length of the upper arm
_TUBE_RADIUS, _ROD_RADIUS = 0.032, 0.02
_MOTOR_RADIUS, _MOTOR_LENGTH = 0.10, 0.30
_POINTER, _HEAD = (0.44, 0.05, 0.03), (0.08, 0.12, 0.06)  # length, width, height of pointer and head


def bodies(parameters: Parameters) -> list[tuple[str, str, Rotary]]:
    """Return name, turned body and parameters of each rotary axis; the last one turns the tool.

    Each axis turns relative to the one before, about the same line; the bodies between them have no shape.
    """
    names = parameters.axes[ARMS:]
    turned = [*(f'turned_{name}' for name in names[:-1]), 'tool']
    return list(zip(names, turned, parameters.rotary_axes, strict=False))


def bars(parameters: Parameters) -> tuple[tuple[str, ...], ...]:
    """Return the names of the parts of each bar; all rotary axes of a robot share one."""
    return (NAMES,) * len(parameters.rotary_axes[:1])


def top_m(tool_height_m: float) -> float:
    """Return the height of the bar's end above the TCP [m]."""
    return 1.2 * tool_height_m


def lengths_m(kinematics: Kinematics, tool_height_m: float) -> tuple[float, float]:
    """Return the lengths of tube and rod [m] with which the bar covers the workspace."""
    top, bottom = (
        abs(height + top_m(tool_height_m))
        for height in (kinematics.workspace_top_m, kinematics.workspace_bottom_m)
    )
    tube = TUBE_SHARE * top
    longest = math.hypot(0.5 * kinematics.workspace_diameter_m, bottom)
    return tube, longest - tube + LEFT_SHARE * top


def shapes(kinematics: Kinematics, tool_height_m: float, base_top_m: float) -> dict[str, tuple[Shape, ...]]:
    """Return the shapes of the parts, by ``NAMES``.

    Parameters
    ----------
    kinematics
        Geometry of the robot.
    tool_height_m
        Height of its tool [m].
    base_top_m
        Height of the base's top above the motor axes [m].

    """
    arm = kinematics.upper_arm_length_m
    tube, rod = lengths_m(kinematics, tool_height_m)
    wide, narrow, motor = _TUBE_RADIUS * arm, _ROD_RADIUS * arm, _MOTOR_LENGTH * arm
    length, width, height = (arm * share for share in _POINTER)
    head: tuple[float, float, float] = (arm * _HEAD[0], arm * _HEAD[1], arm * _HEAD[2])
    return {
        MOTOR: (
            Cylinder((0.0, 0.0, base_top_m + 0.5 * motor), radius_m=_MOTOR_RADIUS * arm, length_m=motor),
            Cylinder((0.0, 0.0, 0.5 * base_top_m), radius_m=wide, length_m=base_top_m),
        ),
        'bar_tube': (
            Sphere(radius_m=1.3 * wide),
            Cylinder((0.0, 0.0, -0.5 * tube), radius_m=wide, length_m=tube),
        ),
        'bar_rod': (
            Sphere(radius_m=1.5 * narrow),
            Cylinder((0.0, 0.0, 0.5 * rod), radius_m=narrow, length_m=rod),
        ),
        'pointer': (
            Box((0.0, 0.0, -0.5 * height), size_m=(length, width, height)),
            Box((0.5 * (length - head[0]), 0.0, -0.5 * head[2]), size_m=head),
        ),
    }


def directed(tool_m: Floats, turn_rad: Floats) -> Floats:
    """Return the orientation of tube and rod for positions of the tool.

    Parameters
    ----------
    tool_m
        Positions of the joint on the tool in ``base`` [m], shape (n, 3).
    turn_rad
        Tool angles [rad], shape (n,).

    Returns
    -------
    Floats
        Unit quaternions x, y, z, w, shape (n, 4): the shortest rotation of z into the bar, after that about z.

    """
    along = -tool_m / np.linalg.norm(tool_m, axis=-1, keepdims=True)
    x, y, z = along.T
    length = np.sqrt(2.0 * (1.0 + z))
    a, b, w = -y / length, x / length, 0.5 * length  # of the tilt, which has no z component
    sin, cos = np.sin(0.5 * turn_rad), np.cos(0.5 * turn_rad)
    found = np.stack([a * cos + b * sin, b * cos - a * sin, w * sin, w * cos], axis=-1)
    return np.where(found[..., 3:] < 0.0, -found, found)


def about_z(turn_rad: Floats) -> Floats:
    """Return the rotations about z by angles [rad], shape (n,), as quaternions, shape (n, 4); w is not negative."""
    found = np.zeros((len(turn_rad), 4))
    found[:, 2], found[:, 3] = np.sin(0.5 * turn_rad), np.cos(0.5 * turn_rad)
    return np.where(found[:, 3:] < 0.0, -found, found)
