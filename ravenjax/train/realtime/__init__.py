"""Defines the clock, the realtime loop, and ring buffers in shared memory."""
