"""Grids of positions and the capability of the robot there."""

import math
import time
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.errors import ReportError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.capability import CODES, OUT_OF_REACH, REACHED, Capability, capability
from delta3_pacdrive.planning.limits.joint_forces import joint_forces
from delta3_pacdrive.planning.limits.limits import OF_WORKSPACE, Limit
from delta3_pacdrive.studies.framework.columns import key_of_unit
from delta3_pacdrive.studies.framework.study import OnProgress, silent
from delta3_pacdrive.studies.places.workspace.study import Extreme, Grid, Quantity, Results, Settings, Slice

POSES_MAX = 20_000_000  # of a volume: 2 GB of results
SLICE_POINTS = 241  # along the longer side of a slice
BEYOND = 1.35  # extent of a slice relative to the workspace
QUANTITIES = (
    Quantity('condition', 'condition of the Jacobian', worst_is_large=True),
    Quantity('singular_min', 'smallest singular value of the Jacobian', 'm/rad', 'm/rad'),
    Quantity('serial', 'distance from the serial singularity, least of the arms'),
    Quantity('parallel', 'distance from the parallel singularity'),
    Quantity('speed', 'TCP speed in every direction', 'm/s', 'm/s'),
    Quantity('acceleration', 'TCP acceleration in every direction at peak torque', 'm/s2', 'm/s2'),
    Quantity(
        'acceleration_nominal', 'TCP acceleration in every direction at nominal current', 'm/s2', 'm/s2'
    ),
    Quantity('payload', 'payload within the limit of the robot', 'kg', 'kg'),
    Quantity('payload_held', 'payload held at rest by nominal current and brakes', 'kg', 'kg'),
    Quantity('payload_peak', 'payload accelerated at peak torque', 'kg', 'kg'),
    Quantity('increment', 'TCP motion for one increment of each motor', 'm', 'um', worst_is_large=True),
)
FORCES = (  # with ``Settings.forces``
    Quantity('rod_force', 'force in a rod, accelerated along x, y or z', 'N', 'N', worst_is_large=True),
    Quantity(
        'spring_force',
        'spring force that keeps the joints closed, accelerated along x, y or z',
        'N',
        'N',
        worst_is_large=True,
    ),
)
_CODES = {
    REACHED: 'the robot may be here',
    OUT_OF_REACH: 'out of reach',
    CODES[Limit.ARM_ANGLE_MAX]: 'largest arm angle',
    CODES[Limit.ARM_ANGLE_MIN]: 'smallest arm angle',
    CODES[Limit.FOREARM_SWING]: 'forearm swing',
    CODES[Limit.SERIAL_SINGULARITY]: 'serial singularity',
    CODES[Limit.PARALLEL_SINGULARITY]: 'parallel singularity',
    CODES[Limit.RADIUS]: 'rim of the workspace',
    CODES[Limit.TOP]: 'top of the workspace',
    CODES[Limit.BOTTOM]: 'bottom of the workspace',
}
LIMITS = tuple(_CODES[code] for code in range(len(_CODES)))


def values_of(found: Capability) -> dict[str, Floats]:
    """Return the mapped quantities by their keys."""
    values = {
        quantity.key: getattr(found, quantity.key + key_of_unit(quantity.unit)) for quantity in QUANTITIES
    }
    return values | {'serial': found.serial.min(axis=-1)}


def mapped(grid: Grid) -> list[Quantity]:
    """Return the quantities of a grid."""
    return [quantity for quantity in (*QUANTITIES, *FORCES) if quantity.key in grid.values]


def forces_at(points: Floats, acceleration_m_s2: float, parameters: Parameters) -> dict[str, Floats]:
    """Return the forces of ``FORCES`` at positions (..., 3) for an acceleration from rest.

    The acceleration has its six directions along the axes. In a direction between them its part of a force in a rod is
    at most sqrt(3) times as large.
    """
    flat = points.reshape(-1, 3)
    rod_n, spring_n = np.zeros(len(flat)), np.zeros(len(flat))
    for direction in (*np.eye(3), *-np.eye(3)):
        moved = np.broadcast_to(acceleration_m_s2 * direction, flat.shape)
        found = joint_forces(flat, np.zeros_like(flat), moved, parameters)
        rod_n = np.maximum(rod_n, np.abs(found.rod_n).max(axis=(1, 2)))
        spring_n = np.maximum(spring_n, found.spring_n.max(axis=1))
    shape = points.shape[:-1]
    return {'rod_force': rod_n.reshape(shape), 'spring_force': spring_n.reshape(shape)}


def default_slices(parameters: Parameters) -> tuple[Slice, ...]:
    """Return the slices at top and bottom of the workspace, and the plane of arm 1."""
    k = parameters.kinematics
    return Slice(2, k.workspace_top_m), Slice(2, k.workspace_bottom_m), Slice(1, 0.0)


