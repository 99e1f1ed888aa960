"""Files of poses and measurements: a table as CSV, one row per pose, units in the header.

    # parameters: 0123456789abcdef (delta3.yaml)              optional: of the controller that told the angles
    use,axis1 [deg],axis2 [deg],axis3 [deg],measured_x [mm],measured_y [mm],measured_z [mm]
    fit,12.5,12.5,12.5,0.021,-0.013,-850.044
    check,...

``axis1`` to ``axis3`` are arm angles as the controller tells them, ``measured_x`` to ``measured_z`` is the point of an
instrument. A touch has ``object`` instead, the name of what was touched, and for a ball its ``diameter``. Without
``use`` all rows are for the estimation. ``number``, ``x``, ``y`` and ``z`` (where the pose was planned) are only for
people.
"""

import csv
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive.analysis.calibration.data import Measurements, Poses
from delta3_pacdrive.analysis.provenance import Provenance, write_table
from delta3_pacdrive.configuration.checked import nearest_of
from delta3_pacdrive.errors import CalibrationError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.quantities import UNITS

FIT, CHECK = 'fit', 'check'
AXES = ('axis1', 'axis2', 'axis3')
POINT = ('measured_x', 'measured_y', 'measured_z')
PLANNED = ('x', 'y', 'z')
WORDS = ('number', 'use', 'object')
WITH_UNIT = dict.fromkeys(AXES, 'rad') | dict.fromkeys((*POINT, *PLANNED, 'diameter'), 'm')
ROWS_MAX, SIZE_MAX_BYTES = 10_000, 1 << 24
PARAMETERS = '# parameters:'
MM = 1e3


def write(
    path: Path, poses: Poses, angles_rad: Floats, origin: Provenance, points_m: Floats | None = None
) -> Path:
    """Write poses with the arm angles there [rad], nan where they are still to be told, and measured points [m]."""
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


def read(path: Path) -> Measurements:
    """Read measurements.

    Raises
    ------
    CalibrationError
        The file cannot be read, a column or unit is unknown, stands twice or is missing, or a value is missing or no
        number; names the column or the row.

    """
    try:
        if path.stat().st_size > SIZE_MAX_BYTES:
            raise CalibrationError(f'{path} is larger than {SIZE_MAX_BYTES >> 20} MiB')
        with path.open(encoding='utf-8-sig', newline='') as file:
            lines = file.read().splitlines()
        checksum = _checksum(lines)
        reader = csv.reader(line for line in lines if not line.startswith('#'))
        header = next(reader, [])
        rows = list(_rows(reader, len(header), path))
    except (OSError, UnicodeDecodeError, csv.Error, ValueError) as error:
        if isinstance(error, CalibrationError):
            raise
        why = getattr(error, 'strerror', None) or error
        raise CalibrationError(f'cannot read measurements {path}: {why}') from error
    columns = _columns(header, path)
    if not rows:
        raise CalibrationError(f'{path} has no measurement')
    angles = np.stack([_numbers(rows, columns[name], path) for name in AXES], axis=-1)
    checks = np.array([_is_check(row, columns, n, path) for n, row in enumerate(rows)])
    if checks.all():
        raise CalibrationError(f'{path} has no measurement to estimate from: all of them are to check with')
    if 'object' in columns:
        objects, diameters = _objects(rows, columns, path)
        return Measurements(angles, np.full_like(angles, np.nan), checks, objects, diameters, checksum)
    points = np.stack([_numbers(rows, columns[name], path) for name in POINT], axis=-1)
    return Measurements(angles, points, checks, (), np.full(len(rows), np.nan), checksum)


def _checksum(lines: Sequence[str]) -> str:
    told = next((line for line in lines if line.startswith(PARAMETERS)), '')
    return told.removeprefix(PARAMETERS).strip().partition(' ')[0]


