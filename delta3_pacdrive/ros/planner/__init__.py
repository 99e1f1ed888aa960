"""Parts of the UnitRobot planner node."""
