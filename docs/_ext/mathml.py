"""Renders equations as MathML while the documentation is built, so that it reads without network and scripts.

A subset of LaTeX: what is not known is an error of the build.
"""

import html
import re
import unicodedata
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.math import get_node_equation_number
from sphinx.writers.html5 import HTML5Translator

# What the converter does not know, in words that it knows.
SPELLINGS = [
    (r'\\(begin|end)\{aligned\}', r'\\\1{split}'),
    (r'\\(operatorname|mathrm)\{', r'\\text{'),
]


def _bold(match: re.Match[str]) -> str:
    """Replace an attribute that browsers ignore by the letters that it means."""
    kind, text = match[1].replace('-', ' '), html.unescape(match[2])
    letters = []
    for letter in text:
        words = (
            unicodedata.name(letter).replace('GREEK', '').replace('LATIN', '').replace('LETTER', '').split()
        )
        letters.append(unicodedata.lookup(' '.join(['MATHEMATICAL', kind.upper(), *words])))
    return f'<mi>{"".join(letters)}</mi>'


def mathml(latex: str, display: str) -> str:
    """Return an equation as MathML."""
    spelt = latex
    for pattern, replacement in SPELLINGS:
        spelt = re.sub(pattern, replacement, spelt)
    text: str = convert(spelt, display=display)
    unknown = re.search(r'\\\w*|>&<', text)
    if unknown:
        raise ExtensionError(f'docs/_ext/mathml.py cannot render {unknown[0]!r} in {latex!r}')
    return re.sub(r'<mi mathvariant="(bold(?:-italic)?)">([^<]*)</mi>', _bold, text)


def inline(self: HTML5Translator, node: nodes.math) -> None:
    """Write an equation in a line of text."""
    self.body.append(mathml(node.astext(), 'inline'))
    raise nodes.SkipNode


def block(self: HTML5Translator, node: nodes.math_block) -> None:
    """Write an equation of its own, with its number if it has one."""
    self.body.append('<div class="math">')
    if node['number']:
        self.body.append(f'<span class="eqno">({get_node_equation_number(self, node)})')
        self.add_permalink_ref(node, 'Link to this equation')
        self.body.append('</span>')
    self.body.append(mathml(node.astext(), 'block'))
    self.body.append('</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the renderer."""
    app.add_html_math_renderer('mathml', (inline, None), (block, None))
    return {'version': '1', 'parallel_read_safe': True, 'parallel_write_safe': True}