def _rows(reader: Iterator[list[str]], columns: int, path: Path) -> Iterator[list[str]]:
    number = 0
    for row in reader:
        if not any(cell.strip() for cell in row):
            continue
        number += 1
        if number > ROWS_MAX:
            raise CalibrationError(f'{path} has more than {ROWS_MAX} measurements')
        if len(row) != columns:
            raise CalibrationError(
                f'measurement {number} of {path} has {len(row)} values, the header {columns} columns'
            )
        yield [cell.strip() for cell in row]


Column = tuple[int, float, str]  # place in a row, factor to SI, name as in the header


def _columns(header: list[str], path: Path) -> dict[str, Column]:
    """Return the columns by name."""
    found: dict[str, Column] = {}
    known = (*WORDS, *WITH_UNIT)
    for place, text in enumerate(header):
        label, bracket, rest = (part.strip() for part in text.partition('['))
        if label not in known:
            raise CalibrationError(
                f'{path} is no file of measurements: it has the column {shown(text)}, expected '
                f'{", ".join(known)}{nearest_of(label, known)}'
            )
        if label in found:
            raise CalibrationError(f'{path} has the column {label} twice')
        factor = 1.0
        if label in WITH_UNIT:
            si, factor = UNITS.get(rest.removesuffix(']').strip(), ('', 0.0))
            if not bracket or si != WITH_UNIT[label]:
                possible = ', '.join(f'[{unit}]' for unit, (of, _) in UNITS.items() if of == WITH_UNIT[label])
                raise CalibrationError(f'{path}: column {shown(text)} must tell its unit, one of {possible}')
        found[label] = place, factor, text.strip()
    wanted = (*AXES, *(() if 'object' in found else POINT))
    if missing := [name for name in wanted if name not in found]:
        raise CalibrationError(f'{path} has no column {missing[0]}')
    if 'object' in found and any(name in found for name in POINT):
        raise CalibrationError(
            f'{path} has points of an instrument and touches of objects: it must be one of them'
        )
    return found


def _numbers(rows: Sequence[Sequence[str]], column: Column, path: Path) -> Floats:
    place, factor, name = column
    values = np.empty(len(rows))
    for n, row in enumerate(rows):
        if not row[place]:
            raise CalibrationError(f'measurement {n + 1} of {path} has no {name}: was it not taken?')
        try:
            values[n] = factor * float(row[place])
        except ValueError:
            values[n] = math.nan
        if not math.isfinite(values[n]):
            raise CalibrationError(
                f'measurement {n + 1} of {path}: {name} is {shown(row[place])}, no finite number'
            )
    return values


def _is_check(row: Sequence[str], columns: dict[str, Column], n: int, path: Path) -> bool:
    if 'use' not in columns:
        return False
    use = row[columns['use'][0]]
    if use not in (FIT, CHECK):
        raise CalibrationError(
            f'measurement {n + 1} of {path}: use is {shown(use)}, but must be {FIT} or {CHECK}'
        )
    return use == CHECK


def _objects(
    rows: Sequence[Sequence[str]], columns: dict[str, Column], path: Path
) -> tuple[tuple[str, ...], Floats]:
    """Return what was touched, and diameters [m]: an object has one."""
    objects = tuple(row[columns['object'][0]] for row in rows)
    if '' in objects:
        raise CalibrationError(
            f'measurement {objects.index("") + 1} of {path} does not tell what was touched'
        )
    diameters = np.full(len(rows), np.nan)
    if 'diameter' in columns:
        told = [n for n, row in enumerate(rows) if row[columns['diameter'][0]]]
        diameters[told] = _numbers([rows[n] for n in told], columns['diameter'], path)
    for n, name in enumerate(objects):
        first = diameters[objects.index(name)]
        if not (diameters[n] == first or (math.isnan(diameters[n]) and math.isnan(first))):
            raise CalibrationError(
                f'measurement {n + 1} of {path} tells another diameter of {name} than the ones before'
            )
        if diameters[n] <= 0.0:
            raise CalibrationError(f'measurement {n + 1} of {path}: the diameter of {name} must be positive')
    return objects, diameters
