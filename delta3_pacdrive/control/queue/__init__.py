"""The planner: queue of programs, requests, overrides, trajectories, appended moves."""
