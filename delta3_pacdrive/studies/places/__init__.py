"""Studies of poses, of the workspace, and of planned programs."""
