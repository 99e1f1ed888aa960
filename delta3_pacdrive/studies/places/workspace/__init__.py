"""Maps of the workspace: singularity, speed, acceleration, payload and accuracy, as slices and as a volume."""
