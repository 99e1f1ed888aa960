"""The robot as MJCF, the format of MuJoCo: a closed chain that moves like the plant.

Arms are on hinges with the rotors' inertia and friction, each of the six rods on two hinges at its elbow, and the
plate is free. Six constraints connect the ends of the rods to their joints on the plate. The model starts at home with
closed loops; its joint angles are those of ``telegrams.joints_of``. ``ctrl`` of an axis is a torque on the arm side
[N m]. The tool of a rotary axis is attached to the plate by a rigid hinge with rotor, friction and limits; its ``ctrl``
is a torque at the tool.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from delta3_pacdrive import kinematics
from delta3_pacdrive.dynamics import rotor_inertia
from delta3_pacdrive.parameters import Parameters, Rotary
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.telegrams import JOINTS
from delta3_pacdrive.scene import tool_bar
from delta3_pacdrive.scene.joints import joints
from delta3_pacdrive.scene.masses import Inertia, masses
from delta3_pacdrive.scene.parts import ARMS, RODS, Part, Sizes, arm_of, parts
from delta3_pacdrive.scene.poses import frames
from delta3_pacdrive.scene.shapes import Box, Cylinder, Shape, Sphere


def mjcf(parameters: Parameters, *, rods: bool | None = None, step_s: float | None = None) -> str:
    """Return the robot as MJCF.

    Parameters
    ----------
    ----------
    parameters
        Robot with its payload.
    rods
        Whether forearms are uniform rods; default: ``rich.forearm_rods``.
    step_s
        Simulation step [s]; default: that of the plant.

    Returns
    -------
    str
        The document. Bodies have the names of the parts. The sites ``forearm1a_end`` and ``plate_1a`` and so on
        coincide; the site ``tcp`` is the TCP.

    Raises
    ------
    UnreachableError
        The initial position ``motion.home_m`` is unreachable.

    """
    step = parameters.drive.current_period_s if step_s is None else step_s
    model = _Model(parameters, rods)
    arms = '\n'.join(model.arm(arm) for arm in ARMS)
    # as stiff as MuJoCo permits: twice the step
    stiff = f'solref="{2.0 * step!r} 1" solimp="0.9999 0.9999 0.001"'
    loops = '\n'.join(
        f'    <connect name="loop{rod}" site1="forearm{rod}_end" site2="plate_{rod}" {stiff}/>'
        for rod in RODS
    )
    torque = (
        parameters.dynamics.gear_ratio
        * parameters.motor.torque_constant_n_m_a
        * parameters.motor.peak_current_a
    )
    motors = '\n'.join(
        f'    <motor name="{axis}" joint="{axis}" ctrllimited="true" ctrlrange="{-torque!r} {torque!r}"/>'
        for axis in DRIVES
    )
    motors += ''.join(map(_rotary_motor, tool_bar.bodies(parameters)))
    return f"""\
<mujoco model="delta3_pacdrive">
  <compiler angle="radian" inertiafromgeom="false"/>
  <option timestep="{step!r}" gravity="0 0 {-parameters.dynamics.gravity_m_s2!r}" integrator="implicitfast">
    <flag contact="disable"/>
  </option>
  <worldbody>
    <light pos="0 -1.5 1" dir="0 0.8 -1"/>
{model.base()}
{model.still('workspace', '    ')}
{arms}
{model.plate()}
  </worldbody>
  <equality>
{loops}
  </equality>
  <actuator>
{motors}
  </actuator>
