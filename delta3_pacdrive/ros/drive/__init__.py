"""Parts of the MC-4 drive node."""
