"""The fault table: from the axes of each group to one row a run, and from there to what an
engine takes.
"""
