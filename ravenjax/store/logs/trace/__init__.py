"""Writes one run's time series to files: MCAP and CSV."""
