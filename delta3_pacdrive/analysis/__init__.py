"""What is made of runs: figures, experiments of the thesis, estimation, tuning."""
