"""Writes evidence for a risk file: tables, and an argument whose numbers are linked to runs and
checksums.
"""
