"""Measures the quality of an alarm: ROC curve, false alarms per hour, and the choice between
alarms."""
