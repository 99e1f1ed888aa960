"""Tests of the real executables: the shared fixtures are those of ``support/robots.py``."""

import pytest

from robots import (  # noqa: F401  fixtures
    Graph,
    compiled,
    delta3,
    graph,
    nothing_left_behind,
    own_domain,
    processes,
    start_delta3,
)


@pytest.fixture(scope='module')
def shared_graph():
    """Return one graph for the tests of a file. Clients that run in this process use the default context."""
    made = Graph()
    try:
        yield made
    finally:
        made.close()
