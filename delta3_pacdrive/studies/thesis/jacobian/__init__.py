"""Jacobian experiments (11.2): joint motion from TCP motion, and the effects of geometry errors and singularities."""
