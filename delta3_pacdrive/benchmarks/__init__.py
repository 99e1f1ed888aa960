"""Benchmarks: timing, processor load and accuracy, compared with references."""
