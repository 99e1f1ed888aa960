"""The cell around the robot: inputs, valves, vacuum cup, parts, boxes, belts and camera."""

import warnings
from importlib import import_module
from typing import Any

_SCRIPTING = {'Robot', 'ScriptError', 'Simulation', 'State', 'WaitTimeoutError', 'connect', 'simulate'}


def __getattr__(name: str) -> Any:
    if name not in _SCRIPTING:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    text = f'{name} of delta3_pacdrive.cell is now in delta3_pacdrive.scripting; the old name ends with release 0.3'
    warnings.warn(text, FutureWarning, 2)
    return getattr(import_module('delta3_pacdrive.scripting'), name)
