"""Ripple of the motor currents: what bus cycle and fine interpolation make of them, and a look inside a bus cycle."""
