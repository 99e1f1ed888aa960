"""Parameter files, packaged or user-defined."""

from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import Any

from delta3_pacdrive.configuration import packaged, parameter_file
from delta3_pacdrive.errors import ParameterError, shown
from delta3_pacdrive.parameters.robot import Parameters, flat_document, from_tree

DEFAULT_FILE = 'delta3.yaml'
ALIASES = {'built': 'rich'}  # the packaged file has the name of its parameter group
THESIS_CONTROLLER, MODEL_CONTROLLER = 'delta3', 'model'  # files that select the controller of a run


def load(path: str | Path | None = None) -> Parameters:
    """Read the parameter file ``path``; default: the packaged robot. A bare name may mean a packaged file.

    The packaged files ``rich`` and ``model`` contain only differences from the default; any other file is complete.
    ``+`` joins files, as in ``rich+model`` or ``mine.yaml+model``: the first is complete or packaged, the others
    contain differences. Contradictions between them are rejected.

    Raises
    ------
    ParameterError
        The file is missing or is not a ROS parameter file, a value is unknown, missing or invalid, or joined files
        contradict each other.

    """
    default = config_directory() / DEFAULT_FILE
    files = parts(path) if path is not None else [default]
    where = str(path) if len(files) > 1 else str(files[0])
    trees = [(str(file), parameter_file.read(file)) for file in files]
    if _is_packaged_difference(files[0]):
        trees.insert(0, (str(default), parameter_file.read(default)))
    return from_tree(_joined(trees, where), where)


def of_run(given: str | None, program: str | Path | None = None) -> str:
    """Return the parameter file of a run, which selects its controller.

    Packaged programs of the thesis run with its controller. All other programs, and a robot without a program, use the
    model-based controller; a file of differences, such as ``rich``, is then added to it.

    Parameters
    ----------
    given
        File given by the user, if any.
    program
        File or packaged name of the program; None for a robot that waits for moves.

    """
    own = THESIS_CONTROLLER if program is not None and _is_of_the_thesis(program) else MODEL_CONTROLLER
    if given is None:
        return own
    first, *_ = files = parts(given)
    stems = [file.stem for file in files if file.parent.resolve() == config_directory().resolve()]
    if own == MODEL_CONTROLLER and _is_packaged_difference(first) and own not in stems:
        return f'{own}+{given}'
    return given


def _is_of_the_thesis(program: str | Path) -> bool:
    path, folder = Path(program), config_directory() / 'programs'
    if path.parent == Path() and not packaged.is_own(path):
        path = folder / f'{path.name}.yaml'
    return path.stem in packaged.THESIS_PROGRAMS and path.resolve().parent == folder.resolve()


def parts(path: str | Path) -> list[Path]:
    """Return the files denoted by ``path``: itself, a packaged one, or several joined by ``+``."""
    found = find(path)
    several = [find(part) for part in str(path).split('+')]
    if packaged.is_own(found) or not any(packaged.is_own(part) for part in several):
        return [found]
    return several


def find(path: str | Path) -> Path:
    """Return ``path`` if it exists, else the packaged parameter file of that name."""
    path = Path(path)
    name = ALIASES.get(str(path), str(path))
    for own in config_directory().glob('*.yaml'):
        if name in (own.name, own.stem) and not packaged.is_own(path):
            return own
    return path


def _is_packaged_difference(path: Path) -> bool:
    return path.name != DEFAULT_FILE and path.parent.resolve() == config_directory().resolve()


def _joined(trees: list[tuple[str, parameter_file.Tree]], where: str) -> parameter_file.Tree:
    """Return the values of the first file, updated by the differences in the others; each tree has its file name."""
    (_, tree), *differences = trees
    given: dict[tuple[str, str], tuple[str, Any]] = {}
    for name, difference in differences:
        for group, values in difference.items():
            if not isinstance(values, dict):
                changed, tree = {'': values}, tree | {group: values}
            else:
                changed, tree = values, tree | {group: (tree.get(group) or {}) | values}
            for key, value in changed.items():
                other, before = given.setdefault((group, key), (name, value))
                if value != before:
                    raise ParameterError(
                        f'{where}: {group}{"." * bool(key)}{key} is {shown(before)} in {other}, '
                        f'but {shown(value)} in {name}'
                    )
    return tree


def config_directory() -> Path:
    """Return the folder of packaged configuration files, installed or in the source tree."""
    installed = Path(str(resources.files('delta3_pacdrive'))) / 'config'
    return installed if installed.is_dir() else Path(__file__).parents[2] / 'config'


def write(parameters: Parameters, path: Path, head: Iterable[str] = ()) -> Path:
    """Write ``parameters`` to ``path``, with the comment lines ``head`` at its top; return the path."""
    document: dict[str, Any] = {}
    for name, value in flat_document(parameters).items():
        group, _, key = name.partition('.')
        document.setdefault(group, {})[key] = value
    parameter_file.write(document, path, head)
    return path
