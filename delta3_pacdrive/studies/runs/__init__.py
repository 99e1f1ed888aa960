"""Analysis of runs: figures, experiments of the thesis, estimation, calibration, tuning, studies."""
