"""Names of the packaged programs. Light: the help of a command tells them."""

import os

# what the thesis ran; its controller goes with them
THESIS_PROGRAMS = ('experiment1', 'experiment2', 'experiment3', 'excitation')
_PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def program_names() -> list[str]:
    """Return the names that go without a path, sorted."""
    for root in (_PACKAGE, os.path.dirname(_PACKAGE)):  # installed, or in the source tree
        folder = os.path.join(root, 'config', 'programs')
        if os.path.isdir(folder):
            return sorted(name.removesuffix('.yaml') for name in os.listdir(folder) if name.endswith('.yaml'))
    return []


def is_own(path: str | os.PathLike[str]) -> bool:
    """Return whether a file of one's own goes before the packaged one of its name; a folder is no such file."""
    return os.path.exists(path) and not os.path.isdir(path)
