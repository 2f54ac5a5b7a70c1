"""Compares two groups: independent, run by run, or by clusters; and measures the size of their
difference.
"""
