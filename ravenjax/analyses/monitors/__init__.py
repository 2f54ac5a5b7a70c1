"""Defines monitors (checks as data), calibrates them, and searches for missing checks."""
