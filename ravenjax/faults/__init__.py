"""Fault injection at the seams of a tick: effects, sites and windows; for any robot."""
