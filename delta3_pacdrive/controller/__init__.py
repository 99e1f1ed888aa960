"""The controller's decisions as pure state machines: no ROS, no clock, no thread; events come in, actions go out."""
