"""Compares two groups, independent or paired, and estimates the size of their difference."""
