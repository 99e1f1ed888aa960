#!/usr/bin/env python3
"""Counts habits of prose that slow readers down, in docstrings and pages: python test/support/prose.py [--list]."""

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2]
HABITS = {
    'clauses with what, who, whose, nobody': (
        r'(?i)\b(what|who|whoever|whatever|whose|nobody|somebody)\b',
        16.0,
    ),
    'tell for report, return or publish': (r'(?i)\b(tells?|told|telling)\b', 4.0),
    'fragments such as "Of the robot."': (
        r'(?m)(?:^|(?<=[.:] ))[ ]*(?:Of|As|Like|In|For|With|Without|By|Per|To|From) '
        r'(?:the|a|an|its|each|all|one|every|this|it|any)\b[^.,;:\n]{0,40}\.(?=\s|$)',
        1.0,
    ),
    'stand for be': (r'(?i)\b(stands?|stood)\b', 2.0),
    'beside or behind for with or after': (r'(?i)\b(beside|behind)\b', 3.0),
    'is no X': (r'(?i)\b(is|are|was|were) no\b(?! longer)', 3.0),
}  # regular expression, largest number per 10,000 words; reference projects of this field have at most half of each


def docstrings(folder: Path) -> Iterator[tuple[str, str]]:
    """Return (place, text) of each docstring below a folder, without literals."""
    for path in sorted(folder.rglob('*.py')):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
            if documented and (text := ast.get_docstring(node)):
                yield f'{path}:{node.body[0].lineno}', re.sub(r'``[^`]*``', 'x', text)


def pages(folder: Path) -> Iterator[tuple[str, str]]:
    """Return (place, text) of each page of a source tree, without code and addresses of links."""
    names = [folder / name for name in ('README.md', 'CONTRIBUTING.md', 'SECURITY.md')]
    for path in [*names, *sorted((folder / 'docs').rglob('*.md'))]:
        text = re.sub(r'```.*?```|~~~.*?~~~', '', path.read_text(encoding='utf-8'), flags=re.DOTALL)
        yield str(path), re.sub(r'\]\([^)\s]*\)', ']', re.sub(r'`[^`\n]*`', 'x', text))


def rates(texts: list[tuple[str, str]]) -> dict[str, float]:
    """Return how often each habit occurs per 10,000 words."""
    words = sum(len(re.findall(r"[A-Za-z][A-Za-z'-]*", text)) for _, text in texts)
    return {
        name: 1e4 * sum(len(re.findall(pattern, text)) for _, text in texts) / max(words, 1)
        for name, (pattern, _) in HABITS.items()
    }


def main() -> int:
    """Print the rates, and each occurrence with --list; return 1 if a rate is too large."""
    status = 0
    for kind, texts in (
        ('docstrings', [*docstrings(SOURCE / 'delta3_pacdrive')]),
        ('tests', [*docstrings(SOURCE / 'test')]),
        ('pages', [*pages(SOURCE)]),
    ):
        for name, rate in rates(texts).items():
            pattern, limit = HABITS[name]
            status |= rate > limit
            print(f'{kind:<10} {rate:6.1f} per 10,000 words (at most {limit:2.0f}): {name}')
            if '--list' in sys.argv:
                for place, text in texts:
                    for line in text.splitlines():
                        if re.search(pattern, line):
                            print(f'    {place}: {line.strip()}')
    return status


if __name__ == '__main__':
    sys.exit(main())
