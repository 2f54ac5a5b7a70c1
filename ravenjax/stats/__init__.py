"""Provides statistics that are independent of robots: intervals, comparisons, bootstrap, alarms,
sensitivity, sample sizes.
"""
