"""Lets docstrings that are written for people read well as pages: formulas keep their lines, bars stay bars."""

from typing import Any

from sphinx.application import Sphinx


def prepare(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Make literal blocks of the indented lines of a module, and let ``|x|`` be no substitution."""
    result: list[str] = []
    literal = False
    for number, line in enumerate(lines):
        if what == 'module' and line.startswith(' ') and not literal and not lines[number - 1].strip():
            result += [f'.. code-block:: {"python" if "import " in line else "text"}', '']
            literal = True
        elif line.strip() and not line.startswith(' '):
            literal = False
        result.append(line if literal else line.replace('|', r'\|'))
    lines[:] = result


def setup(app: Sphinx) -> dict[str, Any]:
    """Prepare docstrings before others read them."""
    app.connect('autodoc-process-docstring', prepare, priority=400)
    return {'version': '1', 'parallel_read_safe': True, 'parallel_write_safe': True}
