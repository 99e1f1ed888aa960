"""What holds a robot that is up against what must be: the catalogue of faults, the soak, their invariants."""
