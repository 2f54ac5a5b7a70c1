"""Exports control software and virtual robot for C programs."""
