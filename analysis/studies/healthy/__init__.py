"""A healthy robot's report: how wrong cameras saw it, how wrong drawn robots make it, and what
that changes.
"""
