"""Intervals by resampling: of anything computed from units, and of rows that come in clusters."""
