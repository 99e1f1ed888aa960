"""Sweeps: many runs of one program, in which parameters and values of the program vary."""
