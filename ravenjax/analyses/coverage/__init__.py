"""Measures the diagnostic coverage of checks, and the harm of pairs of faults."""
