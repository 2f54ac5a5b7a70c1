"""The clock, the realtime loop, and rings of memory between processes."""
