"""The pictures of pages in the documentation are taken by a script, in the browser of the tests."""

import os
import subprocess
import sys
from pathlib import Path

SOURCE = Path(__file__).parents[2]
SCREENSHOTS = SOURCE / 'docs/screenshots'


def test_every_screenshot_is_shown_and_can_be_taken_anew(browser, tmp_path):
    names = {path.name for path in SCREENSHOTS.glob('*.png')}
    pages = ''.join(path.read_text(encoding='utf-8') for path in SOURCE.glob('docs/*.md'))
    assert {name for name in names if f'screenshots/{name}' not in pages} == set()
    environment = {name: value for name, value in os.environ.items() if name != 'PYTHONSAFEPATH'}
    command = [sys.executable, SCREENSHOTS / 'take.py', tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, timeout=240)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == names
