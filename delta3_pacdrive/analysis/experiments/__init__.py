"""Experiments 1 to 3 of the thesis (chapters 10 and 11.1): a model held against a robot on the same program."""
