"""Implements `ravenjax bench`: how fast a machine simulates the robot, and MuJoCo beside it."""
