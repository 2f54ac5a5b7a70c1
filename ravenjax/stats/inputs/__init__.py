"""What an outcome depends on: rates against inputs, Sobol's and Morris's sensitivity."""
