"""The campaign file: what may be written, what it means, and what to say where it is wrong."""
