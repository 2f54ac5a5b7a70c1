"""Stores time series and recordings of traces and sessions as MCAP, CSV or xarray."""
