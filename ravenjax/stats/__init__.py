"""Statistics, free of robots: intervals, comparisons, bootstrap, alarms, sensitivity, sample
sizes.
"""
