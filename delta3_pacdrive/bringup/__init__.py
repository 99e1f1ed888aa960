"""The processes of a robot: how they are started, scheduled, watched and ended."""
