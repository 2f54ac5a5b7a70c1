"""Stores the time series of single runs and of training sessions as MCAP, CSV or xarray."""
