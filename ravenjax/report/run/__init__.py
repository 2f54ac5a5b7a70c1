"""Reports single runs: a text of their events, their figures, and a ranking of the worst runs."""
