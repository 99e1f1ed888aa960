"""Estimation of parameters from recorded motions."""
