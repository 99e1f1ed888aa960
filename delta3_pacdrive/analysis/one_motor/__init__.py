"""The single motor: one MC-4, one motor, and a load in place of the robot (8.1, 8.2)."""
