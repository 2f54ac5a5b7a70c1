"""Generates the texts of a C library with control software and virtual robot."""
