"""Every signal of a run, cycle by cycle: traces in memory and in files, and bags."""
