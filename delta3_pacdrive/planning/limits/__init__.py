"""Limits of moves, violations of them, and the capability of the robot at a pose."""
