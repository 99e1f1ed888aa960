"""Motion planning: virtual master, paths, moves, programs and their checks (thesis 5, 6)."""
