"""Studies with many runs or robots: sweeps, optimisation, lines."""