</mujoco>
"""


class _Model:
    """Bodies of one robot at home."""

    def __init__(self, parameters: Parameters, rods: bool | None) -> None:
        self._parameters = parameters
        self._parts = {part.name: part for part in parts(parameters)}
        self._masses = masses(parameters, rods=rods)
        self._hip, self._joint = frames(parameters)
        self._home = np.array(parameters.motion.home_m)
        theta = kinematics.inverse(self._home, parameters)
        self._at_home = {
            name: float(angle) for name, angle in zip(JOINTS, joints(theta, parameters), strict=True)
        }

    def still(self, name: str, indent: str) -> str:
        """Return the geometry of a fixed part."""
        return '\n'.join(_geom(self._parts[name], shape, indent) for shape in self._parts[name].shapes)

    def base(self) -> str:
        """Return the base, with the motor of a rotary axis."""
        names = [name for name in ('base', tool_bar.MOTOR) if name in self._parts]
        return '\n'.join(self.still(name, '    ') for name in names)

    def arm(self, arm: int) -> str:
        """Return motor, upper arm and the two rods of a forearm."""
        k, d, motor = self._parameters.kinematics, self._parameters.dynamics, self._parameters.motor
        axis, angle = DRIVES[arm - 1], self._at_home[DRIVES[arm - 1]]
        low, high = math.radians(d.end_stop_min_deg), math.radians(d.end_stop_max_deg)
        joint = (
            f'<joint name="{axis}" axis="0 1 0" ref="{angle!r}" limited="true" range="{low!r} {high!r}"'
            f' armature="{rotor_inertia(self._parameters)!r}"'
            f' damping="{d.gear_ratio**2 * motor.viscous_friction_n_m_s_rad!r}"'
            f' frictionloss="{d.gear_ratio * motor.static_friction_n_m!r}"/>'
        )
        half = 0.5 * Sizes.of(k).rod_distance_m
        rods = '\n'.join(
            self._rod(f'{arm}{rod}', (k.upper_arm_lengths_m[arm - 1], side * half, 0.0))
            for side, rod in ((1, 'a'), (-1, 'b'))
        )
        turned = _quaternion(Rotation.from_euler('z', k.arm_azimuth_rad[arm - 1]))
        return f"""\
    <body name="motor{arm}" pos="{_text(self._hip[arm - 1])}" quat="{turned}">
{self.still(f'motor{arm}', '      ')}
      <body name="arm{arm}" quat="{_quaternion(Rotation.from_euler('y', angle))}">
        {joint}
{self._body(f'arm{arm}', '        ')}
{rods}
      </body>
    </body>"""

    def _rod(self, rod: str, elbow: Sequence[float]) -> str:
        name = f'forearm{rod}'
        pitch, swing = (self._at_home[f'{name}_{angle}'] for angle in ('pitch', 'swing'))
        # the axis of the first hinge is fixed in the arm; here it is expressed in the frame of the rod at home
        axis = _text((math.sin(swing), math.cos(swing), 0.0))
        end = _text((self._parameters.kinematics.forearm_lengths_m[arm_of(rod)], 0.0, 0.0))
        return f"""\
        <body name="{name}" pos="{_text(elbow)}" quat="{_quaternion(Rotation.from_euler('YZ', [pitch, swing]))}">
          <joint name="{name}_pitch" axis="{axis}" ref="{pitch!r}"/>
          <joint name="{name}_swing" axis="0 0 1" ref="{swing!r}"/>
{self._body(name, '          ')}
          <site name="{name}_end" pos="{end}"/>
        </body>"""

    def plate(self) -> str:
        """Return the plate with its tool and payload."""
        sites = '\n'.join(
            f'      <site name="plate_{rod}" pos="{_text(place)}"/>'
            for rod, place in zip(RODS, self._joint.reshape(-1, 3), strict=True)
        )
        payload = ''
        if 'payload' in self._parts:
            payload = f"""
      <body name="payload">
{self._body('payload', '        ')}
      </body>"""
        axes = tool_bar.bodies(self._parameters)
        tool, beside = (self._turning(axes, payload), '') if axes else (self.still('tool', '      '), payload)
        return f"""\
    <body name="plate" pos="{_text(self._home)}">
      <freejoint name="plate"/>
{self._body('plate', '      ')}
{tool}
      <site name="tcp"/>
{sites}{beside}
    </body>"""

    def _turning(self, axes: Sequence[tuple[str, str, Rotary]], payload: str) -> str:
        """Return the tool of a robot with rotary axes; each axis is a body in the one before, the last with payload."""
        inside = f'{self._body("tool", "        ")}\n{self.still("pointer", "        ")}{payload}'
        for axis, body, rotary in reversed(axes):
            low, high = math.radians(rotary.angle_min_deg), math.radians(rotary.angle_max_deg)
            joint = (
                f'<joint name="{axis}" axis="0 0 1" ref="{rotary.home_rad!r}" limited="true"'
                f' range="{low!r} {high!r}" armature="{rotary.gear_ratio**2 * rotary.rotor_inertia_kg_m2!r}"'
                f' damping="{rotary.gear_ratio**2 * rotary.viscous_friction_n_m_s_rad!r}"'
                f' frictionloss="{rotary.gear_ratio * rotary.static_friction_n_m!r}"/>'
            )
            own = '' if body in self._parts else f'        {_inertial(self._masses[body])}\n'
            inside = f"""\
      <body name="{body}" quat="{_quaternion(Rotation.from_euler('z', rotary.home_rad))}">
        {joint}
{own}{inside}
      </body>"""
        return inside

    def _body(self, name: str, indent: str) -> str:
        return f'{indent}{_inertial(self._masses[name])}\n{self.still(name, indent)}'


def _rotary_motor(turned: tuple[str, str, Rotary]) -> str:
    """Return the motor of a rotary axis, given as by ``tool_bar.bodies``."""
    axis, _, rotary = turned
    torque = rotary.gear_ratio * rotary.torque_constant_n_m_a * rotary.peak_current_a
    limits = f'ctrllimited="true" ctrlrange="{-torque!r} {torque!r}"'
    return f'\n    <motor name="{axis}" joint="{axis}" {limits}/>'


def _inertial(inertia: Inertia) -> str:
    centre, moments = _text(inertia.centre_m), _text(inertia.moments_kg_m2)
    return f'<inertial pos="{centre}" mass="{inertia.mass_kg!r}" diaginertia="{moments}"/>'


def _geom(part: Part, shape: Shape, indent: str) -> str:
    match shape:
        case Box():
            size = _text([0.5 * edge for edge in shape.size_m])
        case Cylinder():
            size = _text((shape.radius_m, 0.5 * shape.length_m))
        case Sphere():
            size = _text((shape.radius_m,))
        case _:
            raise TypeError(f'MJCF has no {shape.kind}')
    place = f'pos="{_text(shape.position_m)}" quat="{_quaternion(Rotation.from_quat(shape.quaternion))}"'
    return f'{indent}<geom type="{shape.kind}" size="{size}" {place} rgba="{_text(part.colour)}"/>'


def _quaternion(rotation: Rotation) -> str:
    """Return a rotation in MuJoCo's order, w first."""
    x, y, z, w = rotation.as_quat(canonical=True)
    return _text((w, x, y, z))


def _text(numbers: Iterable[float]) -> str:
    return ' '.join(repr(float(number)) for number in numbers)
