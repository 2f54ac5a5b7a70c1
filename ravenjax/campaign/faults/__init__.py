"""Expands groups of a campaign into the fault table, one row per run, and converts it to an
engine's inputs.
"""
