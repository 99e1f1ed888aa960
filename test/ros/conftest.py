"""Tests of nodes in one process, over real DDS: the shared fixtures are those of ``support/robots.py``."""

from robots import (  # noqa: F401  fixtures
    compiled,
    delta3,
    graph,
    nothing_left_behind,
    own_domain,
    processes,
    shared_graph,
    start_delta3,
)
