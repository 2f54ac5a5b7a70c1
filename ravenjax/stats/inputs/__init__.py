"""Measures how an outcome depends on its inputs: rates against inputs, and Sobol's and Morris's
sensitivity.
"""
