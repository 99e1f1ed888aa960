"""A script takes the screenshots of the documentation in the browser of the tests."""

import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

SOURCE = Path(__file__).parents[2]
SCREENSHOTS = SOURCE / 'docs/screenshots'


def require_round(path):
    """Require a small endless animation in which the last pose of the robot equals the first."""
    assert path.stat().st_size <= 500_000
    with Image.open(path) as animation:
        assert 24 <= animation.n_frames <= 40
        assert animation.info['loop'] == 0
        frames = []
        for n in range(animation.n_frames):
            animation.seek(n)
            frames.append(np.asarray(animation.convert('L'), dtype=float))
    steps = [np.abs(a - b).mean() for a, b in pairwise([*frames, frames[0]])]
    assert steps[-1] < 1.5 * max(steps[:-1])
    assert np.abs(frames[0] - frames[len(frames) // 2]).mean() > max(steps)


def kept():
    return {path.name for path in SCREENSHOTS.iterdir() if path.suffix in ('.png', '.webp')}


def test_every_screenshot_is_shown_and_the_round_is_one():
    shown = [SOURCE / 'README.md', *SOURCE.glob('docs/*.md')]
    pages = ''.join(path.read_text(encoding='utf-8') for path in shown)
    assert {name for name in kept() if f'screenshots/{name}' not in pages} == set()
    require_round(SCREENSHOTS / 'pick_cycle.webp')


@pytest.mark.long
def test_every_screenshot_is_reproducible(browser, tmp_path):
    environment = {name: value for name, value in os.environ.items() if name != 'PYTHONSAFEPATH'}
    command = [sys.executable, SCREENSHOTS / 'take.py', tmp_path, '--draft']
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, timeout=1100)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == kept()
    require_round(tmp_path / 'pick_cycle.webp')
