"""The nodes of a robot, each with its main function."""
