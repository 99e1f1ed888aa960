"""Geometry of the robot for display: parts and shapes, their poses, and models for other tools."""
