"""Names of the packaged programs; imports nothing heavy, because command help lists them."""

import os

# programs of the thesis; they run with its controller
THESIS_PROGRAMS = ('experiment1', 'experiment2', 'experiment3', 'excitation')
_PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def program_names() -> list[str]:
    """Return the names that need no path, sorted."""
    for root in (_PACKAGE, os.path.dirname(_PACKAGE)):  # installed, or in the source tree
        folder = os.path.join(root, 'config', 'programs')
        if os.path.isdir(folder):
            return sorted(name.removesuffix('.yaml') for name in os.listdir(folder) if name.endswith('.yaml'))
    return []


def is_own(path: str | os.PathLike[str]) -> bool:
    """Whether a file of the user takes precedence over the packaged one of the same name."""
    return os.path.exists(path) and not os.path.isdir(path)
