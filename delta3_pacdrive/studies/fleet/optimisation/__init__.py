"""Optimisation of parameters and programs by simulated trials."""
