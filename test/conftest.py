"""Shared fixtures: the default robot, a shell, and property tests with reproducible examples."""

import gc
import json
import os
import runpy
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis.internal.conjecture import providers

from thoroughness import EVERYTHING, examples

# Shells start what runs in the background without Ctrl-C, and nohup without SIGHUP; the programs that are tested would
# ignore them, too.
for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) == signal.SIG_IGN:
        signal.signal(number, handler)

# The matrices are small: threads of the linear algebra would wait for each other, on processors that others need.
# Read when numpy is imported, which is later.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

# As the commands do: to look for garbage more often takes up to a tenth of the time of a test.
gc.set_threshold(50_000, 10, 10)

# Files whose tests take longest. They begin first, so that several workers come to their end together.
FIRST = (
    'system/test_identical.py',
    'system/test_identical_turns.py',
    'system/test_up.py',
    'system/test_run.py',
    'system/test_scripts.py',
    'ros/test_verification.py',
    'guides/test_pages.py',
    'guides/test_executables.py',
    'docs/test_pages.py',
    'docs/test_long_pages.py',
    'examples/test_examples.py',
    'ros/test_rephasing.py',
    'numerics/test_kernel.py',
    'test_surroundings.py',
    'test_interrupts.py',
    'view/test_page.py',
    'studies/report_page/test_in_browser.py',
    'docs/test_screenshots.py',
)

# Reasons for which tests may be skipped in CI: properties of the machine and of single cases.
MAY_BE_SKIPPED = (
    'apt-get install chromium',
    'nobody here may schedule in real time',
    'real-time scheduling is not permitted',
    'only root can give a folder to another user',
    'root may write everywhere',
    'mounting a small disk is not permitted',
    'control_msgs is',
    'tf2_msgs is',
    'no packets can be dropped here',
    'there cannot be two hosts here',
    'numba-cuda is not installed',
    'an elastic gear needs a shorter exchange period',
    'there is no such stage',
)


def _in_ci():
    return os.environ.get('CI', '').lower() not in ('', '0', 'false')


def pytest_report_header():
    """Return which tests and which comparison of the golden runs this run makes."""
    golden = Path(__file__).parent / 'golden'  # nothing of the package is imported before the first test
    maker = json.loads((golden / 'figures.json').read_text(encoding='utf-8'))['maker']
    same = maker == runpy.run_path(str(golden / 'maker.py'))['maker']()
    compared = 'every bit' if same or _in_ci() else 'bits, and rounded values of signals with other bits'
    long = [] if EVERYTHING else ['tests marked long are left out (DELTA3_LONG=1 runs them)']
    return [*long, f'golden runs are compared by {compared}']


def pytest_collection_modifyitems(config, items):
    """Deselect tests marked ``long`` unless they are requested, and start with the slowest files."""
    if not EVERYTHING:
        left_out = [item for item in items if item.get_closest_marker('long')]
        items[:] = [item for item in items if not item.get_closest_marker('long')]
        config.hook.pytest_deselected(items=left_out)
    here = Path(__file__).parent
    order = {here / name: number for number, name in enumerate(FIRST)}
    items.sort(key=lambda item: order.get(item.path, len(order)))


def pytest_sessionfinish(session):
    """In CI, where every extra is installed, fail if a test was skipped for another reason than those expected."""
    reporter = session.config.pluginmanager.get_plugin('terminalreporter')
    if reporter is None or not _in_ci():
        return
    skipped = [f'{report.nodeid}: {report.longrepr[2]}' for report in reporter.stats.get('skipped', ())]
    new = [line for line in skipped if not any(reason in line for reason in MAY_BE_SKIPPED)]
    if new and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
        reporter.write_line('Skipped, but not expected to be (MAY_BE_SKIPPED in test/conftest.py):', red=True)
        reporter.write_line('\n'.join(new))


# Hypothesis also draws constants from the modules outside site-packages that are imported at the time, such as scripts
# of earlier tests. Examples would depend on the tests that a worker ran before, and there is no setting against it.
providers.is_local_module_file = lambda path: False
settings.register_profile('facts', derandomize=True, database=None, deadline=None, max_examples=examples(100))
settings.load_profile('facts')


@pytest.fixture(scope='session')
def robot():
    """Return the parameters of the default robot."""
    from delta3_pacdrive import parameters

    return parameters.load()


@pytest.fixture(scope='module')
def browser():
    """Return a real browser; the test is skipped where there is none."""
    from browser import chromium

    with chromium() as found:
        yield found


@pytest.fixture
def shell(tmp_path):
    """Return a function that runs a command line in an own folder, as a user of the tested environment does."""
    environment = os.environ | {'PATH': f'{Path(sys.executable).parent}{os.pathsep}{os.environ["PATH"]}'}

    def run(line, *, cwd=tmp_path, timeout=900.0, **variables):
        return subprocess.run(
            ['bash', '-c', line],
            cwd=cwd,
            env=environment | variables,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )

    return run
