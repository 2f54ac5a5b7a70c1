"""Computes the sensitivity of an outcome to its inputs, by Sobol's and Morris's indices."""
