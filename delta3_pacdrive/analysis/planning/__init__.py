"""What the planner made of a program: path, speed, acceleration, jerk, motors, margins, and what limits each move."""
