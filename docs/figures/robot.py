"""The picture of the robot: base, motors, arms, parallelograms and plate from its parameters, and one pick cycle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

import delta3_pacdrive as d3
from delta3_pacdrive.studies.framework.figure_style import AXIS_COLOURS, DPI

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from delta3_pacdrive.numerics.types import Floats

EYE_M = np.array([-1.25, -3.5, 0.45])  # from where the robot is seen
LOOK_M = np.array([0.0, 0.0, -0.45])
UP = np.array([0.0, 0.0, 1.0])
AT_X_M = 0.16  # where it is on its way when it is drawn
PICK_CYCLE = {
    'start_m': [-0.30, -0.05, -0.92],
    'moves': [
        {'move_l': {'to_m': [-0.30, -0.05, -0.80], 'blend_m': 0.07}},
        {'move_l': {'to_m': [0.30, -0.05, -0.80], 'blend_m': 0.07}},
        {'move_l': {'to_m': [0.30, -0.05, -0.92]}},
    ],
}

MOTOR_LENGTH_M, MOTOR_RADIUS_M = 0.17, 0.055
BASE_RADIUS_M, BASE_BOTTOM_M, BASE_TOP_M = 0.30, 0.075, 0.105
ARM_RADII_M = (0.045, 0.024)
ROD_RADIUS_M, BALL_RADIUS_M, ROD_DISTANCE_M = 0.008, 0.015, 0.12
PLATE_TOP_M, PLATE_BOTTOM_M, PLATE_CORNER_M = 0.012, -0.012, 0.035

STEEL, DARK, CARBON, FLOOR, LINE = '#C9CED6', '#8B93A0', '#2F343B', '#EEF2F6', '#5B6470'
PATH = '#7A3E9D'


class Camera:
    """Projects points of the frame ``base`` onto the picture, and knows how far away they are."""

    def __init__(self) -> None:
        ahead = LOOK_M - EYE_M
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, UP)
        right /= np.linalg.norm(right)
        self._axes = np.stack([right, np.cross(right, ahead), ahead])

    def see(self, points_m: Floats) -> tuple[Floats, Floats]:
        """Return places in the picture (n, 2) and distances (n,)."""
        x, y, depth = self._axes @ (np.atleast_2d(points_m) - EYE_M).T
        return np.stack([x, y], axis=1) / depth[:, None], depth


def circle(centre_m: Floats, across: Floats, up: Floats, radius_m: float, count: int = 72) -> Floats:
    """Return points of a circle in a plane."""
    angle = np.linspace(0.0, 2.0 * np.pi, count)[:, None]
    return centre_m + radius_m * (np.cos(angle) * across + np.sin(angle) * up)


def hull(places: Floats) -> Floats:
    """Return the convex hull of places in the picture."""
    from scipy.spatial import ConvexHull

    return places[ConvexHull(places).vertices]


class Picture:
    """Collects shapes and draws them from far to near."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._shapes: list[tuple[float, Floats, dict[str, object]]] = []

    def solid(self, points_m: Floats, colour: str, *, bias_m: float = 0.0, edge: str = 'white') -> None:
        """Add the outline of a convex body."""
        places, depth = self._camera.see(points_m)
        self._add(
            depth.mean() - bias_m, hull(places), {'facecolor': colour, 'edgecolor': edge, 'linewidth': 0.8}
        )

    def capsule(
        self, ends_m: Floats, radii_m: tuple[float, float], colour: str, *, bias_m: float = 0.0
    ) -> None:
        """Add a rod with round ends."""
        places, depth = self._camera.see(ends_m)
        angle = np.linspace(0.0, 2.0 * np.pi, 40)[:, None]
        ring = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
        around = np.concatenate([p + r / d * ring for p, r, d in zip(places, radii_m, depth, strict=True)])
        style = {'facecolor': colour, 'edgecolor': 'white', 'linewidth': 0.6}
        self._add(depth.mean() - bias_m, hull(around), style)

    def _add(self, depth: float, outline: Floats, style: dict[str, object]) -> None:
        self._shapes.append((depth, outline, style))

    def draw(self, axes: Axes) -> None:
        """Draw everything."""
        from matplotlib.patches import Polygon

        for order, (_, outline, style) in enumerate(sorted(self._shapes, key=lambda shape: -shape[0])):
            axes.add_patch(Polygon(outline, closed=True, joinstyle='round', zorder=10 + order, **style))


