"""The documentation builds without a warning and is readable without network."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2]

pytest.importorskip('sphinx', reason='the documentation needs the extra "docs"')


@pytest.fixture(scope='module')
def html(tmp_path_factory):
    """Build the pages; return their contents by name."""
    folder = tmp_path_factory.mktemp('html')
    done = subprocess.run(
        [sys.executable, '-m', 'sphinx', '-q', '-W', '--keep-going', '-b', 'html', SOURCE / 'docs', folder],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return {
        str(path.relative_to(folder)): path.read_text(encoding='utf-8') for path in folder.rglob('*.html')
    }


def test_the_pages_build_without_a_warning(html):
    assert 'index.html' in html


def test_every_command_shows_its_help(html):
    from delta3_pacdrive.cli.main import COMMANDS

    shown = set(re.findall(r'usage: delta3 ([\w-]+)', html['commands.html']))
    assert shown == set(COMMANDS)


def test_every_topic_and_service_has_a_row_and_every_row_as_many_cells_as_its_head(html):
    from delta3_pacdrive.ros.wire.interfaces import DELIVERIES, SERVICES, TOPICS

    tables = [
        [
            re.findall(r'<t[dh]\b.*?</t[dh]>', row, re.DOTALL)
            for row in re.findall(r'<tr\b.*?</tr>', table, re.DOTALL)
        ]
        for table in re.findall(r'<table\b.*?</table>', html['integrator.html'], re.DOTALL)
    ]
    assert all({len(row) for row in table} == {len(table[0])} for table in tables)
    first = {tuple(re.sub(r'<[^>]*>', '', row[0]).strip() for row in table[1:]): table for table in tables}
    for rows in (TOPICS, SERVICES, DELIVERIES):
        assert tuple(row.name for row in rows) in first


def test_no_page_has_a_deprecated_name_of_a_service(html):
    from delta3_pacdrive.ros.wire.interfaces import SERVICES

    former = {item.former_name for item in SERVICES if item.former_name}
    words = {name: set(re.findall(r'[\w/]+', re.sub(r'<[^>]*>', ' ', text))) for name, text in html.items()}
    assert {name: used for name, found in words.items() if (used := found & former)} == {}


def test_page_makes_no_network_requests(html):
    loaded = re.compile(r'<(?:script|img|iframe)[^>]*src="(?:https?:)?//|<link[^>]*href="(?:https?:)?//')
    assert {name: found for name, text in html.items() if (found := loaded.findall(text))} == {}


def test_every_equation_is_rendered(html):
    left = re.compile(r'\$\$|\\(?:frac|theta|begin|dot)\b')
    pages = {name: re.sub(r'<(pre|code)\b.*?</\1>', '', text, flags=re.DOTALL) for name, text in html.items()}
    assert {name: found for name, text in pages.items() if (found := left.findall(text))} == {}
