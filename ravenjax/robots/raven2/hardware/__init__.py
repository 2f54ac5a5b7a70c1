"""The virtual robot alone: PLC, motors, cables, links and encoders, for a user's control
software.
"""
