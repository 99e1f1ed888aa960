"""The robot as URDF, for robot_state_publisher, RViz, Foxglove and other readers.

URDF only supports trees. The joints of the motors have the names of ``joint_states``; the passive joints are those of
``telegrams.JOINTS``. With the angles of ``scene.joints`` the loops close: ``forearm1b_end`` coincides with
``plate_1b``, and so on. A universal joint is a joint ``pitch``, a link without shape (``forearm1a_elbow``), and a joint
``swing``. The tool of a rotary axis has its own joint on the plate; its bar has no links, as it would close another
loop.
"""

import math
import warnings
from collections.abc import Iterable, Sequence
from xml.etree import ElementTree as ET

from scipy.spatial.transform import Rotation

from delta3_pacdrive.dynamics import rotor_inertia
from delta3_pacdrive.parameters import Parameters, Rotary
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.scene import tool_bar
from delta3_pacdrive.scene.masses import TINY_KG, Inertia, masses
from delta3_pacdrive.scene.parts import ARMS, Part, Sizes, parts
from delta3_pacdrive.scene.poses import frames
from delta3_pacdrive.scene.shapes import Box, Cylinder, Shape, Sphere

Y, Z = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
LINK_NAMES = {'link': 'name', 'parent': 'link', 'child': 'link'}  # elements with their attribute
_PASSIVE_SPEED_RAD_S, _PASSIVE_EFFORT_N_M = 100.0, 0.0  # URDF requires limits of passive joints, too


def urdf(parameters: Parameters, prefix: str = '') -> str:
    """Return the robot with its payload as URDF; the names of all links begin with ``prefix``.

    Links are the parts of ``parts.names_of`` except workspace and bar, and the frames in which rods and plate meet;
    masses are those of the dynamics (``masses``), without the rotors.
    """
    robot = ET.Element('robot', name='delta3_pacdrive')
    rotor = f' The rotors add {rotor_inertia(parameters):.6g} kg m2 to each axis, which URDF cannot say. '
    robot.append(ET.Comment(rotor))
    writer = _Writer(robot, parts(parameters), masses(parameters))
    k = parameters.kinematics
    hip, joint = frames(parameters)
    half = 0.5 * Sizes.of(k).rod_distance_m
    writer.link('base')
    for i, arm in enumerate(ARMS):
        azimuth = k.arm_azimuth_rad[i]
        writer.fixed(f'motor{arm}', 'base', hip[i], azimuth)
        _axis(writer, arm, parameters)
        for side, rod in ((1.0, f'{arm}a'), (-1.0, f'{arm}b')):
            elbow = (k.upper_arm_lengths_m[i], side * half, 0.0)
            name = f'forearm{rod}'
            writer.passive(f'{name}_pitch', f'{name}_elbow', f'arm{arm}', elbow, axis=Y, limit=math.pi)
            writer.passive(f'{name}_swing', name, f'{name}_elbow', (0.0, 0.0, 0.0), axis=Z, limit=math.pi / 2)
            writer.fixed(f'{name}_end', name, (k.forearm_lengths_m[i], 0.0, 0.0))
    writer.passive(
        'plate_swing', 'plate_1a_joint', 'forearm1a_end', (0.0, 0.0, 0.0), axis=Z, limit=math.pi / 2
    )
    writer.passive('plate_pitch', 'plate_1a_turned', 'plate_1a_joint', (0.0, 0.0, 0.0), axis=Y, limit=math.pi)
    # from the joint to the TCP, in the frame of the arm
    back = Rotation.from_euler('z', -k.arm_azimuth_rad[0]).apply(-joint[0, 0])
    writer.fixed('plate', 'plate_1a_turned', back, -k.arm_azimuth_rad[0])
    for i, arm in enumerate(ARMS):
        for n, rod in enumerate('ab'):
            writer.fixed(f'plate_{arm}{rod}', 'plate', joint[i, n])
    _tool(writer, parameters)
    if 'payload' in writer.parts:
        writer.fixed('payload', 'tool', (0.0, 0.0, 0.0))
    ET.indent(robot)
    for element in robot.iter():
        if key := LINK_NAMES.get(element.tag):
            element.set(key, prefix + element.attrib[key])
    return ET.tostring(robot, encoding='unicode', xml_declaration=True) + '\n'


def _axis(writer: '_Writer', arm: int, parameters: Parameters) -> None:
    d, motor = parameters.dynamics, parameters.motor
    joint = writer.joint(DRIVES[arm - 1], 'revolute', f'arm{arm}', f'motor{arm}', (0.0, 0.0, 0.0))
    ET.SubElement(joint, 'axis', xyz=_text(Y))
    ET.SubElement(
        joint,
        'limit',
        lower=repr(math.radians(d.end_stop_min_deg)),
        upper=repr(math.radians(d.end_stop_max_deg)),
        effort=repr(d.gear_ratio * motor.torque_constant_n_m_a * motor.peak_current_a),
        velocity=repr(motor.max_speed_rad_s / d.gear_ratio),
    )
    ET.SubElement(
        joint,
        'dynamics',
        damping=repr(d.gear_ratio**2 * motor.viscous_friction_n_m_s_rad),
        friction=repr(d.gear_ratio * motor.static_friction_n_m),
    )


