"""Sensitivity of an outcome to its inputs: Sobol's and Morris's indices."""
