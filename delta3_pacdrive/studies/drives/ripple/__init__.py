"""Ripple of the motor currents caused by bus cycle and fine interpolation."""