def _tool(writer: '_Writer', parameters: Parameters) -> None:
    """Add the tool on the plate; each rotary axis turns it relative to the axis before."""
    axes = tool_bar.bodies(parameters)
    if not axes:
        writer.fixed('tool', 'plate', (0.0, 0.0, 0.0))
        return
    writer.fixed(tool_bar.MOTOR, 'base', (0.0, 0.0, 0.0))
    parent = 'plate'
    for axis, body, rotary in axes:
        _add_rotary(writer.joint(axis, 'revolute', body, parent, (0.0, 0.0, 0.0)), rotary)
        parent = body
    writer.fixed('pointer', 'tool', (0.0, 0.0, 0.0))


def _add_rotary(joint: ET.Element, rotary: Rotary) -> None:
    """Add direction, limits and friction of a rotary axis to its joint."""
    ET.SubElement(joint, 'axis', xyz=_text(Z))
    ET.SubElement(
        joint,
        'limit',
        lower=repr(math.radians(rotary.angle_min_deg)),
        upper=repr(math.radians(rotary.angle_max_deg)),
        effort=repr(rotary.gear_ratio * rotary.torque_constant_n_m_a * rotary.peak_current_a),
        velocity=repr(rotary.max_speed_rad_s / rotary.gear_ratio),
    )
    ET.SubElement(
        joint,
        'dynamics',
        damping=repr(rotary.gear_ratio**2 * rotary.viscous_friction_n_m_s_rad),
        friction=repr(rotary.gear_ratio * rotary.static_friction_n_m),
    )


class _Writer:
    """Builds a document of links and joints; shapes and masses are found by the name of the link."""

    def __init__(self, robot: ET.Element, parts: Sequence[Part], masses: dict[str, Inertia]) -> None:
        self.robot, self._masses = robot, masses
        self.parts = {part.name: part for part in parts}

    def link(self, name: str) -> None:
        """Add a link."""
        link = ET.SubElement(self.robot, 'link', name=name)
        part = self.parts.get(name)
        for shape in part.shapes if part else ():
            for kind in ('visual', 'collision'):
                element = ET.SubElement(link, kind)
                ET.SubElement(element, 'origin', xyz=_text(shape.position_m), rpy=_text(_rpy(shape)))
                ET.SubElement(element, 'geometry').append(_geometry(shape))
                if kind == 'visual' and part:
                    material = ET.SubElement(element, 'material', name=f'{name}_colour')
                    ET.SubElement(material, 'color', rgba=_text(part.colour))
        if name in self._masses:
            _add_inertia(link, self._masses[name])

    def joint(
        self, name: str, kind: str, child: str, parent: str, place: Sequence[float], yaw: float = 0.0
    ) -> ET.Element:
        """Add a link and its joint to the parent."""
        self.link(child)
        joint = ET.SubElement(self.robot, 'joint', name=name, type=kind)
        ET.SubElement(joint, 'parent', link=parent)
        ET.SubElement(joint, 'child', link=child)
        ET.SubElement(joint, 'origin', xyz=_text(place), rpy=_text((0.0, 0.0, yaw)))
        return joint

    def fixed(self, child: str, parent: str, place: Sequence[float], yaw: float = 0.0) -> None:
        """Add a link that is fixed to its parent."""
        self.joint(f'{child}_fixed', 'fixed', child, parent, place, yaw=yaw)

    def passive(
        self, name: str, child: str, parent: str, place: Sequence[float], axis: Sequence[float], limit: float
    ) -> None:
        """Add a link on a passive joint; the links of a universal joint have negligible mass."""
        if child not in self.parts:
            self._masses[child] = Inertia(TINY_KG, (0.0, 0.0, 0.0), (TINY_KG, TINY_KG, TINY_KG))
        joint = self.joint(name, 'revolute', child, parent, place)
        ET.SubElement(joint, 'axis', xyz=_text(axis))
        ET.SubElement(
            joint,
            'limit',
            lower=repr(-limit),
            upper=repr(limit),
            effort=repr(_PASSIVE_EFFORT_N_M),
            velocity=repr(_PASSIVE_SPEED_RAD_S),
        )


def _add_inertia(link: ET.Element, inertia: Inertia) -> None:
    inertial = ET.SubElement(link, 'inertial')
    ET.SubElement(inertial, 'origin', xyz=_text(inertia.centre_m), rpy='0 0 0')
    ET.SubElement(inertial, 'mass', value=repr(inertia.mass_kg))
    xx, yy, zz = map(repr, inertia.moments_kg_m2)
    ET.SubElement(inertial, 'inertia', ixx=xx, ixy='0', ixz='0', iyy=yy, iyz='0', izz=zz)


def _geometry(shape: Shape) -> ET.Element:
    match shape:
        case Box():
            return ET.Element('box', size=_text(shape.size_m))
        case Cylinder():
            return ET.Element('cylinder', radius=repr(shape.radius_m), length=repr(shape.length_m))
        case Sphere():
            return ET.Element('sphere', radius=repr(shape.radius_m))
    raise TypeError(f'URDF has no {shape.kind}')


def _rpy(shape: Shape) -> Sequence[float]:
    with warnings.catch_warnings():
        # for a cylinder along x the pitch is a right angle, where roll and yaw coincide: any such pair is valid
        warnings.simplefilter('ignore', UserWarning)
        return [float(angle) for angle in Rotation.from_quat(shape.quaternion).as_euler('xyz')]


def _text(numbers: Iterable[float]) -> str:
    return ' '.join(repr(float(number)) for number in numbers)