def make() -> Figure:
    """Draw the robot on its way through a pick cycle."""
    robot = d3.load_parameters()
    lengths = robot.kinematics
    trace = d3.simulate(d3.load_program(PICK_CYCLE, robot), robot)
    path = trace['tcp_command'][trace.meta['start_cycle'] : trace.meta['end_cycle']]
    tcp = path[np.argmax(path[:, 0] > AT_X_M)]
    theta = d3.kinematics.inverse(tcp, robot)

    figure = Figure(figsize=(8.0, 5.68), dpi=DPI, facecolor='white')
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_aspect('equal')
    axes.axis('off')
    camera = Camera()
    _draw_workspace(axes, camera, robot)
    _draw_path(axes, camera, path, robot)
    picture = Picture(camera)
    _add_base(picture, robot)
    for azimuth, angle, colour in zip(lengths.arm_azimuth_rad, theta, AXIS_COLOURS, strict=True):
        _add_arm(picture, robot, azimuth, angle, tcp, colour)
    _add_plate(picture, robot, tcp)
    picture.draw(axes)
    _label(axes, camera, robot, theta, tcp)
    axes.set(xlim=(-0.2, 0.3), ylim=(-0.192, 0.163))
    return figure


def outward(azimuth: float) -> tuple[Floats, Floats]:
    """Return the directions away from the centre, and along the axis of the motor."""
    return np.array([np.cos(azimuth), np.sin(azimuth), 0.0]), np.array(
        [-np.sin(azimuth), np.cos(azimuth), 0.0]
    )


def _add_base(picture: Picture, robot: d3.Parameters) -> None:
    corners = []
    for azimuth in robot.kinematics.arm_azimuth_rad:
        u, v = outward(azimuth)
        centre = robot.kinematics.base_radius_m * u
        corners += [centre + 0.10 * u + side * 0.13 * v for side in (-1.0, 1.0)]
        rim = [
            circle(centre + side * v, u, UP, MOTOR_RADIUS_M)
            for side in (-MOTOR_LENGTH_M / 2, MOTOR_LENGTH_M / 2)
        ]
        picture.solid(np.concatenate(rim), DARK, bias_m=-0.03)
        near = min(rim, key=lambda ring: np.linalg.norm(ring.mean(axis=0) - EYE_M))
        picture.solid(near, STEEL, bias_m=0.02)
    low, top = (np.array(corners) + z * UP for z in (BASE_BOTTOM_M, BASE_TOP_M))
    picture.solid(np.concatenate([low, top]), DARK, bias_m=0.4)
    picture.solid(top, STEEL, bias_m=0.41)


def _add_arm(
    picture: Picture, robot: d3.Parameters, azimuth: float, angle: float, tcp: Floats, colour: str
) -> None:
    lengths = robot.kinematics
    u, v = outward(azimuth)
    shoulder = lengths.base_radius_m * u
    elbow = shoulder + lengths.upper_arm_length_m * (np.cos(angle) * u - np.sin(angle) * UP)
    joint = tcp + lengths.plate_radius_m * u
    picture.capsule(np.stack([shoulder, elbow]), ARM_RADII_M, colour, bias_m=0.06)
    half = 0.5 * ROD_DISTANCE_M * v
    picture.capsule(np.stack([elbow - half, elbow + half]), (0.012, 0.012), CARBON)
    picture.capsule(np.stack([joint - half, joint + half]), (0.010, 0.010), CARBON)
    for side in (-half, half):
        ends = np.stack([elbow + side, joint + side])
        picture.capsule(ends, (ROD_RADIUS_M, ROD_RADIUS_M), CARBON)
        for end in ends:
            picture.capsule(np.stack([end, end + 1e-4]), (BALL_RADIUS_M, BALL_RADIUS_M), STEEL, bias_m=0.02)


