"""Connects the robot to CRTK over ROS 2 (DDS) and ROS 1: states, poses and commands in SI units."""
