"""The parts of the robot: names, shapes and colours, with all sizes from the parameters.

Lengths known to the dynamics (l_A, l_B, R_A, R_B, workspace) are exact. All others serve for display only and scale
with the robot: ``Sizes``. The frames of the parts, which ``poses`` places in ``base``:

    base                    robot frame: centre of the motor axes, z up
    motor1 ...              on the axis of the motor (radius R_A), x outward, y along the axis
    arm1 ...                on the axis of the motor, x along the upper arm to the elbow, y along the axis
    forearm1a, 1b, 2a ...   in the joint at the elbow, x along the rod to that at the plate; a towards +y of the arm
    plate, tool, payload    in the TCP, which is the centre of the joints of the plate; the plate never rotates
    workspace               in ``base``: cylinder of permitted positions

With a rotary axis tool and payload rotate by its angle, and the parts of ``tool_bar`` are added.

The plane of the plate's joints contains the TCP (4.1: R = R_A - R_B shrinks the plate to a point). Therefore the tool
is above the plate with its mouth in this plane, and the payload is below.
"""

import math
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

from delta3_pacdrive.parameters import Kinematics, Parameters
from delta3_pacdrive.scene import tool_bar
from delta3_pacdrive.scene.shapes import ALONG_X, ALONG_Y, Box, Cylinder, Shape, Sphere, about_z, product

Colour = tuple[float, float, float, float]  # red, green, blue, opacity, 0 to 1

ARMS = (1, 2, 3)
RODS = tuple(f'{arm}{rod}' for arm in ARMS for rod in 'ab')
NAMES = (
    'base',
    *(f'motor{arm}' for arm in ARMS),
    *(f'arm{arm}' for arm in ARMS),
    *(f'forearm{rod}' for rod in RODS),
    'plate',
    'tool',
    'payload',
    'workspace',
)
TURNING_NAMES = (*NAMES, *tool_bar.NAMES)  # of a robot with a rotary axis
FIXED = ('base', *(f'motor{arm}' for arm in ARMS), 'workspace')
PAYLOAD_DENSITY_KG_M3 = 1000.0  # of the cube that represents the payload

_LIGHT: Colour = (0.86, 0.87, 0.89, 1.0)
_STEEL: Colour = (0.55, 0.58, 0.62, 1.0)
_DARK: Colour = (0.20, 0.22, 0.25, 1.0)
_ORANGE: Colour = (0.93, 0.45, 0.13, 1.0)
_CARTON: Colour = (0.78, 0.60, 0.38, 1.0)
_AIR: Colour = (0.25, 0.55, 0.90, 0.12)
_TURNING = {'motor4': _DARK, 'bar_tube': _STEEL, 'bar_rod': _LIGHT, 'pointer': _ORANGE}


@dataclass(frozen=True)
class Sizes:
    """Display sizes [m] in proportion to the upper arm; only the distance of the rods affects the kinematics."""

    rod_distance_m: float  # between the two rods of a forearm
    rod_radius_m: float
    ball_radius_m: float  # at the ends of the rods
    arm_radius_m: float
    hub_radius_m: float  # of an upper arm on its motor
    motor_radius_m: float  # including the gear
    motor_length_m: float
    base_height_m: float  # of the underside of the base above the motor axes
    sheet_m: float  # thickness of base and plate
    tool_radius_m: float
    tool_height_m: float

    @classmethod
    def of(cls, kinematics: Kinematics) -> 'Sizes':
        """Return the sizes for a robot with these lengths."""
        arm, plate = kinematics.upper_arm_length_m, kinematics.plate_radius_m
        return cls(
            rod_distance_m=max(1.6 * plate, 0.12 * arm),
            rod_radius_m=0.015 * arm,
            ball_radius_m=0.03 * arm,
            arm_radius_m=0.045 * arm,
            hub_radius_m=0.10 * arm,
            motor_radius_m=0.11 * arm,
            motor_length_m=0.40 * arm,
            base_height_m=0.16 * arm,
            sheet_m=0.04 * arm,
            tool_radius_m=0.05 * arm,
            tool_height_m=0.14 * arm,
        )


