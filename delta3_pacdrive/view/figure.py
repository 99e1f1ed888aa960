"""The robot in 3D: meshes of its parts in a viser scene, their poses, and a ghost of the commanded pose."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.scene import tool_bar
from delta3_pacdrive.scene.joints import joints
from delta3_pacdrive.scene.parts import ARMS, Part, Sizes, parts
from delta3_pacdrive.scene.poses import frames, poses
from delta3_pacdrive.scene.shapes import Box, Cylinder, Shape, Sphere
from delta3_pacdrive.view.values import Instant, tool_angle_rad

SECTIONS, SUBDIVISIONS = 24, 2  # of cylinders and spheres
RING_POINTS = 96
LINE, THIN_LINE = 3.0, 1.5  # pixels
GHOST_OPACITY = 0.35
BLUE, RED = (58, 134, 255), (230, 40, 50)
PLANNED, TRAVELLED = (150, 156, 166), (245, 130, 30)
_WXYZ = [3, 0, 1, 2]


def mesh_of(shapes: Sequence[Shape]) -> tuple[Floats, Any]:
    """Return vertices (n, 3) [m] and faces (m, 3) of all shapes of a part."""
    import trimesh

    solids = []
    for shape in shapes:
        match shape:
            case Box():
                solid = trimesh.creation.box(shape.size_m)
            case Cylinder():
                solid = trimesh.creation.cylinder(shape.radius_m, shape.length_m, sections=SECTIONS)
            case Sphere():
                solid = trimesh.creation.icosphere(SUBDIVISIONS, shape.radius_m)
            case _:
                raise TypeError(f'there is no mesh for a {shape.kind}')
        place = trimesh.transformations.quaternion_matrix([shape.quaternion[n] for n in _WXYZ])
        place[:3, 3] = shape.position_m
        solid.apply_transform(place)
        solids.append(solid)
    whole = trimesh.util.concatenate(solids)
    return np.asarray(whole.vertices), np.asarray(whole.faces)


def segments(points: Floats) -> Floats:
    """Return the segments (n - 1, 2, 3) of a polyline (n, 3), or one of length zero for fewer than two points."""
    if len(points) < 2:
        return np.zeros((1, 2, 3))
    return np.stack([points[:-1], points[1:]], axis=1)


def rgb(part: Part) -> tuple[int, int, int]:
    """Return the colour of a part, 0 to 255."""
    red, green, blue = (round(255 * value) for value in part.colour[:3])
    return red, green, blue


def about_zy(z_rad: float, y_rad: float) -> tuple[float, float, float, float]:
    """Return the rotation R_z R_y as a quaternion, w first."""
    cz, sz, cy, sy = math.cos(z_rad / 2), math.sin(z_rad / 2), math.cos(y_rad / 2), math.sin(y_rad / 2)
    return cz * cy, -sz * sy, cz * sy, sz * cy


def about_yz(y_rad: float, z_rad: float) -> tuple[float, float, float, float]:
    """Return the rotation R_y R_z as a quaternion, w first."""
    cz, sz, cy, sy = math.cos(z_rad / 2), math.sin(z_rad / 2), math.cos(y_rad / 2), math.sin(y_rad / 2)
    return cy * cz, sy * sz, sy * cz, cy * sz


class _Body:
    """Arms, rods and plate of one robot, in its colours or as a ghost; rods are children of their arms."""

    def __init__(
        self,
        scene: Any,
        name: str,
        named: dict[str, Part],
        parameters: Parameters,
        ghost: tuple[int, int, int] | None,
    ) -> None:
        self._scene, self._name, self._ghost = scene, name, ghost
        self._look: dict[str, Any] = {'cast_shadow': False, 'receive_shadow': False}
        if ghost is not None:
            self._look['opacity'] = GHOST_OPACITY
        self._azimuth = parameters.kinematics.arm_azimuth_rad
        hip, _ = frames(parameters)
        half = 0.5 * Sizes.of(parameters.kinematics).rod_distance_m
        elbows = parameters.kinematics.upper_arm_lengths_m
        self._plate = scene.add_frame(f'/{name}/plate', show_axes=False)
        self._mesh(f'/{name}/plate/plate', named['plate'], np.zeros(3))
        self._hand, self._turned, self._bar = f'/{name}/plate', None, []
        if tool_bar.MOTOR in named:
            self._hand += '/turned'
            self._turned = scene.add_frame(self._hand, show_axes=False)
            self.carry('pointer', named['pointer'])
            self._bar = [
                self._mesh(f'/{name}/{part}', named[part], np.zeros(3)) for part in ('bar_tube', 'bar_rod')
            ]
            height = Sizes.of(parameters.kinematics).tool_height_m
            self._top = np.array([0.0, 0.0, tool_bar.top_m(height)])
        self.carry('tool', named['tool'])
        self._arms, self._rods = [], []
        for arm in ARMS:
            path = f'/{name}/arm{arm}'
            self._arms.append(self._mesh(path, named[f'arm{arm}'], hip[arm - 1]))
            for side, rod in ((half, f'forearm{arm}a'), (-half, f'forearm{arm}b')):
                joint = np.array([elbows[arm - 1], side, 0.0])
                self._rods.append(self._mesh(f'{path}/{rod}', named[rod], joint))

    def _mesh(self, path: str, part: Part, position: Floats) -> Any:
        vertices, faces = mesh_of(part.shapes)
        colour = self._ghost or rgb(part)
        return self._scene.add_mesh_simple(
            path, vertices, faces, color=colour, position=position, **self._look
        )

    def carry(self, name: str, part: Part) -> Any:
        """Attach a part to the plate, or to the tool that rotates below it."""
        return self._mesh(f'{self._hand}/{name}', part, np.zeros(3))

    def place(self, joints_rad: Floats, tcp_m: Floats, turn_rad: float) -> None:
        """Set all joint angles (order of ``scene.joints``), the plate position and the tool angle.

        Arms are hidden if they cannot reach the plate.
        """
        self._plate.visible = True
        self._plate.position = tcp_m
        if self._turned is not None:
            self._turned.wxyz = about_zy(turn_rad, 0.0)
            tube, rod = self._bar
            top = tcp_m + self._top
            tube.visible = rod.visible = True
            tube.wxyz = rod.wxyz = tool_bar.directed(top[None], np.array([turn_rad]))[0, _WXYZ]
            rod.position = top
        reached = bool(np.isfinite(joints_rad).all())
        angles = joints_rad.tolist()
        for arm, azimuth, angle in zip(self._arms, self._azimuth, angles, strict=False):
            arm.visible = reached
            if reached:
                arm.wxyz = about_zy(azimuth, angle)
        if reached:
            for n, rod in enumerate(self._rods):
                rod.wxyz = about_yz(*angles[3 + 2 * n : 5 + 2 * n])

    def hide(self) -> None:
        """Hide it."""
        for handle in (self._plate, *self._arms, *self._bar):
            handle.visible = False


class Figure:
    """The robot, its ghost, its workspace and its paths in a scene."""

    def __init__(self, scene: Any, parameters: Parameters) -> None:
        self._scene, self._parameters = scene, parameters
        self._payload_kg = 0.0
        self._payload: Any = None
        named = {part.name: part for part in parts(parameters, 1.0)}
        hip, _ = frames(parameters)
        self._add_fixed(named, hip)
        self.body = _Body(scene, 'robot', named, parameters, None)
        self.ghost = _Body(scene, 'ghost', named, parameters, BLUE)
        self.ghost.hide()
        nothing = np.zeros((1, 2, 3))
        line: dict[str, Any] = {'thickness_units': 'screen'}
        self.planned = scene.add_line_segments('/path/planned', nothing, PLANNED, thickness=THIN_LINE, **line)
        self.travelled = scene.add_line_segments(
            '/path/travelled', nothing, TRAVELLED, thickness=LINE, **line
        )
        self.error = scene.add_line_segments('/error', nothing, RED, thickness=LINE, **line)
        self._mark(hip)

    def _add_fixed(self, named: dict[str, Part], hip: Floats) -> None:
        """Add the fixed parts, the workspace and the floor."""
        scene, k = self._scene, self._parameters.kinematics
        where = poses(np.zeros(3), self._parameters, unreachable='nan')
        for name in ('base', *(name for name in named if name.startswith('motor'))):
            position, quaternion = where.of(name)
            vertices, faces = mesh_of(named[name].shapes)
            scene.add_mesh_simple(
                f'/robot/{name}',
                vertices,
                faces,
                color=rgb(named[name]),
                position=position,
                wxyz=quaternion[_WXYZ],
            )
        air = named['workspace']
        vertices, faces = mesh_of(air.shapes)
        self.workspace = [
            scene.add_mesh_simple(
                '/workspace/air', vertices, faces, color=rgb(air), opacity=air.colour[3],
                cast_shadow=False, receive_shadow=False,
            )
        ]  # fmt: skip
        turn = np.linspace(0.0, 2.0 * np.pi, RING_POINTS + 1)
        ring = 0.5 * k.workspace_diameter_m * np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=-1)
        edges = [segments(ring + np.array([0.0, 0.0, z])) for z in (k.workspace_top_m, k.workspace_bottom_m)]
        self.workspace.append(
            scene.add_line_segments(
                '/workspace/edge',
                np.concatenate(edges),
                rgb(air),
                thickness=THIN_LINE,
                thickness_units='screen',
            )
        )
        size = 2.0 * float(np.abs(hip).max()) + 2.0 * k.upper_arm_length_m + k.workspace_diameter_m
        scene.add_grid(
            '/floor', size, size, cell_size=0.1, section_size=0.5, cell_thickness=0.5, section_thickness=1.0,
            position=(0.0, 0.0, k.workspace_bottom_m - 0.1 * k.upper_arm_length_m), cell_color=(150, 154, 162),
            section_color=(120, 124, 134),
        )  # fmt: skip

    def _mark(self, hip: Floats) -> None:
        """Add the labels of the axes, and the markers of faults."""
        k = self._parameters.kinematics
        radius = 0.2 * k.upper_arm_length_m
        outward = hip / np.linalg.norm(hip, axis=1, keepdims=True)
        places = hip + 1.2 * radius * outward + [0.0, 0.0, 1.8 * radius]
        self.labels = [
            self._scene.add_label(f'/labels/axis{arm}', f'axis {arm}', position=place, anchor='bottom-center')
            for arm, place in zip(ARMS, places, strict=True)
        ]
        length = 0.3 * k.upper_arm_length_m
        self.axes = [
            self._scene.add_frame(
                '/labels/base',
                axes_length=length,
                axes_radius=0.02 * length,
                position=(0.0, 0.0, length),
            )
        ]
        for name, direction in (('x', (1.2, 0.0, 0.0)), ('y', (0.0, 1.2, 0.0)), ('z', (0.0, 0.0, 1.2))):
            place = length * np.array(direction)
            self.axes.append(
                self._scene.add_label(f'/labels/base/{name}', name, position=place, anchor='center-center')
            )
        where = {f'axis{arm}': place for arm, place in zip(ARMS, hip, strict=True)}
        where['robot'] = np.array([0.0, 0.0, radius])
        self._alarms = {
            name: self._scene.add_icosphere(
                f'/alarm/{name}',
                radius,
                color=RED,
                opacity=0.55,
                position=place,
                visible=False,
                cast_shadow=False,
            )
            for name, place in where.items()
        }
        self._sentence = self._scene.add_label(
            '/alarm/sentence', '', position=(0.0, 0.0, 3.0 * radius), visible=False, anchor='bottom-center'
        )
        self._alarm_places = where

    def place(
        self,
        theta_rad: Floats,
        tcp_m: Floats,
        ghost_m: Floats | None,
        turns_rad: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Pose the robot and its ghost, for given arm angles, TCPs and tool angles."""
        angles = np.asarray(theta_rad, dtype=np.float64)[None]
        if ghost_m is not None:
            ghost_rad = kinematics.inverse(ghost_m, self._parameters, unreachable='nan')
            angles = np.stack([angles[0], ghost_rad])
        # if the arms cannot reach the ghost, only its plate is visible
        known = np.isfinite(angles).all(axis=1, keepdims=True)
        turned = joints(np.where(known, angles, 0.0), self._parameters, unreachable='nan')
        turned = np.where(known, turned, np.nan)
        self.body.place(turned[0], tcp_m, turns_rad[0])
        if ghost_m is None:
            self.ghost.hide()
            self.error.visible = False
            return
        self.ghost.place(turned[1], ghost_m, turns_rad[1])
        self.error.visible = True
        self.error.points = np.stack([tcp_m, ghost_m])[None].astype(np.float32)

    def carry(self, payload_kg: float) -> None:
        """Set the gripped payload."""
        if payload_kg == self._payload_kg:
            return
        self._payload_kg = payload_kg
        if self._payload is not None:
            self._payload.remove()
            self._payload = None
        if payload_kg > 0.0:
            named = {part.name: part for part in parts(self._parameters, payload_kg)}
            self._payload = self.body.carry('payload', named['payload'])

    def alarm(self, sources: Sequence[str], sentence: str, lit: bool) -> None:
        """Flash the source of a fault, with its message; an empty message clears it."""
        known = [source for source in sources if source in self._alarms] or ['robot']
        for name, handle in self._alarms.items():
            handle.visible = bool(sentence) and lit and name in known
        self._sentence.visible = bool(sentence)
        if sentence:
            place = self._alarm_places[known[0]]
            height = 0.7 * self._parameters.kinematics.upper_arm_length_m
            self._sentence.position = (float(place[0]), float(place[1]), float(place[2]) + height)
            self._sentence.text = sentence


