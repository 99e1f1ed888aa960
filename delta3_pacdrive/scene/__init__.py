"""How the robot looks: parts with shapes from its parameters, their poses from arm angles, models for other tools."""
