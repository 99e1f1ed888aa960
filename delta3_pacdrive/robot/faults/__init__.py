"""Injected faults: kinds, notation, schedule and effects."""
