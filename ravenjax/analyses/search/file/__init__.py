"""Reads search files: the section [search], the faults to vary, and the outcome to find."""
