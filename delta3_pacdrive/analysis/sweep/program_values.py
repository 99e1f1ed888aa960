"""Single values of a program's document, by their paths: ``moves[0].move_l.speed_m_s``."""

import copy
import re
from typing import Any

_STEP = re.compile(r'(?:^|\.)(\w+)|\[(\d+)\]')


def steps_of(path: str) -> list[str | int]:
    """Return the keys and numbers of a path; raises KeyError with a path that is none."""
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
    """Return the value at a path; None for a key that its mapping may have, but has not.

    Raises
    ------
    KeyError
        There is nothing that could hold it; tells how far the path goes.

    """
    steps, here = steps_of(path), document
    for n, step in enumerate(steps):
        last = n + 1 == len(steps)
        if isinstance(step, int):
            if not isinstance(here, list) or step >= len(here):
                raise KeyError(_told(steps[: n + 1]))
            here = here[step]
        elif not isinstance(here, dict) or (step not in here and not last):
            raise KeyError(_told(steps[: n + 1]))
        else:
            here = here.get(step)
    return here


def with_value(document: Any, path: str, value: Any) -> Any:
    """Return a copy of a document with another value at a path; raises KeyError as ``value_at`` does."""
    value_at(document, path)
    changed = copy.deepcopy(document)
    *before, last = steps_of(path)
    here = changed
    for step in before:
        here = here[step]
    here[last] = value
    return changed


def _told(steps: list[str | int]) -> str:
    return ''.join(f'[{step}]' if isinstance(step, int) else f'.{step}' for step in steps).removeprefix('.')
