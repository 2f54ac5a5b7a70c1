"""Runs published hazards and injections again: the library, and the list of SAFECOMP 2015, with a
comparison of outcome classes.
"""
