"""The planar two-link arm of chapter 3: kinematics and figures."""
