"""Time and processes: the clock, the loop of a millisecond, memory shared between processes."""
