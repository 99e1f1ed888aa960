"""The robot on ROS 2: its nodes, and what turns messages into the values of the core and back."""
