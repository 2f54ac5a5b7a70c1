"""Time series and recordings: what a trace or a session holds, as MCAP, CSV or xarray."""
