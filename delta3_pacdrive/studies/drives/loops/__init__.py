"""Control loops of a drive: linear models, test bench, frequency responses."""
