"""Reads search files: the section [search], the group of faults to vary, and the outcome to
find."""
