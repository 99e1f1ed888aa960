"""Calibration of the arms from positions of the TCP measured with an external instrument."""
