"""Implements `ravenjax bench`, which measures how fast a machine simulates the robot, with each
engine and compared with MuJoCo.
"""
