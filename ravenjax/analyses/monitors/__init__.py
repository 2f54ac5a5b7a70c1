"""Monitors: checks that a robot does not have yet, as data, and what they would have done."""
