"""Report page of runs: robot in 3-D, signals over time, moves, figures and provenance, in one HTML file."""
