"""Studies of drives and motors: tuning, control loops, current ripple, single motor."""
