"""The robot as CRTK has it, over ROS 2 (DDS) and ROS 1: states, poses and commands in SI units."""
