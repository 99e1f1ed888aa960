"""Tuning: step and frequency responses of the loops, their margins, and the effect of gains on a program (7.1, 8.1)."""
