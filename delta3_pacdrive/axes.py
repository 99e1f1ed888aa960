"""Numbers and names of the axes of a robot; without slow imports, because the help of commands uses them."""

ARMS = 3
ROTARY_AXES_MAX = 2
AXES_MAX = ARMS + ROTARY_AXES_MAX


def numbered(name: str, number: int, between: str = '_') -> str:
    """Return the name of a value of rotary axis ``number``, from 0: ``name``, ``name_2`` with ``_`` as ``between``."""
    return f'{name}{between}{number + 1}' if number else name
