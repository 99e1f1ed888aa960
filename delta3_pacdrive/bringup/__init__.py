"""The processes of a robot: start, scheduling, monitoring and shutdown."""
