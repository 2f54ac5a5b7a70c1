"""Exports the control software and the virtual robot as a library for C programs."""
