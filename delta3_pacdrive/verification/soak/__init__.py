"""Random programs with random faults; every telegram is held against what must always be."""
