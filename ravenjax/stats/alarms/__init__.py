"""Measures how good an alarm is: ROC, false alarms per hour, trade-offs, and the choice between
alarms.
"""
