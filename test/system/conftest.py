"""Facts about the real executables: the shared fixtures are those of ``support/robots.py``."""

from robots import (  # noqa: F401  fixtures
    compiled,
    delta3,
    fork_delta3,
    graph,
    nothing_left_behind,
    own_domain,
    processes,
    shared_graph,
    start_delta3,
)
