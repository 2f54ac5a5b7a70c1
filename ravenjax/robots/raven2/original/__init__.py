"""Computes geometry in double precision, with the same operations as raven2 in the same order."""
