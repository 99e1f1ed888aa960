"""Analysis of a pose: position, capability, distances to limits and singularities."""
