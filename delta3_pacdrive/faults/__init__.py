"""Faults on purpose: what there is, how it is written down, and what it does."""
