"""Judges each hazard of a session: its effects on the robot, when the trainee could first know of
it, the response and the score.
"""
