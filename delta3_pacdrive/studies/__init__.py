"""Analysis of runs, and studies: thesis experiments, drives, calibration, estimation, places, fleets."""
