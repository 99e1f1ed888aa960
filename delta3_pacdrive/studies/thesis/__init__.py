"""Studies that repeat the experiments of the thesis."""
