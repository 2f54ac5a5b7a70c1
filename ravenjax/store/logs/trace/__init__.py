"""Writes the time series of one run to files: MCAP and CSV."""
