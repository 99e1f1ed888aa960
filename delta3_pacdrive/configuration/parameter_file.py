"""Strict reader of ROS parameter files: complete groups, no unknown values, each of its type and range.

A group is a dataclass whose fields have ``low`` and ``high`` in their metadata, or ``choices`` for strings. Values
with a default are optional.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.configuration.source_positions import Place, place_in, place_of_key
from delta3_pacdrive.configuration.strict_reader import Errors, nearest_of, refuse
from delta3_pacdrive.errors import ParameterError, shown

Tree = dict[str, Any]


def read(path: Path) -> Tree:
    """Return the groups of a file without checking them; raises ParameterError."""
    document = yaml_file.read(path, 'parameter file', ParameterError)
    try:
        (node,) = document.values()
        tree: Tree = node['ros__parameters']
        tree.items()
    except (AttributeError, KeyError, TypeError, ValueError):
        raise ParameterError(
            f'{path} is not a ROS parameter file: expected "/**: ros__parameters: ..."'
        ) from None
    return tree


def write(tree: Tree, path: Path, head: Iterable[str] = ()) -> None:
    """Write a parameter file with the comment lines ``head`` at its top."""
    yaml_file.write(path, {'/**': {'ros__parameters': tree}}, head)


def place_of(tree: Tree, name: str) -> Place | None:
    """Return the position of the value of a dotted name, if it is known."""
    group, _, key = name.partition('.')
    given = tree.get(group)
    return place_in(given, key) if isinstance(given, dict) and key in given else None


def checked_groups(tree: Tree, groups: Mapping[str, Any], errors: Errors) -> dict[str, Any]:
    """Return the groups as objects of their classes; groups with errors are omitted and the errors recorded."""
    for group in tree:
        if group not in groups:
            with errors.noted(place_of_key(tree, group)):
                refuse(f'unknown parameter group {group}{nearest_of(group, groups)}')
    built = {}
    for group, cls in groups.items():
        with errors.noted():
            values = _checked_group(tree.get(group), group, cls, errors)
            if len(values) == len(dataclasses.fields(cls)):
                built[group] = cls(**values)
    return built


def _checked_group(given: Any, group: str, cls: Any, errors: Errors) -> dict[str, Any]:
    """Return the valid values of a group."""
    fields = {f.name: f for f in dataclasses.fields(cls)}
    if given is None and all(f.default is not dataclasses.MISSING for f in fields.values()):
        given = {}
    if not isinstance(given, dict):
        refuse(f'missing parameter group {group}')
    values = {}
    for key, f in fields.items():
        name = f'{group}.{key}'
        with errors.noted(place_in(given, key) if key in given else None):
            if key not in given and f.default is dataclasses.MISSING:
                refuse(f'missing parameter {name}')
            values[key] = _checked(f, given[key], name) if key in given else f.default
    for key in given:
        if key not in fields:
            with errors.noted(place_of_key(given, key)):
                refuse(f'unknown parameter {group}.{key}{nearest_of(key, fields)}')
    return values


def checked_some(given: Mapping[str, Any], group: str, cls: Any, errors: Errors) -> dict[str, Any]:
    """Return the valid values of an incomplete group; also records non-finite numbers as errors."""
    fields = {f.name: f for f in dataclasses.fields(cls)}
    values = {}
    for key, value in given.items():
        with errors.noted():
            if isinstance(value, float) and not math.isfinite(value):
                refuse(f'{group}.{key} must be finite, not {value}')
            values[key] = _checked(fields[key], value, f'{group}.{key}')
    return values


def _checked(f: Any, value: Any, name: str) -> Any:
    if f.type is bool:
        if not isinstance(value, bool):
            refuse(f'{name} must be a switch, true or false, not {shown(value)}')
        return value
    if f.type is str:
        return _checked_word(f.metadata['choices'], value, name)
    if f.type in (int, float):
        return _checked_number(f, value, name)
    if not isinstance(value, (list, tuple)) or len(value) != 3:
        refuse(f'{name} must be a list of 3 numbers, not {shown(value)}')
    return tuple(float(_checked_number(f, item, name)) for item in value)


def _checked_word(choices: Sequence[str], value: Any, name: str) -> str:
    if not isinstance(value, str):
        refuse(f'{name} must be a word, {" or ".join(choices)}, not {shown(value)}')
    if value not in choices:
        refuse(f'{name} is {shown(value)}, but must be {" or ".join(choices)}{nearest_of(value, choices)}')
    return str(value)


def _checked_number(f: Any, value: Any, name: str) -> float | int:
    wanted = int if f.type is int else (int, float)
    if isinstance(value, bool) or not isinstance(value, wanted):
        kind = 'whole number' if f.type is int else 'number'
        refuse(f'{name} must be a {kind}, not {shown(value)}')
    low, high = f.metadata['low'], f.metadata['high']
    if isinstance(value, int) and abs(value) > 2**63:
        refuse(f'{name} is too large a number')
    if not low <= value <= high:
        rule = f'at least {low:g}' if high == math.inf else f'between {low:g} and {high:g}'
        if 0.0 < low < 1e-300:
            rule = 'positive' if high == math.inf else f'positive and at most {high:g}'
        refuse(f'{name} is {shown(value)}, but must be {rule}')
    return int(value) if f.type is int else float(value)
