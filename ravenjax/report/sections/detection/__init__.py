"""Detectors in a report: how many unintended motions each recalls, how early, and how often it
alarms for nothing.
"""
