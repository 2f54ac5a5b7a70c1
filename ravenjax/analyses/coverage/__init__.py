"""Measures what checks are worth: diagnostic coverage of harmful faults, and pairs of faults."""
