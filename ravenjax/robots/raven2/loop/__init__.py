"""The loop of one millisecond: the tick, one cycle of the control software, and faults at its
seams.
"""
