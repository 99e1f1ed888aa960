"""How Sphinx builds the documentation: ``python -m sphinx -W -b html docs build/docs``."""

import sys
from importlib import metadata
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / '_ext'))

project = 'delta3_pacdrive'
author = 'the delta3_pacdrive maintainers'
project_copyright = '2026, the delta3_pacdrive maintainers'
version = release = metadata.version(project)

extensions = [
    'myst_parser',
    'sphinx.ext.autodoc',
    'sphinx.ext.napoleon',
    'sphinx.ext.viewcode',
    'mathml',
    'plain_docstrings',
    'tables',
]
source_suffix = {'.md': 'markdown'}
exclude_patterns = ['_ext', 'changes']

myst_enable_extensions = ['amsmath', 'colon_fence', 'deflist', 'dollarmath']
myst_heading_anchors = 3
html_math_renderer = 'mathml'

napoleon_google_docstring = False
napoleon_use_rtype = False
autodoc_member_order = 'bysource'
autodoc_typehints = 'none'  # shapes and units stand in the docstrings
default_role = 'code'

# Nothing here comes from the network: the theme brings its own fonts and scripts, equations are MathML.
html_theme = 'furo'
html_title = f'{project} {version}'
html_static_path = ['_static']
html_show_sourcelink = False
html_copy_source = False
html_css_files = ['style.css']
pygments_style = 'default'
pygments_dark_style = 'monokai'
