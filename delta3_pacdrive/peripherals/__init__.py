"""The cell around the robot: inputs, valves, vacuum cup, parts, boxes, belts and camera."""
