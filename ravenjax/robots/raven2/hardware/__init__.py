"""The virtual robot alone: PLC, motors, cables, links and encoders, for control software of
one's own.
"""
