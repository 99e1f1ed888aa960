"""A Delta-3 robot on a PacDrive motion controller, emulated on ROS 2."""
