"""Numbers and names of the axes of a robot; without slow imports, because the help of commands uses them."""

ARMS = 3
ROTARY_AXES_MAX = 2
AXES_MAX = ARMS + ROTARY_AXES_MAX


def numbered(name: str, number: int) -> str:
    """Return the name of a value of rotary axis ``number``, from 0: ``name``, ``name_2``."""
    return f'{name}_{number + 1}' if number else name
