"""The nodes of a robot with their main functions."""
