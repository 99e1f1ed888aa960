"""The package ``control_msgs`` for tests of the planner's node."""

import fcntl
import importlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import control_msgs_build
from delta3_pacdrive.ros.wire.control_messages import control_type

BUILD_S = 400.0  # for 50 files on a machine that has other things to do


@pytest.fixture(scope='session')
def control_msgs_site(tmp_path_factory: pytest.TempPathFactory) -> Path | None:
    """Give the folder of a built package, None if one is installed."""
    if control_type('ExecuteMotionPrimitiveSequence') is not None:
        return None
    if what := control_msgs_build.missing():
        pytest.skip(f'control_msgs is not installed and cannot be built: {what}')
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if 'PYTEST_XDIST_WORKER' in os.environ else base
    folder, built = shared / 'control_msgs', shared / 'control_msgs_built'
    with (shared / 'control_msgs_lock').open('w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # one worker builds it for all
        if not built.exists():
            script = Path(control_msgs_build.__file__)
            subprocess.run([sys.executable, script, folder], capture_output=True, check=True, timeout=BUILD_S)
            built.touch()
    return folder / 'site'


@pytest.fixture(scope='module')
def control_msgs(control_msgs_site: Path | None) -> Iterator[Any]:
    """Give the package, installed or built; a built package is invisible outside the tests of this file."""
    if control_msgs_site is None:
        yield importlib.import_module('control_msgs')
        return
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(control_msgs_site)
        yield importlib.import_module('control_msgs')
        for name in [name for name in sys.modules if name.partition('.')[0] == 'control_msgs']:
            del sys.modules[name]
