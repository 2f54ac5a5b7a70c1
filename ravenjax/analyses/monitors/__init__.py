"""Defines monitors (checks that are stored as data), calibrates them, and finds missing checks."""
