"""Parameter files: the packaged ones and those of users."""

from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import Any

from delta3_pacdrive.configuration import parameter_file
from delta3_pacdrive.parameters.robot import Parameters, flat_document, from_tree, groups

DEFAULT_FILE = 'delta3.yaml'


def load(path: str | Path | None = None) -> Parameters:
    """Read the parameter file ``path``, the packaged default without one; a bare name means a packaged file as well.

    The packaged file ``rich`` holds only what differs from the default, as a file for nodes may; any other is complete.

    Raises
    ------
    ParameterError
        The file is not there, is no ROS parameter file, or holds an unknown, missing, mistyped or forbidden value.

    """
    default = config_directory() / DEFAULT_FILE
    path = find(path) if path is not None else default
    tree = parameter_file.read(path)
    if path != default and path.parent.resolve() == default.parent.resolve():
        complete = parameter_file.read(default)
        tree = complete | {group: complete.get(group, {}) | values for group, values in tree.items()}
    return from_tree(tree, str(path))


def find(path: str | Path) -> Path:
    """Return the parameter file that ``path`` means: itself, else the packaged one of that name."""
    path = Path(path)
    for packaged in config_directory().glob('*.yaml'):
        if str(path) in (packaged.name, packaged.stem) and not path.exists():
            return packaged
    return path


def config_directory() -> Path:
    """Return the folder of packaged configuration files, installed or in the source tree."""
    installed = Path(str(resources.files('delta3_pacdrive'))) / 'config'
    return installed if installed.is_dir() else Path(__file__).parents[2] / 'config'


def write(parameters: Parameters, path: Path, head: Iterable[str] = ()) -> Path:
    """Write ``parameters`` to ``path``, as ``load`` and every node read it, below the comments ``head``; return it."""
    document: dict[str, Any] = {group: {} for group in groups()}
    for name, value in flat_document(parameters).items():
        group, _, key = name.partition('.')
        document[group][key] = value
    parameter_file.write(document, path, head)
    return path
