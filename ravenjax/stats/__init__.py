"""Statistics that need no robot: intervals, comparisons, bootstrap, alarms and sample sizes."""
