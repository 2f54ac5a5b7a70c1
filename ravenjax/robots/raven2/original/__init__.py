"""Computes geometry in double precision, with the original's operations in their order."""
