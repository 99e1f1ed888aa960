"""Optimisation: values of parameters and of the program for which a number of the run is best, within limits."""
