"""Which inputs decide an outcome: Sobol's and Morris's indices, and their figures."""
