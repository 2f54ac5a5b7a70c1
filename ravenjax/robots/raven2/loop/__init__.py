"""The loop of one millisecond: one cycle of the control software, and the whole tick."""
