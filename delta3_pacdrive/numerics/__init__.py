"""What numbers are computed with: compiled kernels."""
