"""What the tests share: the default robot, and property tests that draw the same examples in every run."""

import signal

import pytest
from hypothesis import settings

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    # shells start what runs in the background so; the programs that are tested would ignore Ctrl-C, too
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile('facts', derandomize=True, database=None, deadline=None, max_examples=100)
settings.load_profile('facts')


@pytest.fixture(scope='session')
def robot():
    """Return the parameters of the default robot."""
    from delta3_pacdrive import parameters

    return parameters.load()
