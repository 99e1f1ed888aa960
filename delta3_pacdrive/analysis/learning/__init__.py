"""Learning: torques that a program still lacks, from repetitions of it (norm-optimal iterative learning control)."""
