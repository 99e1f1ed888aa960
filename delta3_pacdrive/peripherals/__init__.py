"""What stands around the robot: inputs, valves and a vacuum cup, parts, places, belts and a camera."""
