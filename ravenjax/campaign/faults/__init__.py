"""Expands the groups of a campaign file into a table of faults, and into arrays for an engine."""