def _add_plate(picture: Picture, robot: d3.Parameters, tcp: Floats) -> None:
    corners = []
    for azimuth in robot.kinematics.arm_azimuth_rad:
        u, v = outward(azimuth)
        corners += [
            tcp + (robot.kinematics.plate_radius_m + 0.012) * u + side * PLATE_CORNER_M * v
            for side in (-1, 1)
        ]
    low, top = (np.array(corners) + z * UP for z in (PLATE_BOTTOM_M, PLATE_TOP_M))
    picture.solid(np.concatenate([low, top]), DARK, bias_m=-0.01)
    picture.solid(top, STEEL)


def _draw_workspace(axes: Axes, camera: Camera, robot: d3.Parameters) -> None:
    lengths = robot.kinematics
    x, y = np.eye(3)[:2]
    rims = [
        camera.see(circle(np.array([0.0, 0.0, z]), x, y, lengths.workspace_diameter_m / 2.0))[0]
        for z in (lengths.workspace_bottom_m, lengths.workspace_top_m)
    ]
    axes.fill(*hull(np.concatenate(rims)).T, color='#F5F8FB', zorder=0)
    axes.fill(*rims[0].T, color='#E3EBF3', zorder=1)
    for rim, style in zip(rims, ('-', (0, (5, 3))), strict=True):
        axes.plot(*rim.T, color='#9AAABC', linewidth=1.0, linestyle=style, zorder=2)


def _draw_path(axes: Axes, camera: Camera, path: Floats, robot: d3.Parameters) -> None:
    shadow = path * [1.0, 1.0, 0.0] + [0.0, 0.0, robot.kinematics.workspace_bottom_m]
    axes.plot(*camera.see(shadow)[0].T, color='#B9C4D0', linewidth=3.0, solid_capstyle='round', zorder=3)
    axes.plot(*camera.see(path)[0].T, color=PATH, linewidth=2.2, solid_capstyle='round', zorder=5)


def _label(axes: Axes, camera: Camera, robot: d3.Parameters, theta: Floats, tcp: Floats) -> None:
    lengths = robot.kinematics
    u, _ = outward(lengths.arm_azimuth_rad[0])
    shoulder = lengths.base_radius_m * u
    elbow = shoulder + lengths.upper_arm_length_m * (np.cos(theta[0]) * u - np.sin(theta[0]) * UP)
    joint = tcp + lengths.plate_radius_m * u
    rim = np.array([0.94, -0.35, 0.0]) * lengths.workspace_diameter_m / 2.0 + [
        0.0,
        0.0,
        lengths.workspace_bottom_m,
    ]
    height = lengths.workspace_top_m - lengths.workspace_bottom_m
    motor = lengths.base_radius_m * outward(lengths.arm_azimuth_rad[1])[0]
    labels = [
        (motor, (-0.125, 0.0), 'motor,\nbrake, gear', 'right'),
        (
            0.4 * shoulder + 0.6 * elbow,
            (0.185, 0.0),
            f'upper arm\n$l_A$ = {lengths.upper_arm_length_m:g} m',
            'left',
        ),
        (
            0.5 * elbow + 0.5 * joint,
            (0.185, 0.0),
            f'forearm, two rods\n$l_B$ = {lengths.forearm_length_m:g} m',
            'left',
        ),
        (tcp + 0.03 * u, (0.185, 0.0), 'plate with the TCP', 'left'),
        (rim, (0.185, 0.0), f'workspace\n⌀ {lengths.workspace_diameter_m:g} m, {height:g} m high', 'left'),
    ]
    (middle,), _ = camera.see(np.array([-0.08, -0.05, -0.78]))
    axes.text(*middle, 'pick cycle', fontsize=12, color=PATH, ha='center', va='bottom', zorder=5)
    for point, (text_x, down), text, side in labels:
        (place,), _ = camera.see(np.asarray(point))
        axes.annotate(
            text,
            place,
            (text_x, place[1] + down),
            fontsize=12,
            color='#333A44',
            ha=side,
            va='center',
            zorder=300,
            arrowprops={'arrowstyle': '-', 'color': LINE, 'linewidth': 0.8, 'shrinkB': 0.0},
        )
