"""Reports on single runs: their events in words, their figures, and the ranking of the worst runs."""
