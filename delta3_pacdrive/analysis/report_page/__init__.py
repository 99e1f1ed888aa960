"""One page for runs: the robot in 3-D, all signals over one time, moves, figures, provenance, in one HTML file."""
