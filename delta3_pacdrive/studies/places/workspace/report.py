"""Report of a workspace study: JSON document, text, table, and files of the volume."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import ReportError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.capability import REACHED
from delta3_pacdrive.studies.framework.provenance import os_errors_as
from delta3_pacdrive.studies.framework.report_folder import Table
from delta3_pacdrive.studies.places.workspace.evaluation import LIMITS, QUANTITIES
from delta3_pacdrive.studies.places.workspace.study import Extreme, Grid, Quantity, Results, Settings

JSON_UNITS = {'': '', 'm': '_m', 'm/s': '_m_s', 'm/s2': '_m_s2', 'm/rad': '_m_rad', 'kg': '_kg'}
MM = 1e3


def key_of(quantity: Quantity) -> str:
    """Return the name of a quantity in results, including its unit."""
    return quantity.key + JSON_UNITS[quantity.unit]


def document(found: Results, settings: Settings, parameters: Parameters) -> dict[str, Any]:
    """Return the results for JSON."""
    payload, acceleration = assumed(settings, parameters)
    limit = found.volume.limit
    return {
        'ok': True,
        'resolution_m': settings.resolution_m,
        'shape': list(limit.shape),
        'poses': found.poses,
        'poses_in_reach': int((limit == REACHED).sum()),
        'seconds': found.seconds,
        'poses_per_s': found.poses / found.seconds,
        'payload_kg': payload,
        'acceleration_m_s2': acceleration,
        'quantities': {
            key_of(quantity): _extreme(found.extremes[quantity.key])
            for quantity in QUANTITIES
            if quantity.key in found.extremes
        },
        'beyond_limits': {
            LIMITS[code]: int((limit == code).sum()) for code in np.unique(limit).tolist() if code != REACHED
        },
    }


def assumed(settings: Settings, parameters: Parameters) -> tuple[float, float]:
    """Return the payload [kg] assumed for accelerations and the acceleration [m/s^2] assumed for payloads."""
    acceleration = settings.acceleration_m_s2
    default = parameters.motion.acceleration_max_m_s2
    return parameters.dynamics.payload_mass_kg, default if acceleration is None else acceleration


def _extreme(one: Extreme) -> dict[str, Any]:
    return {
        'least': one.least,
        'least_at_m': list(one.least_at_m),
        'median': one.median,
        'largest': one.largest,
        'largest_at_m': list(one.largest_at_m),
    }


def text(found: Results, settings: Settings, parameters: Parameters) -> list[str]:
    """Return the results as text."""
    inside = int((found.volume.limit == REACHED).sum())
    rate = found.poses / found.seconds / 1e6
    payload, acceleration = assumed(settings, parameters)
    lines = [
        f'{found.poses} poses, {MM * settings.resolution_m:g} mm apart, in {found.seconds:.2f} s '
        f'({rate:.2f} M poses/s); the robot may be at {inside} of them',
        f'accelerations with {payload:g} kg, payloads with {acceleration:g} m/s2',
        f'{"":>62} {"least":>9} {"median":>9} {"largest":>9}   worst at (mm)',
    ]
    for quantity in QUANTITIES:
        if quantity.key not in found.extremes:
            continue
        one = found.extremes[quantity.key]
        name = f'{quantity.title} ({quantity.shown_unit})' if quantity.shown_unit else quantity.title
        x, y, z = (
            round(MM * value) for value in (one.largest_at_m if quantity.worst_is_large else one.least_at_m)
        )
        values = ' '.join(f'{quantity.scale * value:9.4g}' for value in (one.least, one.median, one.largest))
        lines.append(f'{name:>62} {values}   ({x}, {y}, {z})')
    return lines


def extremes_table(found: Results) -> Table:
    """Return the table of extremes."""
    header = [
        'quantity',
        'unit',
        'least',
        'x [m]',
        'y [m]',
        'z [m]',
        'median',
        'largest',
        'x [m]',
        'y [m]',
        'z [m]',
    ]
    rows = []
    for quantity in QUANTITIES:
        if (one := found.extremes.get(quantity.key)) is not None:
            values = [one.least, *one.least_at_m, one.median, one.largest, *one.largest_at_m]
            rows.append([quantity.key, quantity.unit, *values])
    return Table('extremes.csv', header, rows)


def volume_columns(volume: Grid) -> dict[str, Any]:
    """Return the volume as columns, one row per position in reach of the arms."""
    x, y, z = np.meshgrid(volume.x_m, volume.y_m, volume.z_m, indexing='ij')
    reached = np.isfinite(volume.values['condition'])
    columns = {'x [m]': x[reached], 'y [m]': y[reached], 'z [m]': z[reached], 'limit': volume.limit[reached]}
    for quantity in QUANTITIES:
        name = f'{quantity.key} [{quantity.unit}]' if quantity.unit else quantity.key
        columns[name] = volume.values[quantity.key][reached]
    return columns


def require_writable_volume(path: Path) -> None:
    """Raise ReportError if the file of a volume cannot be written; called before the computation."""
    if reason := whole_file.file_refusal(path, folder_is_made=True):
        raise ReportError(f'cannot write {path}: {reason}')


def save_volume(volume: Grid, path: Path, meta: Mapping[str, str]) -> Path:
    """Write the volume as ``.npz``: axes, quantities with units in their names, and the codes of limits.

    Raises
    ------
    ReportError
        The file cannot be written.

    """
    arrays: dict[str, Any] = {'x_m': volume.x_m, 'y_m': volume.y_m, 'z_m': volume.z_m, 'limit': volume.limit}
    for quantity in QUANTITIES:
        arrays[key_of(quantity)] = volume.values[quantity.key].astype(np.float32)
    about = {'limits': list(LIMITS), **meta}
    with os_errors_as(f'cannot write {path}'):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file.atomic_path(path) as partial, partial.open('wb') as file:
            np.savez_compressed(file, about=np.array(json.dumps(about)), **arrays)
    return path
