"""Which conclusions depend on what nobody knows exactly of the robot."""
