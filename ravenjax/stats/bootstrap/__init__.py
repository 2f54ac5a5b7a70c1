"""Computes intervals by resampling, for any statistic of independent units and for rows in
clusters.
"""
