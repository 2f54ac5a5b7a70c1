"""Plans the number of runs for a wanted precision, and decides when to stop early."""
