"""The integration test of the integrator's page: it passes as printed, in a process of its own."""

import subprocess
import sys
from pathlib import Path

import pages

FILE = 'test_my_cell.py'
LIMIT_S = 180.0  # 8 s on a machine that has nothing else to do


def test_the_integration_test_of_the_guide_passes(tmp_path: Path, nothing_left_behind: None) -> None:
    (block,) = [one for one in pages.blocks(pages.SOURCE / 'docs' / 'integrator.md') if one.file == FILE]
    (tmp_path / FILE).write_text(block.text, encoding='utf-8')
    command = [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', FILE]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 0, done.stdout
    assert '1 passed' in done.stdout
