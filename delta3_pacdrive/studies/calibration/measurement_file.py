"""Files of poses and measurements: a table as text, one row per pose, units in the header.

    # parameters: 0123456789abcdef (delta3.yaml)              optional: of the controller that reported the angles
    use,axis1 [deg],axis2 [deg],axis3 [deg],measured_x [mm],measured_y [mm],measured_z [mm]
    fit,12.5,12.5,12.5,0.021,-0.013,-850.044
    check,...

``axis1`` to ``axis3`` are the arm angles reported by the controller, ``measured_x`` to ``measured_z`` the measured
point. A touch has ``object`` instead, the name of the touched object, and for a ball its ``diameter``. Without ``use``
all rows are used for the estimation. ``number`` and the planned position ``x``, ``y``, ``z`` are informative. Tables
with other headings require a column file.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from delta3_pacdrive.configuration.strict_reader import nearest_of
from delta3_pacdrive.errors import CalibrationError, TraceError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.tables import column_file, quantities, table_csv
from delta3_pacdrive.recording.tables.column_file import ColumnFile
from delta3_pacdrive.recording.tables.quantities import TIME, UNITS
from delta3_pacdrive.recording.tables.table import Source, Table
from delta3_pacdrive.recording.tables.table import by_choice as table_columns
from delta3_pacdrive.studies.calibration.study import Measurements, Poses
from delta3_pacdrive.studies.framework.provenance import Provenance, write_table

FIT, CHECK = 'fit', 'check'
AXES = ('axis1', 'axis2', 'axis3')
POINT = ('measured_x', 'measured_y', 'measured_z')
PLANNED = ('x', 'y', 'z')
WORDS = ('number', 'use', 'object')
WITH_UNIT = dict.fromkeys(AXES, 'rad') | dict.fromkeys((*POINT, *PLANNED, 'diameter'), 'm')
OF_COLUMN_FILES = {'arm_position': AXES, 'tcp_measured': POINT}
ROWS_MAX = 10_000
PARAMETERS = 'parameters:'
MM = 1e3


def write(
    path: Path, poses: Poses, angles_rad: Floats, origin: Provenance, points_m: Floats | None = None
) -> Path:
    """Write poses, arm angles [rad] and measured points [m]; angles that are nan leave empty cells."""
    header = ['number', 'use', *(f'{name} [mm]' for name in PLANNED)]
    if poses.objects:
        header += ['object', 'diameter [mm]']
    header += [f'{name} [deg]' for name in AXES]
    if not poses.objects:
        header += [f'{name} [mm]' for name in POINT]
    rows: list[list[Any]] = []
    for n, point in enumerate(poses.points_m):
        row: list[Any] = [n + 1, CHECK if poses.checks[n] else FIT, *_cells(MM * point, 4)]
        if poses.objects:
            row += [poses.objects[n], *_cells(MM * poses.diameters_m[n : n + 1], 4)]
        row += _cells(np.degrees(angles_rad[n]), 7)
        if not poses.objects:
            row += _cells(MM * points_m[n], 6) if points_m is not None else [''] * 3
        rows.append(row)
    return write_table(path, header, rows, origin)


def _cells(values: Floats, digits: int) -> list[Any]:
    return ['' if math.isnan(value) else round(float(value), digits) + 0.0 for value in values]


def read(path: Path, columns: str | Path | None = None) -> Measurements:
    """Read measurements.

    Parameters
    ----------
    path
        Table in any text format that ``table_csv`` reads.
    columns
        Column file that assigns columns of a third-party table to ``arm_position`` and ``tcp_measured``.

    Raises
    ------
    CalibrationError
        The file cannot be read, a column or unit is unknown, duplicate or missing, or a value is missing or not a
        number; the message names the column or the row.

    """
    try:
        chosen = None if columns is None else column_file.read(columns)
        table = table_csv.read(path, chosen.form if chosen else None, WORDS, 'measurements')
        found = _columns(table) if chosen is None else _chosen(table, chosen)
    except TraceError as error:
        raise CalibrationError(str(error)) from error
    if not len(table.values):
        raise CalibrationError(f'{path} has no measurement')
    if len(table.values) > ROWS_MAX:
        raise CalibrationError(f'{path} has more than {ROWS_MAX} measurements')
    angles = np.stack([_numbers(table, found[name]) for name in AXES], axis=-1)
    checks = _checks(table)
    if checks.all():
        raise CalibrationError(f'{path} has no measurement for the estimation: all of them are checks')
    checksum = _checksum(table.comments)
    if 'object' in table.headings:
        objects, diameters = _objects(table, found.get('diameter'))
        return Measurements(
            angles_rad=angles,
            points_m=np.full_like(angles, np.nan),
            checks=checks,
            objects=objects,
            diameters_m=diameters,
            checksum=checksum,
        )
    points = np.stack([_numbers(table, found[name]) for name in POINT], axis=-1)
    return Measurements(
        angles_rad=angles,
        points_m=points,
        checks=checks,
        objects=(),
        diameters_m=np.full(len(angles), np.nan),
        checksum=checksum,
    )


def _checksum(comments: Sequence[str]) -> str:
    line = next((line for line in comments if line.startswith(PARAMETERS)), '')
    return line.removeprefix(PARAMETERS).strip().partition(' ')[0]


def _columns(table: Table) -> dict[str, Source]:
    """Return the columns by name from the headings; raises CalibrationError."""
    found: dict[str, Source] = {}
    known = (*WORDS, *WITH_UNIT)
    seen = set()
    for place, text in enumerate(table.headings):
        label, unit = quantities.split_heading(text)
        if label not in known:
            raise CalibrationError(
                f'{table.path} is not a table of measurements: it has the column {shown(text)}, expected '
                f'{", ".join(known)}{nearest_of(label, known)}; a column file (--columns) defines other columns'
            )
        if label in seen:
            raise CalibrationError(f'{table.path} has the column {label} twice')
        seen.add(label)
        if label not in WITH_UNIT:
            continue
        if unit is None or UNITS.get(unit, ('', 0.0))[0] != WITH_UNIT[label]:
            raise CalibrationError(
                f'{table.path}: column {shown(text)} must have a unit, one of '
                f'{quantities.possible_units(WITH_UNIT[label])}'
            )
        found[label] = Source(place, UNITS[unit][1])
    wanted = (*AXES, *(() if 'object' in seen else POINT))
    if missing := [name for name in wanted if name not in found]:
        raise CalibrationError(f'{table.path} has no column {missing[0]}')
    if 'object' in seen and any(name in found for name in POINT):
        raise CalibrationError(f'{table.path} has both points and touches of objects, only one is allowed')
    return found


def _chosen(table: Table, chosen: ColumnFile) -> dict[str, Source]:
    """Return the columns by name from a column file; raises CalibrationError, TraceError."""
    if others := [one.signal for one in chosen.columns if one.signal not in (*OF_COLUMN_FILES, TIME)]:
        raise CalibrationError(
            f'{chosen.path} names {others[0]}, measurements have {" and ".join(OF_COLUMN_FILES)}'
        )
    wanted = tuple(OF_COLUMN_FILES)[: 1 if 'object' in table.headings else 2]
    sources = table_columns(table, chosen, wanted)
    return {
        name: source
        for signal, names in OF_COLUMN_FILES.items()
        for name, source in zip(names, sources.get(signal, ()), strict=False)
    }


def _numbers(table: Table, source: Source) -> Floats:
    values = np.asarray(table.values[:, source.column] * source.factor + source.offset)
    if not np.isfinite(values).all():
        n = int(np.argmin(np.isfinite(values)))
        name = table.headings[source.column]
        if np.isnan(values[n]):
            raise CalibrationError(f'measurement {n + 1} of {table.path} has no {name}')
        raise CalibrationError(f'measurement {n + 1} of {table.path}: {name} is not a finite number')
    return values


def _checks(table: Table) -> npt.NDArray[np.bool_]:
    """Return which measurements are checks; none if the table has no column ``use``."""
    uses = table.texts.get('use')
    if uses is None:
        return np.zeros(len(table.values), dtype=bool)
    for n, use in enumerate(uses):
        if use not in (FIT, CHECK):
            raise CalibrationError(
                f'measurement {n + 1} of {table.path}: use is {shown(use)}, but must be {FIT} or {CHECK}'
            )
    return np.array([use == CHECK for use in uses])


def _objects(table: Table, diameter: Source | None) -> tuple[tuple[str, ...], Floats]:
    """Return touched objects and their diameters [m]; the diameter of an object must not change."""
    path, objects = table.path, tuple(table.texts['object'])
    if '' in objects:
        raise CalibrationError(f'measurement {objects.index("") + 1} of {path} names no object')
    diameters = np.full(len(objects), np.nan)
    if diameter is not None:
        diameters = np.asarray(table.values[:, diameter.column] * diameter.factor)
    for n, name in enumerate(objects):
        first = diameters[objects.index(name)]
        if not (diameters[n] == first or (math.isnan(diameters[n]) and math.isnan(first))):
            raise CalibrationError(
                f'measurement {n + 1} of {path}: the diameter of {name} differs from that of earlier measurements'
            )
        if diameters[n] <= 0.0 or math.isinf(diameters[n]):
            raise CalibrationError(f'measurement {n + 1} of {path}: the diameter of {name} must be positive')
    return objects, diameters
