"""Connects the robot to CRTK over ROS 1 or ROS 2. States, poses and commands are in SI units."""