@dataclass(frozen=True)
class Part:
    """A rigid part with its shapes in its own frame."""

    name: str
    colour: Colour
    shapes: tuple[Shape, ...] = field(default=())

    @property
    def moves(self) -> bool:
        """Whether the part moves with the arms."""
        return self.name not in FIXED and self.name != tool_bar.MOTOR

    def document(self) -> dict[str, Any]:
        """Return the part, ready for JSON."""
        return {
            'name': self.name,
            'colour': list(self.colour),
            'moves': self.moves,
            'shapes': [shape.document() for shape in self.shapes],
        }


def parts(parameters: Parameters, payload_kg: float | None = None) -> tuple[Part, ...]:
    """Return the parts of a robot in the order of ``names_of``.

    Parameters
    ----------
    parameters
        The robot.
    payload_kg
        Payload [kg]; default: that of the parameters. For 0 there is no part ``payload``.

    """
    kinematics = parameters.kinematics
    sizes = Sizes.of(kinematics)
    carried_kg = parameters.dynamics.payload_mass_kg if payload_kg is None else payload_kg
    found = [Part('base', _LIGHT, _base(kinematics, sizes))]
    found += [Part(f'motor{i}', _DARK, _motor(sizes)) for i in ARMS]
    lengths = kinematics.upper_arm_lengths_m, kinematics.forearm_lengths_m
    found += [Part(f'arm{i}', _ORANGE, _arm(lengths[0][i - 1], sizes)) for i in ARMS]
    found += [Part(f'forearm{i}', _DARK, _rod(lengths[1][arm_of(i)], sizes)) for i in RODS]
    found += [Part('plate', _STEEL, _plate(kinematics, sizes)), Part('tool', _DARK, _tool(sizes))]
    if carried_kg > 0.0:
        edge = payload_edge(carried_kg)
        found.append(Part('payload', _CARTON, (Box((0.0, 0.0, -0.5 * edge), size_m=(edge, edge, edge)),)))
    found.append(Part('workspace', _AIR, (_workspace(kinematics),)))
    base_top_m = sizes.base_height_m + 3.0 * sizes.sheet_m
    for names in tool_bar.bars(parameters):
        shapes = tool_bar.shapes(kinematics, sizes.tool_height_m, base_top_m)
        found += [Part(name, _TURNING[name], shapes[name]) for name in names]
    return tuple(found)


def names_of(parameters: Parameters) -> tuple[str, ...]:
    """Return the names of all possible parts of a robot: ``NAMES`` or ``TURNING_NAMES``."""
    return (*NAMES, *chain.from_iterable(tool_bar.bars(parameters)))


def arm_of(rod: str) -> int:
    """Return the index of the arm of a rod of ``RODS``, from 0 on."""
    return int(rod[0]) - 1


def payload_edge(payload_kg: float) -> float:
    """Return the edge [m] of the cube that represents a payload [kg]."""
    return float((payload_kg / PAYLOAD_DENSITY_KG_M3) ** (1.0 / 3.0))


def document(parameters: Parameters, payload_kg: float | None = None) -> dict[str, Any]:
    """Return all parts and their conventions, ready for JSON.

    Parameters
    ----------
    parameters
        The robot.
    payload_kg
        Payload [kg]; default: that of the parameters.

    Returns
    -------
    dict[str, Any]
        ``frame``, ``quaternion_order``, ``cylinder_axis`` and ``parts``: name, colour (red, green, blue, opacity from 0
        to 1), whether it moves, and shapes with kind (box, cylinder, sphere), position and sizes [m].

    """
    return {
        'frame': 'base',
        'quaternion_order': 'xyzw',
        'cylinder_axis': 'z',
        'parts': [part.document() for part in parts(parameters, payload_kg)],
    }


