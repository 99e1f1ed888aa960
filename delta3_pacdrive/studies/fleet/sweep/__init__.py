"""Sweeps: many simulated runs with varied parameters and programs."""
