"""Computes confidence intervals by resampling independent units."""
