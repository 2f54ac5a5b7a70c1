"""Declares campaigns and shows their results in Python. Its public names are those of
`ravenjax`."""
