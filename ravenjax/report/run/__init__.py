"""Reports on single runs: their events in words, figures, and the ranking of the worst runs."""
