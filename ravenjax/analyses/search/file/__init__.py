"""Reads search files: the section [search], the group that is a template of runs, and outcomes."""
