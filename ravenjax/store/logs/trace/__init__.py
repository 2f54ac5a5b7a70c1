"""One run's time series as files: MCAP and CSV."""
