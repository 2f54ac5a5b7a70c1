"""Generates the source files of a C library with control software and virtual robot."""
