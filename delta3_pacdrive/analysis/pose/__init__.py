"""A pose of the robot: where it is, what it can do there, how far limits and singularities are away."""
