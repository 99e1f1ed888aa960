"""Soak test: random programs with random faults; every telegram is checked against the invariants."""
