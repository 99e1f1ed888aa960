"""Strict reader of ROS parameter files: complete groups, no unknown values, each of its type and range.

A group is a record of ``schema``. Its keys have one unit only, because ROS reads the same files.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.configuration.schema import RecordReader, schema_of
from delta3_pacdrive.configuration.source_positions import Place, place_in, place_of_key
from delta3_pacdrive.configuration.strict_reader import Errors, nearest_of, refuse
from delta3_pacdrive.errors import ParameterError

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
    schema = schema_of(cls)
    if given is None and not schema.required:
        given = {}
    if not isinstance(given, dict):
        refuse(f'missing parameter group {group}')
    for key in schema.required:
        if key not in given:
            with errors.noted():
                refuse(f'missing parameter {group}.{key}')
    for key in given:
        if key not in schema.fields:
            with errors.noted(place_of_key(given, key)):
                refuse(f'unknown parameter {group}.{key}{nearest_of(key, schema.fields)}')
    values = checked_some(
        {key: given[key] for key in schema.fields if key in given}, group, cls, errors, given
    )
    return {f.name: f.default for f in dataclasses.fields(cls) if f.name not in schema.required} | values


def checked_some(
    values: Mapping[str, Any], group: str, cls: Any, errors: Errors, given: Any = None
) -> dict[str, Any]:
    """Return the valid ones of some values of a group; ``given`` is the mapping that knows their places."""
    reader, fields = RecordReader(errors), schema_of(cls).fields
    found = {}
    for key, value in values.items():
        with errors.noted(place_in(given, key)):
            name = f'{group}.{key}'
            if isinstance(value, int) and abs(value) > 2**63:
                refuse(f'{name} is too large a number')
            found[key] = fields[key].bind(reader)(value, name)
    return found