def _base(kinematics: Kinematics, sizes: Sizes) -> tuple[Shape, ...]:
    height = sizes.base_height_m + 0.5 * sizes.sheet_m
    sheet = Cylinder(
        (0.0, 0.0, height),
        radius_m=kinematics.base_radius_m + 0.5 * sizes.hub_radius_m,
        length_m=sizes.sheet_m,
    )
    post = Cylinder(
        (0.0, 0.0, height + 1.5 * sizes.sheet_m),
        radius_m=0.5 * kinematics.base_radius_m,
        length_m=2.0 * sizes.sheet_m,
    )
    return (sheet, post)


def _motor(sizes: Sizes) -> tuple[Shape, ...]:
    """Return a motor next to its arm, and its holder."""
    middle = 0.6 * sizes.hub_radius_m + 0.5 * sizes.motor_length_m
    motor = Cylinder(
        (0.0, middle, 0.0), ALONG_Y, radius_m=sizes.motor_radius_m, length_m=sizes.motor_length_m
    )
    holder = Box(
        (-0.5 * sizes.motor_radius_m, middle, 0.5 * sizes.base_height_m),
        size_m=(sizes.motor_radius_m, 0.5 * sizes.motor_length_m, sizes.base_height_m),
    )
    return (motor, holder)


def _arm(length: float, sizes: Sizes) -> tuple[Shape, ...]:
    hub = Cylinder((0.0, 0.0, 0.0), ALONG_Y, radius_m=sizes.hub_radius_m, length_m=sizes.hub_radius_m)
    tube = Cylinder((0.5 * length, 0.0, 0.0), ALONG_X, radius_m=sizes.arm_radius_m, length_m=length)
    elbow = Cylinder(
        (length, 0.0, 0.0), ALONG_Y, radius_m=0.8 * sizes.ball_radius_m, length_m=sizes.rod_distance_m
    )
    return (hub, tube, elbow)


def _rod(length: float, sizes: Sizes) -> tuple[Shape, ...]:
    tube = Cylinder((0.5 * length, 0.0, 0.0), ALONG_X, radius_m=sizes.rod_radius_m, length_m=length)
    balls = (Sphere((x, 0.0, 0.0), radius_m=sizes.ball_radius_m) for x in (0.0, length))
    return (tube, *balls)


def _plate(kinematics: Kinematics, sizes: Sizes) -> tuple[Shape, ...]:
    """Return a hub, and for each forearm a spoke that ends in the axis of its joints."""
    radius, thickness = kinematics.plate_radius_m, 0.5 * sizes.sheet_m
    hub_radius = max(0.8 * radius, sizes.tool_radius_m)
    shapes: list[Shape] = [Cylinder((0.0, 0.0, 0.5 * thickness), radius_m=hub_radius, length_m=thickness)]
    for azimuth in kinematics.arm_azimuth_rad:
        x, y, turned = radius * math.cos(azimuth), radius * math.sin(azimuth), about_z(azimuth)
        spoke = (radius, 2.0 * sizes.ball_radius_m, thickness)
        shapes.append(Box((0.5 * x, 0.5 * y, 0.5 * thickness), turned, size_m=spoke))
        shapes.append(
            Cylinder(
                (x, y, 0.0),
                product(turned, ALONG_Y),
                radius_m=0.8 * sizes.ball_radius_m,
                length_m=sizes.rod_distance_m,
            )
        )
    return tuple(shapes)


def _tool(sizes: Sizes) -> tuple[Shape, ...]:
    height = sizes.tool_height_m
    return (
        Cylinder((0.0, 0.0, 0.5 * height), radius_m=sizes.tool_radius_m, length_m=height),
        Cylinder((0.0, 0.0, 1.1 * height), radius_m=0.5 * sizes.tool_radius_m, length_m=0.2 * height),
    )


def _workspace(kinematics: Kinematics) -> Shape:
    top, bottom = kinematics.workspace_top_m, kinematics.workspace_bottom_m
    return Cylinder(
        (0.0, 0.0, 0.5 * (top + bottom)),
        radius_m=0.5 * kinematics.workspace_diameter_m,
        length_m=top - bottom,
    )
