"""The Jacobian experiments (11.2): joint motion from TCP motion, what geometry errors and singularities make of it."""
