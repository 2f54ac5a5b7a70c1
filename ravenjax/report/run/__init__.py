"""Reports about single runs: events in words, figures, and the worst runs."""
