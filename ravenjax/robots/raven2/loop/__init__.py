"""The loop of one millisecond: the tick, one cycle of the control software, faults at its seams."""
