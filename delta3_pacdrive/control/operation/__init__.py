"""State of the robot: enabling, control by an operator, commands, scripts, cyclic operation."""
