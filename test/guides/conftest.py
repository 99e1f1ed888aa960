"""Tests of the pages that instruct users with a robot; the shared fixtures are in ``support/robots.py``."""

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
