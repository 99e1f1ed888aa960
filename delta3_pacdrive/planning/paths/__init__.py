"""Geometry of the motion: curves, paths, moves, profiles of the virtual master (thesis 5)."""
