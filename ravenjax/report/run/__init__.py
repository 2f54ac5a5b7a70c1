"""Single runs: what happened in one, in words and as a figure, and which runs are the worst."""
