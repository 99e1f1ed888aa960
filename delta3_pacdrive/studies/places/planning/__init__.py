"""Evaluation of a planned program: path, speed, acceleration, jerk, motors, margins, and the limit of each move."""
