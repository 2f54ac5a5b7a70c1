"""Declares campaigns and shows results in Python. Its public names are those of `ravenjax`."""
