"""Reads search files: section [search], the group as a template of runs, and outcomes."""
