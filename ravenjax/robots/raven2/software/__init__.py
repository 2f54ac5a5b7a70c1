"""The control software without a robot, for use from Python."""
