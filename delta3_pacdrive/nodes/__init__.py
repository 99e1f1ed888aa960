"""The ROS 2 shells around the core: the only modules that import rclpy and messages."""
