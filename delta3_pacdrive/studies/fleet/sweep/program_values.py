"""Access to values of a program document by path: ``moves[0].move_l.speed_m_s``."""

import copy
import re
from typing import Any

_STEP = re.compile(r'(?:^|\.)(\w+)|\[(\d+)\]')


def steps_of(path: str) -> list[str | int]:
    """Return the keys and indices of a path; raises KeyError for an invalid path."""
    steps: list[str | int] = []
    end = 0
    for match in _STEP.finditer(path):
        if match.start() != end:
            raise KeyError(path)
        steps.append(match[1] if match[1] is not None else int(match[2]))
        end = match.end()
    if end != len(path) or not steps:
        raise KeyError(path)
    return steps


def value_at(document: Any, path: str) -> Any:
    """Return the value at a path; None for an optional key that is not set.

    Raises
    ------
    KeyError
        The path does not exist; the argument is its part up to the missing step.

    """
    steps, node = steps_of(path), document
    for n, step in enumerate(steps):
        last = n + 1 == len(steps)
        if isinstance(step, int):
            if not isinstance(node, list) or step >= len(node):
                raise KeyError(_joined(steps[: n + 1]))
            node = node[step]
        elif not isinstance(node, dict) or (step not in node and not last):
            raise KeyError(_joined(steps[: n + 1]))
        else:
            node = node.get(step)
    return node


def with_value(document: Any, path: str, value: Any) -> Any:
    """Return a copy of a document with another value at a path; raises KeyError like ``value_at``."""
    value_at(document, path)
    changed = copy.deepcopy(document)
    *before, last = steps_of(path)
    node = changed
    for step in before:
        node = node[step]
    node[last] = value
    return changed


def _joined(steps: list[str | int]) -> str:
    return ''.join(f'[{step}]' if isinstance(step, int) else f'.{step}' for step in steps).removeprefix('.')
