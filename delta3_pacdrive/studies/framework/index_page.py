"""Self-contained HTML page of a report folder, with embedded figures and tables and without scripts.

Files are embedded as downloads; files larger than ``EMBEDDED_BYTES`` are linked.
"""

from __future__ import annotations

import base64
from html import escape
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from delta3_pacdrive.studies.framework.provenance import os_errors_as

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

ROWS_SHOWN = 12  # rows of a table
EMBEDDED_BYTES = 500_000  # largest embedded file
TYPES = {'.csv': 'text/csv', '.json': 'application/json', '.png': 'image/png'}


class IndexPage:
    """Page of a report folder; shows its content in the order in which it is added."""

    def __init__(self) -> None:
        self._sections: list[str] = []

    def add_file(self, path: Path) -> None:
        """Add a file; raises ReportError."""
        self._sections.append(f'<p>{download_link(path)}</p>')

    def add_table(self, path: Path, header: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
        """Add a table that was written to a file; raises ReportError."""
        heads = ''.join(f'<th>{escape(name)}</th>' for name in header)
        lines = ''.join(
            f'<tr>{"".join(f"<td>{_cell(cell)}</td>" for cell in row)}</tr>\n' for row in rows[:ROWS_SHOWN]
        )
        shown = '' if len(rows) <= ROWS_SHOWN else f'the first {ROWS_SHOWN} of '
        self._sections.append(
            f'<details><summary>{escape(path.name)}</summary>\n<p>{shown}{len(rows)} rows; {download_link(path)}</p>\n'
            f'<div class="wide"><table>\n<tr>{heads}</tr>\n{lines}</table></div></details>'
        )

    def add_figure(self, path: Path, title: str, caption: str) -> None:
        """Add a figure that was written to a file; raises ReportError."""
        legend = f'<b>{escape(title)}</b> {escape(caption)} <code>{escape(path.name)}</code>'
        self._sections.append(
            f'<figure><img src="{_data(path, _read(path))}" alt="{escape(path.name)}">\n'
            f'<figcaption>{legend}</figcaption></figure>'
        )

    def html(self, title: str, origin: Mapping[str, str], text: str, more: str = '') -> str:
        """Return the page with provenance ``origin`` (including the command), lines ``text`` and more HTML."""
        rows = ''.join(
            f'<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>\n'
            for name, value in origin.items()
            if name != 'command'
        )
        body = '\n'.join(
            [
                f'<h1>{escape(title)}</h1>\n<p><code>{escape(origin["command"])}</code></p>',
                f'<pre>{escape(text)}</pre>' if text else '',
                *self._sections,
                f'<h2>How this came about</h2>\n<div class="wide"><table>\n{rows}</table></div>\n<p>{more}</p>',
            ]
        )
        return PAGE.format(title=escape(title), body=body)


def download_link(path: Path, content: bytes | None = None) -> str:
    """Return the HTML link to a file: an embedded download, or for a large file a link; raises ReportError.

    ``content`` is the content of a file that is not written yet; None: read the file.
    """
    name = escape(path.name)
    content = _read(path) if content is None else content
    if len(content) > EMBEDDED_BYTES:
        return f'<a href="{quote(path.name)}">{name}</a> ({len(content) / 1e6:.1f} MB, in the same folder)'
    return f'<a href="{_data(path, content)}" download="{name}">{name}</a>'


def _data(path: Path, content: bytes) -> str:
    kind = TYPES.get(path.suffix.lower(), 'application/octet-stream')
    return f'data:{kind};base64,{base64.b64encode(content).decode("ascii")}'


def _read(path: Path) -> bytes:
    with os_errors_as(f'cannot read {path}'):
        return path.read_bytes()


def _cell(cell: Any) -> str:
    return escape(f'{cell:.6g}' if isinstance(cell, float) else str(cell))


# colours and type match the report page
PAGE = """\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title}</title>
<style>
:root {{ --paper: #fff; --ink: #1d2329; --muted: #66707a; --line: #e4e8ec; --code: #f4f6f8; --accent: #0072b2 }}
@media (prefers-color-scheme: dark) {{
:root {{ --paper: #131618; --ink: #e4e8eb; --muted: #97a1aa; --line: #2b3237; --code: #1a1f23; --accent: #56b4e9 }} }}
body {{ font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; max-width: 68rem; margin: 2rem auto;
padding: 0 1rem; color: var(--ink); background: var(--paper) }}
h1 {{ font-size: 1.5rem; letter-spacing: -0.01em }} h2 {{ font-size: 1.1rem; margin-top: 2rem }}
code, pre {{ font: 0.85rem/1.5 ui-monospace, "SF Mono", Menlo, Consolas, monospace; overflow-wrap: anywhere }}
pre {{ background: var(--code); padding: 1rem; border-radius: 0.5rem; overflow-wrap: normal }}
pre, .wide {{ overflow-x: auto }}
a {{ color: var(--accent) }} summary {{ cursor: pointer }} details {{ margin: 1rem 0 }}
figure {{ margin: 2rem 0 }} img {{ max-width: 100%; border-radius: 0.5rem; border: 1px solid var(--line) }}
figcaption, p {{ color: var(--muted) }} figcaption b {{ color: var(--ink) }} figcaption code {{ font-size: 0.75rem }}
table {{ border-collapse: collapse; font-size: 0.85rem; font-variant-numeric: tabular-nums }}
th {{ text-align: left; color: var(--muted); font-weight: 600 }}
td, th {{ border-bottom: 1px solid var(--line); padding: 0.2rem 1rem 0.2rem 0; vertical-align: top }}
</style>
</head>
<body>
{body}
</body>
</html>
"""
