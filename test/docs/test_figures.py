"""A script generates every picture of the documentation anew."""

import re
import struct
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2]
FIGURES = SOURCE / 'docs/figures'
WIDTH_MIN = 1000  # of a picture that is read at 800 px


@pytest.fixture(scope='module')
def drawn(tmp_path_factory):
    """Draw everything; return the folder."""
    import os
    import subprocess
    import sys

    folder = tmp_path_factory.mktemp('figures')
    command = [sys.executable, FIGURES / 'draw.py', folder]
    environment = {name: value for name, value in os.environ.items() if name != 'PYTHONSAFEPATH'}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    return folder


def size_of(path):
    """Return width and height of a PNG file."""
    head = path.read_bytes()[:24]
    assert head.startswith(b'\x89PNG')
    return struct.unpack('>II', head[16:])


@pytest.mark.long
def test_every_stored_picture_is_redrawn_in_its_size(drawn):
    names = {path.name for path in drawn.iterdir()}
    assert names == {path.name for path in FIGURES.glob('*.png')}
    for name in names:
        assert size_of(drawn / name) == size_of(FIGURES / name)
        assert size_of(drawn / name)[0] >= WIDTH_MIN


def test_every_picture_is_shown_somewhere():
    pages = [SOURCE / 'README.md', *(SOURCE / 'docs').rglob('*.md')]
    shown = {
        Path(name).name
        for page in pages
        for name in re.findall(r'figures/(\w+\.png)|!\[[^\]]*\]\(([^)]*)\)', page.read_text(encoding='utf-8'))
        for name in name
        if name
    }
    assert {path.name for path in FIGURES.glob('*.png')} <= shown
