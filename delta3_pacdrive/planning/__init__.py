"""Motion planning: programs, paths, timing, limits and plans (thesis 5, 6)."""
