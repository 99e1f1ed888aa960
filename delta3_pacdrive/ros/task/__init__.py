"""Parts of the transformation-task node."""
