"""Single motor: one MC-4 and one motor with a load instead of the robot (8.1, 8.2)."""
