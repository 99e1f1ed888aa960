"""Reader of MATLAB files with variables named after signal and unit: ``time_s``, ``tcp_command_mm``.

A variable with three columns or rows is a whole signal; with ``_1 _2 _3`` or ``_x _y _z`` before the unit it is one
column. Version 7.3 is HDF5 and read by h5py, all other versions by scipy.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import TraceError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.signals import columns_of
from delta3_pacdrive.recording.tables.quantities import UNITS
from delta3_pacdrive.recording.tables.table import Table
from delta3_pacdrive.recording.trace import reason

HDF5 = b'\x89HDF'
OF_MATLAB_73 = b'MATLAB 7.3 MAT-file'
NUMBER_BYTES = 8
NUMBERS = ('double', 'single', *(f'{sign}int{bits}' for sign in ('', 'u') for bits in (8, 16, 32, 64)))
TEXT, CLASS = b'char', 'MATLAB_class'  # texts are stored as numbers in HDF5, marked by this class
NEEDED = (
    "MATLAB files of version 7.3 need h5py: pip install 'delta3_pacdrive[matlab]', or save them with '-v7'"
)
# unit at the end of a name
ENDS = {unit.replace(' ', '_').replace('/', '_').lower(): unit for unit in UNITS}


def read(path: Path) -> Table:
    """Read a table; variables that are not real numbers are ignored.

    Raises
    ------
    TraceError
        The file cannot be read, h5py is not installed for version 7.3, or variables are of different lengths.

    """
    try:
        with path.open('rb') as stream:
            begin = stream.read(512)
        variables = _of_hdf5(path) if begin.startswith((HDF5, OF_MATLAB_73)) else _of_matlab(path)
    except TraceError:
        raise
    except OSError as error:
        raise TraceError(f'cannot read trace {path}: {error.strerror or reason(error)}') from error
    except Exception as error:  # scipy and h5py raise arbitrary errors for damaged files
        raise TraceError(f'cannot read trace {path}: {reason(error)}') from error
    headings: list[str] = []
    columns: list[Floats] = []
    for name, values in variables.items():
        if name.startswith('__') or not isinstance(values, np.ndarray) or values.dtype.kind not in 'iuf':
            continue
        for heading, column in _columns(name, np.asarray(values, dtype=np.float64)):
            headings.append(heading)
            columns.append(column)
    lengths = {len(column) for column in columns}
    if len(lengths) > 1:
        longest = max(lengths)
        other = next(h for h, column in zip(headings, columns, strict=True) if len(column) != longest)
        raise TraceError(
            f'the variables in {path} are of different lengths: {shown(other)} does not have {longest} values'
        )
    if not columns:
        raise TraceError(f'{path} has no variable of numbers')
    return Table(path, headings, np.column_stack(columns))


def _of_matlab(path: Path) -> dict[str, Any]:
    """Return the variables of a file up to version 7."""
    from scipy.io import loadmat, whosmat

    with path.open('rb') as stream:
        shapes = {name: shape for name, shape, kind in whosmat(stream) if kind in NUMBERS}
        whole_file.require_size(path, NUMBER_BYTES * sum(math.prod(shape) for shape in shapes.values()))
        stream.seek(0)
        return dict(loadmat(stream, variable_names=list(shapes)))


def _of_hdf5(path: Path) -> dict[str, Any]:
    """Return the array variables of a file of version 7.3, with the axes in the order of MATLAB."""
    try:
        import h5py
    except ModuleNotFoundError:
        raise TraceError(f'cannot read {path}: {NEEDED}') from None
    with h5py.File(path, 'r') as file:
        arrays = {name: item for name, item in file.items() if _is_array(h5py, item)}
        whole_file.require_size(path, NUMBER_BYTES * sum(item.size for item in arrays.values()))
        return {name: item[()].T for name, item in arrays.items()}


def _is_array(h5py: Any, item: Any) -> bool:
    attributes: Mapping[str, Any] = item.attrs
    return (
        isinstance(item, h5py.Dataset)
        and item.ndim > 0
        and not item.is_virtual  # data in other files is not read
        and not item.external
        and attributes.get(CLASS, b'') != TEXT
        and not attributes.get('MATLAB_empty', 0)
    )


def _columns(name: str, values: Floats) -> list[tuple[str, Floats]]:
    """Return headings and columns of a variable; scalars are ignored."""
    if values.ndim != 2 or values.size < 2:
        return []
    signal, unit = _split_name(name)
    ending = f' [{unit}]' if unit else ''
    if 1 in values.shape:
        return [(signal + ending, values.ravel())]
    if values.shape[1] != 3 and values.shape[0] == 3:
        values = values.T
    if values.shape[1] != 3:
        return [(f'{signal}_{n}{ending}', column) for n, column in enumerate(values.T, start=1)]
    names = [suffix for suffix, _ in columns_of(signal, '')]
    names = names if len(names) == 3 else ['1', '2', '3']
    return [(f'{signal}_{suffix}{ending}', column) for suffix, column in zip(names, values.T, strict=True)]


def _split_name(name: str) -> tuple[str, str]:
    """Return name and unit of a variable; the unit is empty if the name has none."""
    lower = name.lower()
    for end in sorted(ENDS, key=len, reverse=True):
        if lower.endswith(f'_{end}'):
            return name[: -len(end) - 1], ENDS[end]
    return name, ''
