"""Parameter files: the packaged ones and those of users."""

from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import Any

from delta3_pacdrive.configuration import packaged, parameter_file
from delta3_pacdrive.errors import ParameterError, shown
from delta3_pacdrive.parameters.robot import Parameters, flat_document, from_tree, groups

DEFAULT_FILE = 'delta3.yaml'
ALIASES = {'built': 'rich'}  # the packaged file has the name of its parameter group
THESIS_CONTROLLER, MODEL_CONTROLLER = 'delta3', 'model'  # files that say which controller a run has


def load(path: str | Path | None = None) -> Parameters:
    """Read the parameter file ``path``, the packaged default without one; a bare name means a packaged file as well.

    The packaged files ``rich`` and ``model`` hold only what differs from the default, as a file for nodes may; any
    other is complete. Files are joined with ``+``, as in ``rich+model`` or ``mine.yaml+model``: the first is complete
    or a packaged one, the others hold what differs from it. What two of these say differently is refused.

    Raises
    ------
    ParameterError
        The file is not there, is no ROS parameter file, or holds an unknown, missing, mistyped or forbidden value, or
        files that are joined contradict one another.

    """
    default = config_directory() / DEFAULT_FILE
    files = parts(path) if path is not None else [default]
    where = str(path) if len(files) > 1 else str(files[0])
    trees = [(str(file), parameter_file.read(file)) for file in files]
    if _is_packaged_difference(files[0]):
        trees.insert(0, (str(default), parameter_file.read(default)))
    return from_tree(_joined(trees, where), where)


def of_run(given: str | None, program: str | Path | None = None) -> str:
    """Return the parameter file of a run: the one with its controller, unless another one is given.

    Packaged programs of the thesis are driven by its controller, all others, and a robot that is up without any, by the
    one that knows the model. A file of differences, such as ``rich``, differs from that.

    Parameters
    ----------
    given
        What was asked for, None for nothing.
    program
        Its file, or the name of a packaged one; None for a robot that waits for moves.

    """
    own = THESIS_CONTROLLER if program is not None and _is_of_the_thesis(program) else MODEL_CONTROLLER
    if given is None:
        return own
    first, *_ = files = parts(given)
    says = [file.stem for file in files if file.parent.resolve() == config_directory().resolve()]
    if own == MODEL_CONTROLLER and _is_packaged_difference(first) and own not in says:
        return f'{own}+{given}'
    return given


def _is_of_the_thesis(program: str | Path) -> bool:
    path, folder = Path(program), config_directory() / 'programs'
    if path.parent == Path() and not packaged.is_own(path):
        path = folder / f'{path.name}.yaml'
    return path.stem in packaged.THESIS_PROGRAMS and path.resolve().parent == folder.resolve()


def parts(path: str | Path) -> list[Path]:
    """Return the files that ``path`` means: itself, a packaged one, or several that ``+`` joins."""
    found = find(path)
    several = [find(part) for part in str(path).split('+')]
    if packaged.is_own(found) or not any(packaged.is_own(part) for part in several):
        return [found]
    return several


def find(path: str | Path) -> Path:
    """Return the parameter file that ``path`` means: itself, else the packaged one of that name."""
    path = Path(path)
    name = ALIASES.get(str(path), str(path))
    for own in config_directory().glob('*.yaml'):
        if name in (own.name, own.stem) and not packaged.is_own(path):
            return own
    return path


def _is_packaged_difference(path: Path) -> bool:
    return path.name != DEFAULT_FILE and path.parent.resolve() == config_directory().resolve()


def _joined(trees: list[tuple[str, parameter_file.Tree]], where: str) -> parameter_file.Tree:
    """Return the values of the first file with the differences that the others tell; each has its name beside it."""
    (_, tree), *differences = trees
    said: dict[tuple[str, str], tuple[str, Any]] = {}
    for name, difference in differences:
        for group, values in difference.items():
            if not isinstance(values, dict):
                said_here, tree = {'': values}, tree | {group: values}
            else:
                said_here, tree = values, tree | {group: (tree.get(group) or {}) | values}
            for key, value in said_here.items():
                other, before = said.setdefault((group, key), (name, value))
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
    """Write ``parameters`` to ``path``, as ``load`` and every node read it, below the comments ``head``; return it."""
    document: dict[str, Any] = {group: {} for group in groups()}
    for name, value in flat_document(parameters).items():
        group, _, key = name.partition('.')
        document[group][key] = value
    parameter_file.write(document, path, head)
    return path
