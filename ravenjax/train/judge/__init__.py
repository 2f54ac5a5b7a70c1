"""Judges each hazard of a session: effects on the robot, first knowledge, response and score."""
