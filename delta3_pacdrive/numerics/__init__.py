"""Numerical basis: compiled kernels and vectors."""
