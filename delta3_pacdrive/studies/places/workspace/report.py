"""Report of a workspace study: JSON document, text, table, and files of the volume."""

import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import ReportError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.capability import REACHED
from delta3_pacdrive.studies.framework.columns import TextColumn, in_unit, key_of_unit, text_table, to_dict
from delta3_pacdrive.studies.framework.provenance import os_errors_as
from delta3_pacdrive.studies.framework.report_folder import Table
from delta3_pacdrive.studies.places.workspace.evaluation import LIMITS, mapped
from delta3_pacdrive.studies.places.workspace.study import Grid, Quantity, Results, Settings

MM = 1e3


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
            quantity.key + key_of_unit(quantity.unit): to_dict(found.extremes[quantity.key])
            for quantity in mapped(found.volume)
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


def text(found: Results, settings: Settings, parameters: Parameters) -> list[str]:
    """Return the results as text."""
    inside = int((found.volume.limit == REACHED).sum())
    rate = found.poses / found.seconds / 1e6
    payload, acceleration = assumed(settings, parameters)
    columns = [
        TextColumn('', lambda row: f'{row.title} ({row.shown_unit})' if row.shown_unit else row.title),
        *(TextColumn(name, partial(_shown, found, name)) for name in ('least', 'median', 'largest')),
        TextColumn(' worst at (mm)', partial(_worst, found), '<'),
    ]
    return [
        f'{found.poses} poses, {MM * settings.resolution_m:g} mm apart, in {found.seconds:.2f} s '
        f'({rate:.2f} M poses/s); the robot may be at {inside} of them',
        f'accelerations with {payload:g} kg, payloads with {acceleration:g} m/s2'
        + (', forces with both' if settings.forces else ''),
        *text_table([one for one in mapped(found.volume) if one.key in found.extremes], columns),
    ]


def _shown(found: Results, name: str, quantity: Quantity) -> str:
    return f'{in_unit(getattr(found.extremes[quantity.key], name), quantity.shown_unit):.4g}'


def _worst(found: Results, quantity: Quantity) -> str:
    one = found.extremes[quantity.key]
    x, y, z = (
        round(MM * value) for value in (one.largest_at_m if quantity.worst_is_large else one.least_at_m)
    )
    return f' ({x}, {y}, {z})'


def extremes_table(found: Results) -> Table:
    """Return the table of extremes."""
    point = ['x [m]', 'y [m]', 'z [m]']
    rows = []
    for quantity in mapped(found.volume):
        if (one := found.extremes.get(quantity.key)) is not None:
            values = [one.least, *one.least_at_m, one.median, one.largest, *one.largest_at_m]
            rows.append([quantity.key, quantity.unit, *values])
    return Table('extremes.csv', ['quantity', 'unit', 'least', *point, 'median', 'largest', *point], rows)


def volume_columns(volume: Grid) -> dict[str, Any]:
    """Return the volume as columns, one row per position in reach of the arms."""
    x, y, z = np.meshgrid(volume.x_m, volume.y_m, volume.z_m, indexing='ij')
    reached = np.isfinite(volume.values['condition'])
    columns = {'x [m]': x[reached], 'y [m]': y[reached], 'z [m]': z[reached], 'limit': volume.limit[reached]}
    for quantity in mapped(volume):
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
    for quantity in mapped(volume):
        arrays[quantity.key + key_of_unit(quantity.unit)] = volume.values[quantity.key].astype(np.float32)
    about = {'limits': list(LIMITS), **meta}
    with os_errors_as(f'cannot write {path}'):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file.atomic_path(path) as partial, partial.open('wb') as file:
            np.savez_compressed(file, about=np.array(json.dumps(about)), **arrays)
    return path
