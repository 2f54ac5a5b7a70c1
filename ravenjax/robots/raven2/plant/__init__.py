"""Simulates motors, cables, links and encoders of the virtual robot, and the nominal model."""
