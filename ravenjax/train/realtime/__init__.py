"""Runs a session in real time, one tick a millisecond."""
