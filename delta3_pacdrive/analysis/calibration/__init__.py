"""Calibration: how each arm is built, from places of the TCP that somebody has measured; what the controller uses."""
