"""Expands the groups of a campaign file into a table of faults, and converts it to arrays for an
engine."""
