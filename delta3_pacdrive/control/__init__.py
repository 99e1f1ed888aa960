"""The controller as pure state machines: no ROS, no clock, no thread; events in, actions out."""
