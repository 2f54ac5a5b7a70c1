"""The clock, the realtime loop, and ring buffers in memory that processes share."""