FAR_M, FAR_RAD = 0.4, 1.5  # maximum displacement, whatever the magnification
NEAR_M, NEAR_RAD = 5e-4, 0.02  # minimum displacement: a nearer ghost would only tint the robot
COMMAND, TRUE = 'command', 'true'
KINDS = (COMMAND, TRUE, 'none')


def ghost_of(
    instant: Instant, tcp_m: Floats, error_m: Floats, kind: str, magnification: float
) -> tuple[Floats, float] | None:
    """Return TCP [m], shape (3,), and tool angle [rad] of the ghost; None without a visible error.

    Parameters
    ----------
    instant
        State of the robot.
    tcp_m, error_m
        Its TCP, and the TCP error, command minus actual [m], shape (3,).
    kind
        One of ``KINDS``: the pose that the ghost shows.
    magnification
        Factor of the error.

    """
    away, off = None, 0.0
    if kind == COMMAND:
        away, off = error_m, sum((turn.error_rad for turn in instant.turns), 0.0)
    elif kind == TRUE and instant.true_m is not None:
        away = instant.true_m - tcp_m
        off = sum(
            (turn.true_rad - turn.angle_rad for turn in instant.turns if turn.true_rad is not None), 0.0
        )
    if away is None or not np.isfinite(away).all():
        return None
    away, off = magnification * away, max(-FAR_RAD, min(magnification * off, FAR_RAD))
    length = float(np.linalg.norm(away))
    if length < NEAR_M and abs(off) < NEAR_RAD:
        return None
    share = min(1.0, FAR_M / length) if length > 0.0 else 0.0
    return np.asarray(tcp_m + away * share), off + tool_angle_rad(instant.turns)