def study(settings: Settings, parameters: Parameters, on_progress: OnProgress = silent) -> Results:
    """Map the workspace; raises ReportError for a volume with too many poses."""
    poses = require_few_poses(settings, parameters)
    x, y, z = axes(settings.resolution_m, parameters)
    started = time.perf_counter()
    layers = []
    for n, height in enumerate(z.tolist()):
        on_progress('volume', n, len(z))
        layers.append(_layer((x, y, np.array([height])), settings, parameters))
    volume = _stacked(layers, z)
    seconds = time.perf_counter() - started
    slices = []
    for n, plane in enumerate(settings.slices):
        on_progress('slices', n, len(settings.slices))
        slices.append(_layer(plane_axes(plane, parameters), settings, parameters))
    extremes = {
        quantity.key: extreme(volume, quantity.key)
        for quantity in mapped(volume)
        if (volume.limit == REACHED).any()
    }
    return Results(volume, tuple(slices), extremes, poses, seconds)


def require_few_poses(settings: Settings, parameters: Parameters) -> int:
    """Return the number of poses of a volume without computing them; raises ReportError if there are too many."""
    poses = math.prod(len(axis) for axis in axes(settings.resolution_m, parameters))
    if poses > POSES_MAX:
        raise ReportError(
            f'a resolution of {1e3 * settings.resolution_m:g} mm gives {poses} poses, the limit is {POSES_MAX}'
        )
    return poses


def require_reached(slices: Iterable[Slice], parameters: Parameters) -> None:
    """Raise ReportError for a slice without any reachable position."""
    for plane in slices:
        points = np.stack(np.meshgrid(*plane_axes(plane, parameters), indexing='ij'), axis=-1)
        if not is_legal_for_the_arms(capability(points, parameters).limit).any():
            raise ReportError(f'the arms do not reach any position of the slice {plane.name}')


def warm_up(parameters: Parameters) -> None:
    """Load the kernels, so that measured times do not include it."""
    capability(parameters.motion.home_m, parameters)


def axes(resolution_m: float, parameters: Parameters) -> tuple[Floats, Floats, Floats]:
    """Return the coordinates of a grid in the box around the workspace, including its boundary."""
    k = parameters.kinematics
    side = _even(-0.5 * k.workspace_diameter_m, 0.5 * k.workspace_diameter_m, resolution_m)
    return side, side.copy(), _even(k.workspace_bottom_m, k.workspace_top_m, resolution_m)


def _even(low: float, high: float, step: float) -> Floats:
    return np.linspace(low, high, max(math.ceil((high - low) / step - 1e-9), 1) + 1)


def plane_axes(plane: Slice, parameters: Parameters) -> tuple[Floats, Floats, Floats]:
    """Return the coordinates of a slice that extends beyond the workspace."""
    k = parameters.kinematics
    reach = 0.5 * BEYOND * k.workspace_diameter_m
    rise = reach - 0.5 * k.workspace_diameter_m
    side = np.linspace(-reach, reach, SLICE_POINTS)
    low, high = k.workspace_bottom_m - rise, k.workspace_top_m + rise
    height = np.linspace(low, high, max(int(SLICE_POINTS * (high - low) / (2.0 * reach)), 2))
    coordinates = [side, side.copy(), height]
    coordinates[plane.axis] = np.array([plane.position_m])
    return coordinates[0], coordinates[1], coordinates[2]


def _layer(coordinates: tuple[Floats, Floats, Floats], settings: Settings, parameters: Parameters) -> Grid:
    points = np.stack(np.meshgrid(*coordinates, indexing='ij'), axis=-1)
    found = capability(points, parameters, acceleration_m_s2=settings.acceleration_m_s2)
    legal = is_legal_for_the_arms(found.limit)
    values = values_of(found)
    if settings.forces:
        wanted = settings.acceleration_m_s2
        acceleration = parameters.motion.acceleration_max_m_s2 if wanted is None else wanted
        values |= forces_at(points, acceleration, parameters)
    values = {key: np.where(legal, value, np.nan) for key, value in values.items()}
    return Grid(*coordinates, values, found.limit)


def is_legal_for_the_arms(limit: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return where the limits of the arms are kept, also outside the workspace cylinder."""
    return np.isin(limit, [REACHED, *(CODES[key] for key in OF_WORKSPACE)])


def _stacked(layers: list[Grid], z: Floats) -> Grid:
    values: dict[str, Any] = {
        key: np.concatenate([layer.values[key] for layer in layers], axis=2) for key in layers[0].values
    }
    limit = np.concatenate([layer.limit for layer in layers], axis=2)
    return Grid(layers[0].x_m, layers[0].y_m, z, values, limit)


def extreme(grid: Grid, key: str) -> Extreme:
    """Return the extremes of a quantity over the positions that the robot may take."""
    values = np.where(grid.limit == REACHED, grid.values[key], np.nan)

    def position(index: Any) -> tuple[float, float, float]:
        i, j, k = np.unravel_index(int(index), values.shape)
        return float(grid.x_m[i]), float(grid.y_m[j]), float(grid.z_m[k])

    least, largest = np.nanargmin(values), np.nanargmax(values)
    return Extreme(
        least=float(values.flat[least]),
        least_at_m=position(least),
        median=float(np.nanmedian(values)),
        largest=float(values.flat[largest]),
        largest_at_m=position(largest),
    )
