"""Norm-optimal iterative learning control: corrections of the feed-forward torque from repetitions of a program."""
