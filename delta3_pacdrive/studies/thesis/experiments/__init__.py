"""Experiments 1 to 3 of the thesis, and the comparison of any two runs as model and robot."""
