"""Measures the quality of an alarm: ROC curve, false alarms per hour, choice between alarms."""
